/* Normal equations of the bundle adjustment: camera ray -> round screen -> projector pixel.

   For OBSERVATIONS observations at a time, `fill_rows` writes the residuals and their derivatives by all
   parameters, one parameter after the other, so that neighbouring observations share a vector.
   `add_products` multiplies them by their transpose. The sums are the normal matrix, gradient and
   cost. reference.py has the equations; a column of its Jacobian is a row of `rows`. */
#include "projection.h"

/* Derivatives by the parameters of a lens: of its own pixel (mix NULL), or of a pixel that depends on
   that one by the matrix `mix`. */
INLINE double *lens_columns(int fisheye, const struct projection *at, const lane *mix, double *rows) {
    const int bends = fisheye ? 4 : 5;
    EACH {
        const double xx = mix ? mix[0][i] : 1.0, xy = mix ? mix[1][i] : 0.0;
        const double yx = mix ? mix[2][i] : 0.0, yy = mix ? mix[3][i] : 1.0;
        rows[i] = xx * at->plane[0][i], rows[OBSERVATIONS + i] = yx * at->plane[0][i];
        rows[ROW + i] = xy * at->plane[1][i], rows[ROW + OBSERVATIONS + i] = yy * at->plane[1][i];
        rows[2 * ROW + i] = xx, rows[2 * ROW + OBSERVATIONS + i] = yx;
        rows[3 * ROW + i] = xy, rows[3 * ROW + OBSERVATIONS + i] = yy;
    }
    for (int k = 0; k < bends; k++) EACH {
            const double x = at->by_bend[k][i], y = at->by_bend[5 + k][i];
            double *row = rows + (4 + k) * ROW;
            row[i] = mix ? mix[0][i] * x + mix[1][i] * y : x;
            row[OBSERVATIONS + i] = mix ? mix[2][i] * x + mix[3][i] * y : y;
        }
    return rows + (4 + bends) * ROW;
}

/* Derivative mix (2, 2) of the projector's pixel by the camera's pixel, for a ray that follows its
   pixel (two tangents as in Duff et al. 2017). The start of the ray depends on its direction too. */
INLINE void mix_by_ray(const struct device *camera, const struct observations *s,
                       const struct projection *own, const lane *by_translation, const lane *by_ray,
                       lane *mix) {
    const struct device c = *camera;
    EACH {
        const double x = s->ray[0][i], y = s->ray[1][i], z = s->ray[2][i], t2 = s->angle2[i];
        const double sign = z >= 0.0 ? 1.0 : -1.0, a = -1.0 / (sign + z), b = x * y * a;
        const double ax = 1.0 + sign * x * x * a, ay = sign * b, az = -sign * x;
        const double bx = b, by = sign + y * y * a, bz = -y;
        const double across = x * x + y * y; /* theta / sin(theta) is 1 on the axis */
        const double wide = across > 0.0 ? sqrt(t2 / across) : 1.0;
        const double ahead = -2.0 * wide * (c.pupil[0] + 2.0 * c.pupil[1] * t2); /* derivative of start by z */
        double of[4], with[4]; /* derivatives of the projector's and of the camera's pixel by both tangents */
        for (int r = 0; r < 2; r++) {
            const double u = by_ray[3 * r][i], v = by_ray[3 * r + 1][i];
            const double w = by_ray[3 * r + 2][i] + ahead * by_translation[3 * r + 2][i];
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

/* Columns of the projector's rotation and translation. */
INLINE double *projector_columns(const struct observations *s, const struct projection *projected, double *rows) {
    for (int r = 0; r < 2; r++) {
        double *row = rows + r * OBSERVATIONS;
        const lane *by = projected->by_point + 3 * r;
        EACH {
            const double x = s->in_projector[0][i], y = s->in_projector[1][i], z = s->in_projector[2][i];
            const double a = by[0][i], b = by[1][i], c = by[2][i];
            row[i] = y * c - z * b, row[ROW + i] = z * a - x * c, row[2 * ROW + i] = x * b - y * a;
            row[3 * ROW + i] = a, row[4 * ROW + i] = b, row[5 * ROW + i] = c;
        }
    }
    return rows + 6 * ROW;
}

/* Derivatives of the pixel by the height of the screen and by a translation and a ray of the camera. */
INLINE void slopes_on_screen(const struct device *camera, const struct device *projector,
                             const struct observations *s, const struct projection *projected, lane *lift,
                             lane *by_translation, lane *by_ray) {
    const struct device c = *camera, p = *projector;
    for (int r = 0; r < 2; r++) {
        const lane *by = projected->by_point + 3 * r;
        EACH {
            const double a = by[0][i], b = by[1][i], d = by[2][i];
            const double x = a * p.rotation[0] + b * p.rotation[3] + d * p.rotation[6];
            const double y = a * p.rotation[1] + b * p.rotation[4] + d * p.rotation[7];
            const double z = a * p.rotation[2] + b * p.rotation[5] + d * p.rotation[8];
            const double u = s->direction[0][i], v = s->direction[1][i], w = s->direction[2][i];
            const double nx = s->outward[0][i], ny = s->outward[1][i], nz = s->outward[2][i];
            const double rise = (x * u + y * v + z * w) / (nx * u + ny * v + nz * w);
            const double gx = x - rise * nx, gy = y - rise * ny, gz = z - rise * nz;
            const double far = (s->point[0][i] - s->origin[0][i]) * u +
                               (s->point[1][i] - s->origin[1][i]) * v +
                               (s->point[2][i] - s->origin[2][i]) * w;
            lift[r][i] = rise;
            by_translation[3 * r][i] = gx * c.rotation[0] + gy * c.rotation[1] + gz * c.rotation[2];
            by_translation[3 * r + 1][i] = gx * c.rotation[3] + gy * c.rotation[4] + gz * c.rotation[5];
            by_translation[3 * r + 2][i] = gx * c.rotation[6] + gy * c.rotation[7] + gz * c.rotation[8];
            for (int j = 0; j < 3; j++) by_ray[3 * r + j][i] = far * by_translation[3 * r + j][i];
        }
    }
}

/* Columns of log radius and harmonic coefficients; the harmonics at the point to first order. */
INLINE double *screen_columns(const struct procam_bundle *job, size_t first, size_t count,
                              const struct observations *s, const lane *lift, double *rows) {
    const double radius = job->radius;
    const int harmonics = job->harmonics;
    for (int r = 0; r < 2; r++) EACH rows[r * OBSERVATIONS + i] =
        radius * lift[r][i] * (1.0 + s->level[i]);
    for (size_t i = 0; i < count; i++) {
        const double *values = job->values + harmonics * (first + i);
        const double *slopes = job->slopes + 3 * harmonics * (first + i);
        for (int k = 0; k < harmonics; k++) {
            const double *slope = slopes + 3 * k;
            const double value = values[k] + slope[0] * s->offset[0][i] + slope[1] * s->offset[1][i] +
                                 slope[2] * s->offset[2][i];
            rows[(1 + k) * ROW + (int)i] = radius * lift[0][i] * value;
            rows[(1 + k) * ROW + OBSERVATIONS + (int)i] = radius * lift[1][i] * value;
        }
    }
    for (int k = 1; k <= harmonics; k++)
        for (size_t i = count; i < OBSERVATIONS; i++)
            rows[k * ROW + (int)i] = rows[k * ROW + OBSERVATIONS + (int)i] = 0.0;
    return rows + (1 + harmonics) * ROW;
}

/* Columns of the camera's rotation and translation. */
INLINE double *camera_columns(const struct observations *s, const lane *by_translation, const lane *by_ray,
                              double *rows) {
    for (int r = 0; r < 2; r++) {
        double *row = rows + r * OBSERVATIONS;
        const lane *translation = by_translation + 3 * r, *ray = by_ray + 3 * r;
        EACH {
            const double x = s->ray[0][i], y = s->ray[1][i], z = s->ray[2][i];
            const double start = s->start[i];
            row[i] = z * ray[1][i] - y * ray[2][i] + start * translation[1][i];
            row[ROW + i] = x * ray[2][i] - z * ray[0][i] - start * translation[0][i];
            row[2 * ROW + i] = y * ray[0][i] - x * ray[1][i];
            row[3 * ROW + i] = -translation[0][i], row[4 * ROW + i] = -translation[1][i];
            row[5 * ROW + i] = -translation[2][i];
        }
    }
    return rows + 6 * ROW;
}

INLINE double *pupil_columns(const struct observations *s, const lane *by_translation, double *rows) {
    for (int r = 0; r < 2; r++) EACH {
            const double once = by_translation[3 * r + 2][i] * s->angle2[i];
            rows[r * OBSERVATIONS + i] = once;
            rows[ROW + r * OBSERVATIONS + i] = once * s->angle2[i];
        }
    return rows + 2 * ROW;
}

/* The last column: predicted minus observed. */
INLINE void error_column(const struct procam_bundle *job, const struct device *projector,
                         size_t first, size_t count, const struct projection *projected, double *row) {
    const struct device p = *projector;
    for (int r = 0; r < 2; r++) {
        EACH row[r * OBSERVATIONS + i] = projected->plane[r][i] * p.lens[r] + p.lens[2 + r];
        for (size_t i = 0; i < count; i++)
            row[r * OBSERVATIONS + i] -= job->observed[2 * (first + i) + (size_t)r];
    }
}

/* Rows times the roots of the weights; 0 for an observation with NaN or infinity anywhere. */
INLINE void apply_weights(const double *weight, size_t count, int columns, double *rows) {
    lane root = {0}, invalid = {0};
    for (size_t i = 0; i < count; i++) root[i] = sqrt(weight[i]);
    EACH invalid[i] = 0.0 * root[i];
    for (int c = 0; c < columns; c++) {
        const double *row = rows + c * ROW;
        EACH invalid[i] += 0.0 * row[i] + 0.0 * row[OBSERVATIONS + i];
    }
    for (int c = 0; c < columns; c++) {
        double *row = rows + c * ROW;
        EACH {
            const int good = invalid[i] == 0.0;
            row[i] = good ? row[i] * root[i] : 0.0;
            row[OBSERVATIONS + i] = good ? row[OBSERVATIONS + i] * root[i] : 0.0;
        }
    }
}

#define DOUBLES (LANES / 2)
#define WIDE (LANES == 16 ? 4 : 2) /* AVX-512 has twice as many registers */
typedef double vd __attribute__((vector_size(8 * DOUBLES), may_alias));
typedef double vd_anywhere __attribute__((vector_size(8 * DOUBLES), may_alias, aligned(8)));

/* sums += rows rows^T, its lower half in tiles of 4 by WIDE that stay in registers; each entry is
   kept as PARTIAL sums, which are added once at the end and not per tile. */
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

/* All columns of up to OBSERVATIONS observations: those of `bundle_rows`, then the residual. */
static void fill_rows(const struct procam_bundle *job, size_t first, size_t count, double *rows) {
    const struct device camera = device_at(job->camera), projector = device_at(job->projector);
    struct observations s;
    struct projection projected, own;
    lane lift[2], by_translation[6], by_ray[6], mix[4];
    trace_rays(job, &camera, &projector, first, count, &s);
    project(1, job->fisheye_projector, &projector, s.in_projector, &projected);
    slopes_on_screen(&camera, &projector, &s, &projected, lift, by_translation, by_ray);
    rows = screen_columns(job, first, count, &s, lift, rows);
    rows = camera_columns(&s, by_translation, by_ray, rows);
    if (job->lens_free) {
        project(1, job->fisheye_camera, &camera, s.ray, &own);
        mix_by_ray(&camera, &s, &own, by_translation, by_ray, mix);
        rows = lens_columns(job->fisheye_camera, &own, mix, rows);
        rows = pupil_columns(&s, by_translation, rows);
    }
    rows = projector_columns(&s, &projected, rows);
    rows = lens_columns(job->fisheye_projector, &projected, NULL, rows);
    error_column(job, &projector, first, count, &projected, rows);
}

static void bundle(const struct bundle *job, size_t first, size_t count) {
    const int columns = job->columns;
    const size_t size = (size_t)(columns * columns) * PARTIAL;
    double *sums = job->sums + first / job->tile * size;
    double rows[MOST_COLUMNS * ROW] __attribute__((aligned(64)));
    memset(sums, 0, size * sizeof(double));
    memset(rows + job->used * ROW, 0, (size_t)((columns - job->used) * ROW) * sizeof(double));
    for (size_t at = first; at < first + count; at += OBSERVATIONS) {
        const size_t some = first + count - at < OBSERVATIONS ? first + count - at : OBSERVATIONS;
        fill_rows(job->setup, at, some, rows);
        apply_weights(job->setup->weight + at, some, job->used, rows);
        add_products(columns, rows, sums);
    }
}

/* Predicted minus observed pixels. */
static void residuals(const struct bundle *job, size_t first, size_t count) {
    const struct procam_bundle *setup = job->setup;
    const struct device camera = device_at(setup->camera), projector = device_at(setup->projector);
    for (size_t at = first; at < first + count; at += OBSERVATIONS) {
        const size_t some = first + count - at < OBSERVATIONS ? first + count - at : OBSERVATIONS;
        struct observations s;
        struct projection projected;
        double row[ROW];
        trace_rays(setup, &camera, &projector, at, some, &s);
        project(0, setup->fisheye_projector, &projector, s.in_projector, &projected);
        error_column(setup, &projector, at, some, &projected, row);
        for (size_t i = 0; i < some; i++) {
            job->sums[2 * (at + i)] = row[i];
            job->sums[2 * (at + i) + 1] = row[OBSERVATIONS + i];
        }
    }
}
