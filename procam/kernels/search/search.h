/* Projector columns from sinusoids of several periods: the period a pixel lies in, and where in it.

   start: offset, amplitude and phase from the base frames, which share one period.
   choose: of x, x + period, x + 2 period, ... the one with the least residual in the other frames.
   refine: Gauss-Newton steps on all frames. reference.py has the same equations. */

#define DARK 1e-4f     /* an amplitude below this share of the offset carries no phase */
#define SINGULAR 1e-5f /* least determinant of the normal matrix over the product of its diagonal */

#define BATCH 8        /* vectors that go through a stage together */

struct fit {
    vf offset, amplitude, x, margin, variance, residual;
    vi valid;
};

/* Smallest and second smallest sum of squares over the candidates. With `later` constant and small
   everything but the table of rotations is held in registers. */
INLINE void scan(int later, int candidates, const float *rotations, const vf *above, const vf *cosine,
                 const vf *sine, vf *which, vf *margin) {
    vf best = vset(INFINITY), second = best, number = vset(0.0f), found = number;
    for (int k = 0; k < candidates; k++, number += 1.0f) {
        vf sum = vset(0.0f);
#pragma GCC unroll 8
        for (int e = 0; e < later; e++, rotations += 2) {
            const vf residual = above[e] - cosine[e] * rotations[0] + sine[e] * rotations[1];
            sum += residual * residual;
        }
        found = vsel(sum < best, number, found);
        second = vmin(second, vmax(best, sum));
        best = vmin(best, sum);
    }
    *which = found;
    *margin = second - best;
}

static void scan_any(int later, int candidates, const float *rotations, const vf *above,
                     const vf *cosine, const vf *sine, vf *which, vf *margin) {
#define CASE(n)                                                                                    \
    case n: {                                                                                      \
        vf a[n], c[n], s[n];                                                                       \
        for (int e = 0; e < n; e++) a[e] = above[e], c[e] = cosine[e], s[e] = sine[e];             \
        scan(n, candidates, rotations, a, c, s, which, margin);                                        \
        break;                                                                                     \
    }
    switch (later) {
        CASE(1) CASE(2) CASE(3) CASE(4) CASE(5) CASE(6) CASE(7) CASE(8)
    default:
        scan(later, candidates, rotations, above, cosine, sine, which, margin);
    }
#undef CASE
}

/* Cosine and sine of 2 pi x / period - shift. */
INLINE void turn_at(vf x, const float *term, vf *cosine, vf *sine) {
    vturn(vfraction(x * term[FREQUENCY] - term[SHIFT]), cosine, sine);
}

/* The same for frame k: where its period is that of the frame before, by a constant rotation. */
INLINE void turn_frame(vf x, const float *term, vf *cosine, vf *sine) {
    if (term[SAME] == 0.0f) {
        turn_at(x, term, cosine, sine);
        return;
    }
    const vf c = *cosine, s = *sine;
    *cosine = c * term[COSINE] - s * term[SINE];
    *sine = s * term[COSINE] + c * term[SINE];
}

INLINE void start(const struct procam_search *setup, const vf *image, struct fit *fit) {
    vf offset = vset(0.0f), c = vset(0.0f), s = vset(0.0f);
    for (int k = 0; k < setup->base; k++) {
        offset += setup->weights[k] * image[k];
        c += setup->weights[setup->base + k] * image[k];
        s += setup->weights[2 * setup->base + k] * image[k];
    }
    const vf x = vangle(c, s) * (setup->period * 0.159154943f);
    fit->offset = offset;
    fit->amplitude = vsqrt(c * c + s * s) / setup->terms[FIRST];
    fit->x = vsel(x < 0.75f * setup->period, x, x - setup->period);
    fit->valid = DARK * vabs(offset) < fit->amplitude;
}

INLINE void choose(const struct procam_search *setup, const vf *image, struct fit *fit) {
    vf above[MOST_SEARCH], cosine[MOST_SEARCH], sine[MOST_SEARCH], which;
    const int later = setup->frames - setup->base;
    for (int e = 0; e < later; e++) {
        const float *term = setup->terms + (setup->base + e) * TERMS;
        vf c, s;
        turn_at(fit->x, term, &c, &s);
        const vf wave = fit->amplitude * term[FIRST];
        above[e] = image[setup->base + e] - fit->offset;
        cosine[e] = wave * c;
        sine[e] = wave * s;
    }
    scan_any(later, setup->candidates, setup->rotations, above, cosine, sine, &which, &fit->margin);
    fit->x += which * setup->period;
}

/* One Gauss-Newton step, or the variance and the sum of squares at the present fit. The rows of
   the design are (1, g, q = dg/dx): the normal matrix does not depend on the amplitude. Sums
   about the means do not depend on the offset, which every step computes anew. */
INLINE void refine(int harmonics, int last, const struct procam_search *setup, const vf *image,
                   struct fit *fit) {
    const vf zero = vset(0.0f);
    vf g1 = zero, q1 = zero, gg = zero, gq = zero, qq = zero;
    vf r1 = zero, rg = zero, rq = zero, rr = zero, c = zero, s = zero;
    for (int k = 0; k < setup->frames; k++) {
        const float *term = setup->terms + k * TERMS;
        turn_frame(fit->x, term, &c, &s);
        vf g = term[FIRST] * c, q = vset(term[SLOPE]);
        if (harmonics) {
            const vf twice = c + c;
            g += term[SECOND] * (twice * c - 1.0f);
            q += term[SECOND_SLOPE] * twice;
        }
        q *= s;
        const vf r = (last ? image[k] - fit->offset : image[k]) - fit->amplitude * g;
        g1 += g, q1 += q;
        gg += g * g, gq += g * q, qq += q * q;
        if (last) rr += r * r;
        else r1 += r, rg += r * g, rq += r * q;
    }
    const float share = 1.0f / (float)setup->frames;
    const vf floor = SINGULAR * (gg * qq), gm = g1 * share, qm = q1 * share;
    gg -= gm * g1, gq -= gm * q1, qq -= qm * q1;
    const vf determinant = gg * qq - gq * gq;
    fit->valid &= floor < determinant;
    const vf one = 1.0f / (determinant * fit->amplitude); /* one division instead of two */
    if (last) {
        fit->variance = gg * one / fit->amplitude;
        fit->residual = rr;
        return;
    }
    rg -= gm * r1, rq -= qm * r1;
    const vf da = (qq * rg - gq * rq) * (one * fit->amplitude);
    const vf dx = (gg * rq - gq * rg) * one, limit = vset(setup->limit);
    const vf offset = r1 * share - gm * da - qm * (dx * fit->amplitude);
    fit->amplitude = vsel(fit->valid, fit->amplitude + da, fit->amplitude);
    fit->offset = vsel(fit->valid, offset, fit->offset);
    fit->x = vsel(fit->valid, fit->x + vmin(limit, vmax(-limit, dx)), fit->x);
    fit->valid &= DARK * vabs(fit->offset) < fit->amplitude;
}

/* A batch of vectors goes through one stage after the other: vectors of a stage are independent, so
   that the processor overlaps them. */
INLINE void search_batch(int harmonics, const struct procam_search *setup, int vectors,
                         vf image[BATCH][MOST_SEARCH], struct fit *fit) {
    for (int v = 0; v < vectors; v++) start(setup, image[v], fit + v);
    for (int v = 0; v < vectors; v++) choose(setup, image[v], fit + v);
    for (int step = 0; step < setup->steps; step++)
        for (int v = 0; v < vectors; v++) refine(harmonics, 0, setup, image[v], fit + v);
    for (int v = 0; v < vectors; v++) refine(harmonics, 1, setup, image[v], fit + v);
}

INLINE void results_of(const struct fit *fit, const vf *image, int frames, vf *results) {
    vf sum = image[0];
    for (int k = 1; k < frames; k++) sum += image[k];
    const vi known = vabs(sum) < INFINITY;
    const vf unknown = vset(NAN);
    results[0] = vsel(known & fit->valid, fit->x, unknown);
    results[1] = vsel(known & fit->valid, fit->variance, unknown);
    results[2] = vsel(known, fit->amplitude, unknown);
    results[3] = vsel(known, fit->offset, unknown);
    results[4] = vsel(known, fit->residual, unknown);
    results[5] = vsel(known, fit->margin, unknown);
}

INLINE void search_at(int kind, int harmonics, const struct search *job, size_t first,
                      size_t count) {
    uintptr_t positions = 0; /* stores that bypass the cache need whole lines */
    for (int r = 0; r < RESULTS; r++) positions |= (uintptr_t)(job->results[r] + first);
    const int streamed = positions % 64 == 0;
    const int frames = job->setup->frames;
    const size_t end = first + count;
    vf image[BATCH][MOST_SEARCH], results[RESULTS];
    struct fit fit[BATCH];
    for (size_t i = first; i < end; i += BATCH * LANES) {
        const size_t pixels = end - i < BATCH * LANES ? end - i : BATCH * LANES;
        const int whole = (int)(pixels / LANES), vectors = (int)((pixels + LANES - 1) / LANES);
        for (int v = 0; v < vectors; v++)
            for (int k = 0; k < frames; k++)
                image[v][k] = v < whole ? vload_kind(kind, job->frames[k], i + v * LANES)
                                        : vload_part(kind, job->frames[k], i + v * LANES,
                                                     pixels % LANES);
        search_batch(harmonics, job->setup, vectors, image, fit);
        for (int v = 0; v < vectors; v++) {
            results_of(fit + v, image[v], frames, results);
            for (int r = 0; r < RESULTS; r++)
                if (v >= whole)
                    vstore_part(job->results[r] + i + v * LANES, results[r], pixels % LANES);
                else if (streamed)
                    vstream(job->results[r] + i + v * LANES, results[r]);
                else
                    vstore(job->results[r] + i + v * LANES, results[r]);
        }
    }
    vfence();
}

static void search(const struct search *job, size_t first, size_t count) {
#define RUN(kind)                                                                                  \
    (job->setup->harmonics ? search_at(kind, 1, job, first, count)                                   \
                         : search_at(kind, 0, job, first, count))
    if (job->kind == U8)
        RUN(U8);
    else if (job->kind == U16)
        RUN(U16);
    else
        RUN(F32);
#undef RUN
}
