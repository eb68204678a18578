/* Normal equations of the bundle adjustment: camera ray -> round screen -> projector pixel.

   `reference_bundle.py` has the equations; here a row of `rows` is a column of theirs. */
#include "picture.h"

/* Slopes by a lens's numbers, of its own pixel (mix NULL) or of what moves with that by `mix`. */
INLINE double *lens_columns(int fisheye, const struct picture *at, const lane *mix, double *rows) {
    const int bends = fisheye ? 4 : 5;
    EACH {
        const double xx = mix ? mix[0][i] : 1.0, xy = mix ? mix[1][i] : 0.0;
        const double yx = mix ? mix[2][i] : 0.0, yy = mix ? mix[3][i] : 1.0;
        rows[i] = xx * at->plane[0][i], rows[SIGHTS + i] = yx * at->plane[0][i];
        rows[ROW + i] = xy * at->plane[1][i], rows[ROW + SIGHTS + i] = yy * at->plane[1][i];
        rows[2 * ROW + i] = xx, rows[2 * ROW + SIGHTS + i] = yx;
        rows[3 * ROW + i] = xy, rows[3 * ROW + SIGHTS + i] = yy;
    }
    for (int k = 0; k < bends; k++) EACH {
            const double x = at->by_bend[k][i], y = at->by_bend[5 + k][i];
            double *row = rows + (4 + k) * ROW;
            row[i] = mix ? mix[0][i] * x + mix[1][i] * y : x;
            row[SIGHTS + i] = mix ? mix[2][i] * x + mix[3][i] * y : y;
        }
    return rows + (4 + bends) * ROW;
}

/* How the projector's pixel moves with the camera's: mix (2, 2), such that the ray's own picture
   stays where it is (two tangents as in Duff et al. 2017). With the ray its start moves as well. */
INLINE void mix_by_ray(const struct placed *camera, const struct sight *s,
                       const struct picture *own, const lane *by_shift, const lane *by_ray,
                       lane *mix) {
    const struct placed c = *camera;
    EACH {
        const double x = s->ray[0][i], y = s->ray[1][i], z = s->ray[2][i], t2 = s->angle2[i];
        const double sign = z >= 0.0 ? 1.0 : -1.0, a = -1.0 / (sign + z), b = x * y * a;
        const double ax = 1.0 + sign * x * x * a, ay = sign * b, az = -sign * x;
        const double bx = b, by = sign + y * y * a, bz = -y;
        const double across = x * x + y * y; /* theta / sin(theta) is 1 on the axis */
        const double wide = across > 0.0 ? sqrt(t2 / across) : 1.0;
        const double ahead = -2.0 * wide * (c.pupil[0] + 2.0 * c.pupil[1] * t2); /* of start, by z */
        double of[4], with[4]; /* of the projector's pixel, of the camera's, by both tangents */
        for (int r = 0; r < 2; r++) {
            const double u = by_ray[3 * r][i], v = by_ray[3 * r + 1][i];
            const double w = by_ray[3 * r + 2][i] + ahead * by_shift[3 * r + 2][i];
            of[2 * r] = u * ax + v * ay + w * az, of[2 * r + 1] = u * bx + v * by + w * bz;
            const double p = own->by_point[3 * r][i], q = own->by_point[3 * r + 1][i];
            const double o = own->by_point[3 * r + 2][i];
            with[2 * r] = p * ax + q * ay + o * az, with[2 * r + 1] = p * bx + q * by + o * bz;
        }
        const double one = -1.0 / (with[0] * with[3] - with[1] * with[2]);
        mix[0][i] = one * (of[0] * with[3] - of[1] * with[2]);
        mix[1][i] = one * (of[1] * with[0] - of[0] * with[1]);
        mix[2][i] = one * (of[2] * with[3] - of[3] * with[2]);
        mix[3][i] = one * (of[3] * with[0] - of[2] * with[1]);
    }
}

/* Columns of the projector's turn and shift. */
INLINE double *projector_columns(const struct sight *s, const struct picture *shown, double *rows) {
    for (int r = 0; r < 2; r++) {
        double *row = rows + r * SIGHTS;
        const lane *by = shown->by_point + 3 * r;
        EACH {
            const double x = s->there[0][i], y = s->there[1][i], z = s->there[2][i];
            const double a = by[0][i], b = by[1][i], c = by[2][i];
            row[i] = y * c - z * b, row[ROW + i] = z * a - x * c, row[2 * ROW + i] = x * b - y * a;
            row[3 * ROW + i] = a, row[4 * ROW + i] = b, row[5 * ROW + i] = c;
        }
    }
    return rows + 6 * ROW;
}

/* How the pixel moves with a height over the screen, and with a shift and a ray of the camera. */
INLINE void slopes_on_screen(const struct placed *camera, const struct placed *projector,
                             const struct sight *s, const struct picture *shown, lane *lift,
                             lane *by_shift, lane *by_ray) {
    const struct placed c = *camera, p = *projector;
    for (int r = 0; r < 2; r++) {
        const lane *by = shown->by_point + 3 * r;
        EACH {
            const double a = by[0][i], b = by[1][i], d = by[2][i];
            const double x = a * p.turn[0] + b * p.turn[3] + d * p.turn[6];
            const double y = a * p.turn[1] + b * p.turn[4] + d * p.turn[7];
            const double z = a * p.turn[2] + b * p.turn[5] + d * p.turn[8];
            const double u = s->direction[0][i], v = s->direction[1][i], w = s->direction[2][i];
            const double nx = s->outward[0][i], ny = s->outward[1][i], nz = s->outward[2][i];
            const double rise = (x * u + y * v + z * w) / (nx * u + ny * v + nz * w);
            const double gx = x - rise * nx, gy = y - rise * ny, gz = z - rise * nz;
            const double far = (s->point[0][i] - s->origin[0][i]) * u +
                               (s->point[1][i] - s->origin[1][i]) * v +
                               (s->point[2][i] - s->origin[2][i]) * w;
            lift[r][i] = rise;
            by_shift[3 * r][i] = gx * c.turn[0] + gy * c.turn[1] + gz * c.turn[2];
            by_shift[3 * r + 1][i] = gx * c.turn[3] + gy * c.turn[4] + gz * c.turn[5];
            by_shift[3 * r + 2][i] = gx * c.turn[6] + gy * c.turn[7] + gz * c.turn[8];
            for (int j = 0; j < 3; j++) by_ray[3 * r + j][i] = far * by_shift[3 * r + j][i];
        }
    }
}

/* Columns of log radius and bumps; the harmonics at the point by their tangents. */
INLINE double *screen_columns(const struct procam_bundle *job, size_t first, size_t count,
                              const struct sight *s, const lane *lift, double *rows) {
    const double radius = job->radius;
    const int waves = job->waves;
    for (int r = 0; r < 2; r++) EACH rows[r * SIGHTS + i] =
        radius * lift[r][i] * (1.0 + s->level[i]);
    for (size_t i = 0; i < count; i++) {
        const double *values = job->values + waves * (first + i);
        const double *slopes = job->slopes + 3 * waves * (first + i);
        for (int k = 0; k < waves; k++) {
            const double *slope = slopes + 3 * k;
            const double value = values[k] + slope[0] * s->off[0][i] + slope[1] * s->off[1][i] +
                                 slope[2] * s->off[2][i];
            rows[(1 + k) * ROW + (int)i] = radius * lift[0][i] * value;
            rows[(1 + k) * ROW + SIGHTS + (int)i] = radius * lift[1][i] * value;
        }
    }
    for (int k = 1; k <= waves; k++)
        for (size_t i = count; i < SIGHTS; i++)
            rows[k * ROW + (int)i] = rows[k * ROW + SIGHTS + (int)i] = 0.0;
    return rows + (1 + waves) * ROW;
}

/* Columns of the camera's turn and shift. */
INLINE double *camera_columns(const struct sight *s, const lane *by_shift, const lane *by_ray,
                              double *rows) {
    for (int r = 0; r < 2; r++) {
        double *row = rows + r * SIGHTS;
        const lane *shift = by_shift + 3 * r, *ray = by_ray + 3 * r;
        EACH {
            const double x = s->ray[0][i], y = s->ray[1][i], z = s->ray[2][i];
            const double start = s->start[i];
            row[i] = z * ray[1][i] - y * ray[2][i] + start * shift[1][i];
            row[ROW + i] = x * ray[2][i] - z * ray[0][i] - start * shift[0][i];
            row[2 * ROW + i] = y * ray[0][i] - x * ray[1][i];
            row[3 * ROW + i] = -shift[0][i], row[4 * ROW + i] = -shift[1][i];
            row[5 * ROW + i] = -shift[2][i];
        }
    }
    return rows + 6 * ROW;
}

INLINE double *pupil_columns(const struct sight *s, const lane *by_shift, double *rows) {
    for (int r = 0; r < 2; r++) EACH {
            const double once = by_shift[3 * r + 2][i] * s->angle2[i];
            rows[r * SIGHTS + i] = once;
            rows[ROW + r * SIGHTS + i] = once * s->angle2[i];
        }
    return rows + 2 * ROW;
}

/* The last column: predicted minus seen. */
INLINE void error_column(const struct procam_bundle *job, const struct placed *projector,
                         size_t first, size_t count, const struct picture *shown, double *row) {
    const struct placed p = *projector;
    for (int r = 0; r < 2; r++) {
        EACH row[r * SIGHTS + i] = shown->plane[r][i] * p.lens[r] + p.lens[2 + r];
        for (size_t i = 0; i < count; i++)
            row[r * SIGHTS + i] -= job->seen[2 * (first + i) + (size_t)r];
    }
}

/* Rows times the roots of the weights; 0 for an observation of which anything is not a number. */
INLINE void weigh(const double *weight, size_t count, int columns, double *rows) {
    lane root = {0}, spoilt = {0};
    for (size_t i = 0; i < count; i++) root[i] = sqrt(weight[i]);
    EACH spoilt[i] = 0.0 * root[i];
    for (int c = 0; c < columns; c++) {
        const double *row = rows + c * ROW;
        EACH spoilt[i] += 0.0 * row[i] + 0.0 * row[SIGHTS + i];
    }
    for (int c = 0; c < columns; c++) {
        double *row = rows + c * ROW;
        EACH {
            const int good = spoilt[i] == 0.0;
            row[i] = good ? row[i] * root[i] : 0.0;
            row[SIGHTS + i] = good ? row[SIGHTS + i] * root[i] : 0.0;
        }
    }
}

#if LEVEL == 512
#define DOUBLES 8
#define WIDE 4
#elif LEVEL == 256
#define DOUBLES 4
#define WIDE 2
#else
#define DOUBLES 2
#define WIDE 2
#endif
typedef double vd __attribute__((vector_size(8 * DOUBLES), may_alias));
typedef double vd_anywhere __attribute__((vector_size(8 * DOUBLES), may_alias, aligned(8)));

/* sums += rows rows^T, its lower half in tiles of 4 by WIDE that stay in registers; each entry is
   PARTIAL sums still apart, so that lanes are added up once at the end and not per tile. */
INLINE void add_products(int columns, const double *rows, double *sums) {
    for (int r = 0; r < columns; r += 4)
        for (int c = 0; c < r + 4; c += WIDE) {
            double *to = sums + (size_t)(r * columns + c) * PARTIAL;
            vd tile[4][WIDE];
            for (int a = 0; a < 4; a++)
                for (int b = 0; b < WIDE; b++)
                    tile[a][b] = *(vd_anywhere *)(to + (a * columns + b) * PARTIAL);
            for (int i = 0; i < ROW; i += DOUBLES) {
                vd left[4], right[WIDE];
                for (int a = 0; a < 4; a++) left[a] = *(const vd *)(rows + (r + a) * ROW + i);
                for (int b = 0; b < WIDE; b++) right[b] = *(const vd *)(rows + (c + b) * ROW + i);
                for (int a = 0; a < 4; a++)
                    for (int b = 0; b < WIDE; b++) tile[a][b] += left[a] * right[b];
            }
            for (int a = 0; a < 4; a++)
                for (int b = 0; b < WIDE; b++)
                    *(vd_anywhere *)(to + (a * columns + b) * PARTIAL) = tile[a][b];
        }
}

/* All columns of up to SIGHTS observations: those of `residual_slopes`, then the error. */
static void fill_rows(const struct procam_bundle *job, size_t first, size_t count, double *rows) {
    const struct placed camera = placed_at(job->camera), projector = placed_at(job->projector);
    struct sight s;
    struct picture shown, own;
    lane lift[2], by_shift[6], by_ray[6], mix[4];
    light(job, &camera, &projector, first, count, &s);
    picture_of(1, job->fisheye_projector, &projector, s.there, &shown);
    slopes_on_screen(&camera, &projector, &s, &shown, lift, by_shift, by_ray);
    rows = screen_columns(job, first, count, &s, lift, rows);
    rows = camera_columns(&s, by_shift, by_ray, rows);
    if (job->lens_free) {
        picture_of(1, job->fisheye_camera, &camera, s.ray, &own);
        mix_by_ray(&camera, &s, &own, by_shift, by_ray, mix);
        rows = lens_columns(job->fisheye_camera, &own, mix, rows);
        rows = pupil_columns(&s, by_shift, rows);
    }
    rows = projector_columns(&s, &shown, rows);
    rows = lens_columns(job->fisheye_projector, &shown, NULL, rows);
    error_column(job, &projector, first, count, &shown, rows);
}

static void bundle(const struct bundle *job, size_t first, size_t count) {
    const int columns = job->columns;
    const size_t size = (size_t)(columns * columns) * PARTIAL;
    double *sums = job->sums + first / job->tile * size;
    double rows[MOST_COLUMNS * ROW] __attribute__((aligned(64)));
    memset(sums, 0, size * sizeof(double));
    memset(rows + job->used * ROW, 0, (size_t)((columns - job->used) * ROW) * sizeof(double));
    for (size_t at = first; at < first + count; at += SIGHTS) {
        const size_t some = first + count - at < SIGHTS ? first + count - at : SIGHTS;
        fill_rows(job->how, at, some, rows);
        weigh(job->how->weight + at, some, job->used, rows);
        add_products(columns, rows, sums);
    }
}

/* Predicted minus seen pixels. */
static void misses(const struct bundle *job, size_t first, size_t count) {
    const struct procam_bundle *how = job->how;
    const struct placed camera = placed_at(how->camera), projector = placed_at(how->projector);
    for (size_t at = first; at < first + count; at += SIGHTS) {
        const size_t some = first + count - at < SIGHTS ? first + count - at : SIGHTS;
        struct sight s;
        struct picture shown;
        double row[ROW];
        light(how, &camera, &projector, at, some, &s);
        picture_of(0, how->fisheye_projector, &projector, s.there, &shown);
        error_column(how, &projector, at, some, &shown, row);
        for (size_t i = 0; i < some; i++) {
            job->sums[2 * (at + i)] = row[i];
            job->sums[2 * (at + i) + 1] = row[SIGHTS + i];
        }
    }
}
