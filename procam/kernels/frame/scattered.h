/* Scattered light at the nodes of a dome: the field `spread` times a polynomial of the direction.

   Its constant, linear and quadratic terms are those of frame/reference.py: monomials. */

enum { RUN = 128 };        /* nodes at a time */
#define GOLDEN 2654435761u /* 2^32 over the golden ratio: its multiples are uniform modulo 2^32 */

INLINE void polynomials_of(int terms, const double *n, const float *x, const float *y, const float *z, size_t count,
                           double *to) {
    for (size_t i = 0; i < count; i++) {
        const double e = x[i], f = y[i], g = z[i];
        for (int c = 0; c < 3; c++) {
            const double *m = n + c * FRAME_TERMS;
            double sum = m[0];
            if (terms > 1) sum += m[1] * e + m[2] * f + m[3] * g;
            if (terms > 4)
                sum += m[4] * (e * f) + m[5] * (f * g) + m[6] * (e * g) + m[7] * (e * e - f * f) + m[8] * (g * g);
            to[3 * i + (size_t)c] = sum;
        }
    }
}

/* The polynomials of three colours (3, FRAME_TERMS) of directions: (count, 3). */
INLINE void polynomials(int terms, const double *n, const float *x, const float *y, const float *z, size_t count,
                        double *to) {
    if (terms == 1) polynomials_of(1, n, x, y, z, count, to);
    else if (terms == 4) polynomials_of(4, n, x, y, z, count, to);
    else polynomials_of(9, n, x, y, z, count, to);
}

/* Rounds light to single precision with a dither of up to half a step of white, by `turn`. Without it a
   uniform field would have the same rounding error everywhere, and its sum the same relative error.
   The dither of faint light is smaller, 2^-8 of it. */
INLINE float rounded(double light, uint32_t turn) {
    const double share = (double)(int32_t)turn * 0x1p-31;
    const double most = fabs(light) * 0x1p-8;
    return (float)(light + share * (most < 0x1p-24 ? most : 0x1p-24));
}

/* Scattered light of some node rows, plus the lamps, less a second polynomial. */
static void scattered(const struct scattered *job, size_t first, size_t count) {
    const size_t nodes = (size_t)job->nodes, plane = nodes * nodes, end = (first + count) * nodes;
    const float *const ambient = job->ambient;
    const int minus = job->offset != NULL;
    double scaled[3 * RUN], off[3 * RUN];
    for (size_t at = first * nodes; at < end; at += RUN) {
        const size_t run = end - at < RUN ? end - at : RUN;
        const float *x = job->direction + at, *y = x + plane, *z = y + plane;
        const float *spread = job->spread + 3 * at;
        float *light = job->light + 3 * at;
        polynomials(job->terms, job->coefficients, x, y, z, run, scaled);
        if (minus) polynomials(job->terms, job->offset, x, y, z, run, off);
        for (size_t i = 0; i < 3 * run; i++) {
            double sum = scaled[i] * spread[i];
            if (ambient) sum += ambient[3 * at + i];
            if (minus) sum -= off[i];
            light[i] = rounded(sum, (uint32_t)(3 * at + i) * GOLDEN);
        }
    }
}
