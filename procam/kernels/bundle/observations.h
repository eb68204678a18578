/* From a camera's rays to points in a projector's frame, OBSERVATIONS observations at a time.

       camera o----- ray -----> point on the screen -----> projector o

   Every coordinate is an array of its own, so that the compiler puts neighbours into one vector. */

#define OBSERVATIONS 64 /* observations at a time: their rows fit the L2 cache */
#define ROW (2 * OBSERVATIONS) /* derivatives of x, then of y of the projector's pixel */
#define FAR_STEPS 3      /* Newton steps from near the screen onto it, as STEPS of reference.py */
#define EACH for (int i = 0; i < OBSERVATIONS; i++)

typedef double lane[OBSERVATIONS] __attribute__((aligned(64)));

struct device { /* a device, read from DEVICE_NUMBERS numbers */
    double rotation[9], translation[3], lens[9], pupil[2];
};

struct observations { /* ray, start (along the optical axis): camera frame; the rest: dome frame */
    lane ray[3], start, angle2, origin[3], direction[3], point[3], outward[3];
    lane level, offset[3]; /* relative height of the screen; from the start of the derivatives to the point's direction */
    lane in_projector[3];      /* the point in the projector's frame */
};

INLINE struct device device_at(const double *numbers) {
    struct device device;
    memcpy(&device, numbers, sizeof device);
    return device;
}

/* atan2 for across >= 0, correct to rounding (Moshier's Cephes: one division into [0, 1], one about pi/4). */
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

/* Rays of `count` observations from `first` on, in both frames; the rest are filled with the axis. */
INLINE void cast_rays(const struct procam_bundle *job, const struct device *camera, size_t first,
                 size_t count, struct observations *s) {
    for (size_t i = 0; i < count; i++)
        for (int j = 0; j < 3; j++) s->ray[j][i] = job->rays[3 * (first + i) + j];
    for (size_t i = count; i < OBSERVATIONS; i++) s->ray[0][i] = s->ray[1][i] = 0.0, s->ray[2][i] = 1.0;
    const struct device c = *camera;
    EACH {
        const double x = s->ray[0][i], y = s->ray[1][i], z = s->ray[2][i];
        const double theta = angle_off(sqrt(x * x + y * y), z), t2 = theta * theta;
        const double start = t2 * (c.pupil[0] + t2 * c.pupil[1]), ahead = start - c.translation[2];
        s->angle2[i] = t2;
        s->start[i] = start;
        s->direction[0][i] = c.rotation[0] * x + c.rotation[3] * y + c.rotation[6] * z;
        s->direction[1][i] = c.rotation[1] * x + c.rotation[4] * y + c.rotation[7] * z;
        s->direction[2][i] = c.rotation[2] * x + c.rotation[5] * y + c.rotation[8] * z;
        s->origin[0][i] = c.rotation[6] * ahead - c.rotation[0] * c.translation[0] - c.rotation[3] * c.translation[1];
        s->origin[1][i] = c.rotation[7] * ahead - c.rotation[1] * c.translation[0] - c.rotation[4] * c.translation[1];
        s->origin[2][i] = c.rotation[8] * ahead - c.rotation[2] * c.translation[0] - c.rotation[5] * c.translation[1];
    }
}

/* Where the rays meet the sphere: the far root, NaN where there is none. */
INLINE void meet_sphere(double radius, struct observations *s) {
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

/* Where the rays meet a screen whose height is linear around `start`. */
INLINE void meet_screen(const struct procam_bundle *job, size_t first, size_t count,
                        struct observations *s) {
    const int harmonics = job->harmonics;
    const double radius = job->radius;
    lane start[3] = {{0}}, slope[3] = {{0}}, base = {0};
    for (size_t i = 0; i < count; i++) {
        const double *values = job->values + harmonics * (first + i);
        const double *slopes = job->slopes + 3 * harmonics * (first + i);
        double level = 0.0, x = 0.0, y = 0.0, z = 0.0;
        for (int k = 0; k < harmonics; k++) {
            level += job->coefficients[k] * values[k];
            x += job->coefficients[k] * slopes[3 * k];
            y += job->coefficients[k] * slopes[3 * k + 1];
            z += job->coefficients[k] * slopes[3 * k + 2];
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
            s->offset[0][i] = ex - start[0][i];
            s->offset[1][i] = ey - start[1][i];
            s->offset[2][i] = ez - start[2][i];
            s->point[0][i] = x - back * u;
            s->point[1][i] = y - back * v;
            s->point[2][i] = z - back * w;
        }
}

/* From the rays to points in the projector's frame. */
INLINE void trace_rays(const struct procam_bundle *job, const struct device *camera,
                  const struct device *projector, size_t first, size_t count, struct observations *s) {
    cast_rays(job, camera, first, count, s);
    if (job->harmonics)
        meet_screen(job, first, count, s);
    else
        meet_sphere(job->radius, s);
    const struct device p = *projector;
    EACH {
        const double x = s->point[0][i], y = s->point[1][i], z = s->point[2][i];
        s->in_projector[0][i] = p.rotation[0] * x + p.rotation[1] * y + p.rotation[2] * z + p.translation[0];
        s->in_projector[1][i] = p.rotation[3] * x + p.rotation[4] * y + p.rotation[5] * z + p.translation[1];
        s->in_projector[2][i] = p.rotation[6] * x + p.rotation[7] * y + p.rotation[8] * z + p.translation[2];
    }
}
