/* Phase, amplitude and offset by linear least squares: three weighted sums over the frames. */

struct sinusoid {
    vf offset, cosine, sine;
};

INLINE struct sinusoid add_frame(struct sinusoid sum, vf v, const float *weights, int count, int k,
                                 int with_offset) {
    if (with_offset) sum.offset = vfma(vset(weights[k]), v, sum.offset);
    sum.cosine = vfma(vset(weights[count + k]), v, sum.cosine);
    sum.sine = vfma(vset(weights[2 * count + k]), v, sum.sine);
    return sum;
}

INLINE vf length_of(vf cosine, vf sine) { return vsqrt(vfma(cosine, cosine, vmul(sine, sine))); }

INLINE void phase_at(int kind, int with_offset, int streamed, const struct phase *job, size_t first,
                     size_t count) {
    const size_t end = first + count, whole = end - count % LANES;
    const struct sinusoid none = {vset(0.0f), vset(0.0f), vset(0.0f)};
    for (size_t i = first; i < whole; i += LANES) {
        struct sinusoid sum = none;
        for (int k = 0; k < job->count; k++)
            sum = add_frame(sum, vload_kind(kind, job->frames[k], i), job->weights, job->count, k,
                            with_offset);
        const vf angle = vangle(sum.cosine, sum.sine), size = length_of(sum.cosine, sum.sine);
        if (streamed) {
            vstream(job->phase + i, angle);
            vstream(job->amplitude + i, size);
            if (with_offset) vstream(job->offset + i, sum.offset);
        } else {
            vstore(job->phase + i, angle);
            vstore(job->amplitude + i, size);
            if (with_offset) vstore(job->offset + i, sum.offset);
        }
    }
    if (whole < end) {
        const size_t left = end - whole;
        struct sinusoid sum = none;
        for (int k = 0; k < job->count; k++)
            sum = add_frame(sum, vload_part(kind, job->frames[k], whole, left), job->weights,
                            job->count, k, with_offset);
        vstore_part(job->phase + whole, vangle(sum.cosine, sum.sine), left);
        vstore_part(job->amplitude + whole, length_of(sum.cosine, sum.sine), left);
        if (with_offset) vstore_part(job->offset + whole, sum.offset, left);
    }
    vfence();
}

INLINE void phase_of_kind(int kind, const struct phase *job, size_t first, size_t count) {
    const uintptr_t places =
        (uintptr_t)(job->phase + first) | (uintptr_t)(job->amplitude + first) |
        (job->offset ? (uintptr_t)(job->offset + first) : 0);
    if (places % 64) /* results past the cache need whole lines */
        job->offset ? phase_at(kind, 1, 0, job, first, count)
                    : phase_at(kind, 0, 0, job, first, count);
    else
        job->offset ? phase_at(kind, 1, 1, job, first, count)
                    : phase_at(kind, 0, 1, job, first, count);
}

static void phase(const struct phase *job, size_t first, size_t count) {
    if (job->kind == U8)
        phase_of_kind(U8, job, first, count);
    else if (job->kind == U16)
        phase_of_kind(U16, job, first, count);
    else
        phase_of_kind(F32, job, first, count);
}
