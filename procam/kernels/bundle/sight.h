/* From a camera's rays over a round screen into a projector's frame, SIGHTS observations at a time.

   Every coordinate has an array of its own, so that the compiler puts neighbours into one vector. */

#define SIGHTS 64 /* observations at a time: their rows stay in the second cache, mostly the first */
#define ROW (2 * SIGHTS) /* of x, then of y of the projector's pixel */
#define FAR_STEPS 3      /* from near the screen onto it, as STEPS of reference_bundle.py */
#define EACH for (int i = 0; i < SIGHTS; i++)

typedef double lane[SIGHTS] __attribute__((aligned(64)));

struct placed { /* a device, read from PLACED numbers */
    double turn[9], shift[3], lens[9], pupil[2];
};

struct sight { /* in the camera's frame: ray, start (on the view's axis); in the dome's: the rest */
    lane ray[3], start, angle2, origin[3], direction[3], point[3], outward[3];
    lane level, off[3]; /* sum of the bumps; from the start of the relief to the point's direction */
    lane there[3];      /* the point in the projector's frame */
};

INLINE struct placed placed_at(const double *numbers) {
    struct placed device;
    memcpy(&device, numbers, sizeof device);
    return device;
}

/* atan2 for across >= 0, to a rounding (Moshier's Cephes: one division into [0, 1], one about pi/4). */
INLINE double angle_off(double across, double ahead) {
    const double depth = fabs(ahead), least = across < depth ? across : depth;
    const double most = across < depth ? depth : across;
    const double ratio = least / (most > DBL_MIN ? most : DBL_MIN);
    const double x = ratio > 0.66 ? (ratio - 1.0) / (ratio + 1.0) : ratio, z = x * x;
    const double above =
        -6.485021904942025371773e1 +
        z * (-1.228866684490136173410e2 +
             z * (-7.500855792314704667340e1 +
                  z * (-1.615753718733365076637e1 + z * -8.750608600031904122785e-1)));
    const double below =
        1.945506571482613964425e2 +
        z * (4.853903996359136964868e2 +
             z * (4.328810604912902668951e2 +
                  z * (1.650270098316988542046e2 + z * (2.485846490142306297962e1 + z))));
    const double small = x + x * z * (above / below);
    const double half = ratio > 0.66 ? 0.785398163397448309616 + small : small;
    const double front = across < depth ? half : 1.57079632679489661923 - half;
    return ahead < 0.0 ? 3.14159265358979323846 - front : front;
}

/* Rays of `count` observations from `first` on, in both frames; those that lack are made up. */
INLINE void send(const struct procam_bundle *job, const struct placed *camera, size_t first,
                 size_t count, struct sight *s) {
    for (size_t i = 0; i < count; i++)
        for (int j = 0; j < 3; j++) s->ray[j][i] = job->rays[3 * (first + i) + j];
    for (size_t i = count; i < SIGHTS; i++) s->ray[0][i] = s->ray[1][i] = 0.0, s->ray[2][i] = 1.0;
    const struct placed c = *camera;
    EACH {
        const double x = s->ray[0][i], y = s->ray[1][i], z = s->ray[2][i];
        const double theta = angle_off(sqrt(x * x + y * y), z), t2 = theta * theta;
        const double start = t2 * (c.pupil[0] + t2 * c.pupil[1]), ahead = start - c.shift[2];
        s->angle2[i] = t2;
        s->start[i] = start;
        s->direction[0][i] = c.turn[0] * x + c.turn[3] * y + c.turn[6] * z;
        s->direction[1][i] = c.turn[1] * x + c.turn[4] * y + c.turn[7] * z;
        s->direction[2][i] = c.turn[2] * x + c.turn[5] * y + c.turn[8] * z;
        s->origin[0][i] = c.turn[6] * ahead - c.turn[0] * c.shift[0] - c.turn[3] * c.shift[1];
        s->origin[1][i] = c.turn[7] * ahead - c.turn[1] * c.shift[0] - c.turn[4] * c.shift[1];
        s->origin[2][i] = c.turn[8] * ahead - c.turn[2] * c.shift[0] - c.turn[5] * c.shift[1];
    }
}

/* Where the rays meet the sphere: the far root, NaN where there is none. */
INLINE void meet_sphere(double radius, struct sight *s) {
    const double one = 1.0 / radius;
    EACH {
        const double x = s->origin[0][i], y = s->origin[1][i], z = s->origin[2][i];
        const double u = s->direction[0][i], v = s->direction[1][i], w = s->direction[2][i];
        const double along = x * u + y * v + z * w;
        const double reach = sqrt(along * along - (x * x + y * y + z * z - radius * radius)) - along;
        s->point[0][i] = x + reach * u;
        s->point[1][i] = y + reach * v;
        s->point[2][i] = z + reach * w;
        s->outward[0][i] = s->point[0][i] * one;
        s->outward[1][i] = s->point[1][i] * one;
        s->outward[2][i] = s->point[2][i] * one;
        s->level[i] = 0.0;
    }
}

/* Where the rays meet a screen whose height goes on as its tangent at `start` does, from there on. */
INLINE void meet_relief(const struct procam_bundle *job, size_t first, size_t count,
                        struct sight *s) {
    const int waves = job->waves;
    const double radius = job->radius;
    lane start[3] = {{0}}, slope[3] = {{0}}, base = {0};
    for (size_t i = 0; i < count; i++) {
        const double *values = job->values + waves * (first + i);
        const double *slopes = job->slopes + 3 * waves * (first + i);
        double level = 0.0, x = 0.0, y = 0.0, z = 0.0;
        for (int k = 0; k < waves; k++) {
            level += job->bumps[k] * values[k];
            x += job->bumps[k] * slopes[3 * k];
            y += job->bumps[k] * slopes[3 * k + 1];
            z += job->bumps[k] * slopes[3 * k + 2];
        }
        base[i] = level, slope[0][i] = x, slope[1][i] = y, slope[2][i] = z;
        for (int j = 0; j < 3; j++) start[j][i] = job->start[3 * (first + i) + j];
    }
    EACH {
        const double x = s->origin[0][i], y = s->origin[1][i], z = s->origin[2][i];
        const double u = s->direction[0][i], v = s->direction[1][i], w = s->direction[2][i];
        const double far = radius * (1.0 + base[i]);
        const double reach = (far * start[0][i] - x) * u + (far * start[1][i] - y) * v +
                             (far * start[2][i] - z) * w;
        const double ahead = reach > 0.0 ? reach : (double)NAN;
        s->point[0][i] = x + ahead * u;
        s->point[1][i] = y + ahead * v;
        s->point[2][i] = z + ahead * w;
    }
    for (int step = 0; step < FAR_STEPS; step++) EACH {
            const double x = s->point[0][i], y = s->point[1][i], z = s->point[2][i];
            const double a = slope[0][i], b = slope[1][i], c = slope[2][i];
            const double distance = sqrt(x * x + y * y + z * z), one = 1.0 / distance;
            const double ex = x * one, ey = y * one, ez = z * one;
            const double along = a * ex + b * ey + c * ez, tilt = radius * one;
            const double level =
                base[i] + along - a * start[0][i] - b * start[1][i] - c * start[2][i];
            const double nx = ex - tilt * (a - along * ex), ny = ey - tilt * (b - along * ey);
            const double nz = ez - tilt * (c - along * ez);
            const double u = s->direction[0][i], v = s->direction[1][i], w = s->direction[2][i];
            const double back = (distance - radius * (1.0 + level)) / (nx * u + ny * v + nz * w);
            s->outward[0][i] = nx, s->outward[1][i] = ny, s->outward[2][i] = nz;
            s->level[i] = level;
            s->off[0][i] = ex - start[0][i];
            s->off[1][i] = ey - start[1][i];
            s->off[2][i] = ez - start[2][i];
            s->point[0][i] = x - back * u;
            s->point[1][i] = y - back * v;
            s->point[2][i] = z - back * w;
        }
}

/* From the rays to points in the projector's frame. */
INLINE void light(const struct procam_bundle *job, const struct placed *camera,
                  const struct placed *projector, size_t first, size_t count, struct sight *s) {
    send(job, camera, first, count, s);
    if (job->waves)
        meet_relief(job, first, count, s);
    else
        meet_sphere(job->radius, s);
    const struct placed p = *projector;
    EACH {
        const double x = s->point[0][i], y = s->point[1][i], z = s->point[2][i];
        s->there[0][i] = p.turn[0] * x + p.turn[1] * y + p.turn[2] * z + p.shift[0];
        s->there[1][i] = p.turn[3] * x + p.turn[4] * y + p.turn[5] * z + p.shift[1];
        s->there[2][i] = p.turn[6] * x + p.turn[7] * y + p.turn[8] * z + p.shift[2];
    }
}
