/* Gray code planes: code |= (pattern > inverse) << bit; least and most of |pattern - inverse|. */

#define RESIDENT 2048 /* pixels whose state stays in the first cache while all pairs are folded in */

#define FOLD(name, type, contrast_of)                                                              \
    INLINE void name(size_t count, uint16_t set, const type *restrict p, const type *restrict q,  \
                     uint16_t *restrict code, type *restrict least, type *restrict most) {         \
        for (size_t i = 0; i < count; i++) {                                                       \
            const type contrast = contrast_of(p[i], q[i]);                                         \
            code[i] |= (uint16_t)(p[i] > q[i] ? set : 0);                                          \
            if (least) least[i] = contrast < least[i] ? contrast : least[i];                       \
            if (most) most[i] = contrast > most[i] ? contrast : most[i];                           \
        }                                                                                          \
    }                                                                                              \
    static void name##_pair(const struct fold *job, int pair, size_t first, size_t count) {        \
        const type *p = (const type *)job->pictures[2 * pair] + first;                             \
        const type *q = (const type *)job->pictures[2 * pair + 1] + first;                         \
        const uint16_t set = (uint16_t)(1u << job->bits[pair]);                                    \
        type *least = (type *)job->least, *most = (type *)job->most;                               \
        uint16_t *code = job->code + first;                                                        \
        if (least && most)                                                                         \
            name(count, set, p, q, code, least + first, most + first);                             \
        else if (least)                                                                            \
            name(count, set, p, q, code, least + first, NULL);                                     \
        else if (most)                                                                             \
            name(count, set, p, q, code, NULL, most + first);                                      \
        else                                                                                       \
            name(count, set, p, q, code, NULL, NULL);                                              \
    }

#define WHOLE_CONTRAST(a, b) ((a) > (b) ? (a) - (b) : (b) - (a))
INLINE float known_contrast(float a, float b) {
    const float difference = fabsf(a - b);
    return difference >= 0.0f ? difference : 0.0f; /* NaN counts as no contrast */
}

FOLD(fold_u8, uint8_t, WHOLE_CONTRAST)
FOLD(fold_u16, uint16_t, WHOLE_CONTRAST)
FOLD(fold_f32, float, known_contrast)

static void fold(const struct fold *job, size_t first, size_t count) {
    const size_t end = first + count, most = job->pairs > 1 ? RESIDENT : count;
    for (size_t i = first; i < end; i += most)
        for (int pair = 0; pair < job->pairs; pair++) {
            const size_t part = end - i < most ? end - i : most;
            if (job->kind == U8)
                fold_u8_pair(job, pair, i, part);
            else if (job->kind == U16)
                fold_u16_pair(job, pair, i, part);
            else
                fold_f32_pair(job, pair, i, part);
        }
}
