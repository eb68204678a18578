/* What bounces to the nodes of a dome: a polynomial of the direction, painted. */

enum { RUN = 128 }; /* nodes at a time */

struct monomials {
    double of[FRAME_TERMS - 1][RUN]; /* all but 1 */
};

INLINE void monomials(const float *x, const float *y, const float *z, int terms, size_t count,
                      struct monomials *m) {
    for (size_t i = 0; terms > 1 && i < count; i++) m->of[0][i] = x[i], m->of[1][i] = y[i], m->of[2][i] = z[i];
    for (size_t i = 0; terms > 4 && i < count; i++) {
        const double e = m->of[0][i], f = m->of[1][i], g = m->of[2][i];
        m->of[3][i] = e * f, m->of[4][i] = f * g, m->of[5][i] = e * g;
        m->of[6][i] = e * e - f * f, m->of[7][i] = g * g;
    }
}

INLINE void polynomial(const double *n, int terms, const struct monomials *m, size_t count, double *to) {
    for (size_t i = 0; i < count; i++) to[i] = n[0];
    for (size_t i = 0; terms > 1 && i < count; i++)
        to[i] += n[1] * m->of[0][i] + n[2] * m->of[1][i] + n[3] * m->of[2][i];
    for (size_t i = 0; terms > 4 && i < count; i++)
        to[i] += n[4] * m->of[3][i] + n[5] * m->of[4][i] + n[6] * m->of[5][i] + n[7] * m->of[6][i] +
                 n[8] * m->of[7][i];
}

/* The polynomials of three colours (3, FRAME_TERMS): (count, 3). */
INLINE void polynomials(const double *n, int terms, const struct monomials *m, size_t count, double *to) {
    double r[RUN], s[RUN], t[RUN];
    polynomial(n, terms, m, count, r);
    polynomial(n + FRAME_TERMS, terms, m, count, s);
    polynomial(n + 2 * FRAME_TERMS, terms, m, count, t);
    for (size_t i = 0; i < count; i++) to[3 * i] = r[i], to[3 * i + 1] = s[i], to[3 * i + 2] = t[i];
}

/* Light of double precision to single, off by up to half a step of white, by the value's number: what is
   the same everywhere must not be rounded the same way everywhere, for its sum would be off by as much.
   The faintest light is off by less, 2^-8 of itself. */
INLINE float rounded(double light, size_t value) {
    const double share = (double)(int32_t)((uint32_t)value * 2654435761u) * 0x1p-31;
    const double most = fabs(light) * 0x1p-8;
    return (float)(light + share * (most < 0x1p-24 ? most : 0x1p-24));
}

/* What bounces to the nodes of some rows; lamps on top, a second polynomial taken off. */
static void bounce(const struct bounce *job, size_t first, size_t count) {
    const size_t nodes = (size_t)job->nodes, plane = nodes * nodes, end = (first + count) * nodes;
    for (size_t at = first * nodes; at < end; at += RUN) {
        const size_t run = end - at < RUN ? end - at : RUN;
        const float *x = job->direction + at, *y = x + plane, *z = y + plane;
        const float *spread = job->spread + 3 * at;
        float *light = job->light + 3 * at;
        double painted[3 * RUN], more[3 * RUN] = {0};
        struct monomials terms;
        monomials(x, y, z, job->terms, run, &terms);
        polynomials(job->numbers, job->terms, &terms, run, painted);
        if (job->offset) polynomials(job->offset, job->terms, &terms, run, more);
        for (size_t i = 0; job->ambient && i < 3 * run; i++) more[i] = job->ambient[3 * at + i] - more[i];
        const double sign = job->ambient ? 1 : -1;
        for (size_t i = 0; i < 3 * run; i++)
            light[i] = rounded(spread[i] * painted[i] + sign * more[i], 3 * at + i);
    }
}
