/* The kernels at 16 floats a vector, for processors without AVX-512: the intrinsics that native/vector.h
   uses, in plain C by Intel's definitions. */
#include "kernels.h"

#include <float.h>
#include <immintrin.h>
#include <math.h>
#include <string.h>

union any { /* one register */
    __m512 s;
    __m512i i;
    __m256i half[2];
    float f[16];
    int32_t w[16];
    uint16_t h[32];
    uint8_t b[64];
};

#undef _mm512_setr_epi32 /* macros of some compilers */
#undef _mm512_reduce_ps
#undef _mm512_i32gather_epi32
#undef _mm512_cvtps_ph
#undef _mm512_fixupimm_ps
#undef _mm512_mask_blend_epi8

#define FUNCTION static inline __attribute__((always_inline))
#define PS(name, value) /* of floats x, y */ \
    FUNCTION __m512 name(__m512 a, __m512 b) { \
        union any r, p = {.s = a}, q = {.s = b}; \
        for (int k = 0; k < 16; k++) { \
            const float x = p.f[k], y = q.f[k]; \
            (void)y, r.f[k] = value; \
        } \
        return r.s; \
    }
PS(min_ps, x < y ? x : y)
PS(max_ps, x > y ? x : y)
PS(root, sqrtf(x))
PS(one_over_root, 1.0f / sqrtf(x))
PS(fraction, x - rintf(x))
#define _mm512_min_ps min_ps
#define _mm512_max_ps max_ps
#define _mm512_sqrt_ps(a) root(a, a)
#define _mm512_rsqrt14_ps(a) one_over_root(a, a)
#define _mm512_reduce_ps(a, mode) fraction(a, a)

/* `count` parts k of a register, from those of registers p, q and of `table`. */
#define EPI(name, part, count, value) \
    FUNCTION __m512i name(__m512i a, __m512i b, const int32_t *table) { \
        union any r, p = {.i = a}, q = {.i = b}; \
        (void)p, (void)q, (void)table; \
        for (int k = 0; k < count; k++) r.part[k] = value; \
        return r.i; \
    }
#define SATURATED(x, most) ((x) < 0 ? 0 : (x) > (most) ? (most) : (x))
#define IN_LANE(wide, k) ((k) / (wide) * (wide)) /* first of the 128 bits that part k is in */
#define PACKED(part, wide, k) ((k) % (wide) < (wide) / 2 ? p.part : q.part)[IN_LANE(wide, k) / 2 + (k) % ((wide) / 2)]
#define UNPACKED(part, wide, k, from) ((k) % 2 ? q.part : p.part)[IN_LANE(wide, k) + (from) + (k) % (wide) / 2]
EPI(permuted_words, w, 16, q.w[p.w[k] & 15])
EPI(permuted_bytes, b, 64, q.b[p.b[k] & 63])
EPI(gathered, w, 16, table[p.w[k]])
EPI(truncated, w, 16, _mm_cvttss_si32(_mm_set_ss(p.f[k])))
EPI(from_bytes, w, 16, p.b[k])
EPI(from_halves, w, 16, p.h[k])
EPI(packed_words, h, 32, SATURATED(PACKED(w, 8, k), 65535))
EPI(packed_halves, b, 64, SATURATED((int16_t)PACKED(h, 16, k), 255))
EPI(low_bytes, b, 64, UNPACKED(b, 16, k, 0))
EPI(high_bytes, b, 64, UNPACKED(b, 16, k, 8))
EPI(low_halves, h, 32, UNPACKED(h, 8, k, 0))
EPI(high_halves, h, 32, UNPACKED(h, 8, k, 4))
#define _mm512_permutexvar_epi32(at, table) permuted_words(at, table, NULL)
#define _mm512_permutexvar_ps(at, table) (__m512)permuted_words(at, (__m512i)(table), NULL)
#define _mm512_permutexvar_epi8(at, table) permuted_bytes(at, table, NULL)
#define _mm512_i32gather_epi32(at, table, scale) gathered(at, at, (const int32_t *)(table))
#define _mm512_cvttps_epi32(a) truncated((__m512i)(a), (__m512i)(a), NULL)
#define _mm512_cvtepu8_epi32(a) from_bytes(widened(_mm256_castsi128_si256(a)), widened(_mm256_castsi128_si256(a)), NULL)
#define _mm512_cvtepu16_epi32(a) from_halves(widened(a), widened(a), NULL)
#define _mm512_packus_epi32(a, b) packed_words(a, b, NULL)
#define _mm512_packus_epi16(a, b) packed_halves(a, b, NULL)
#define _mm512_unpacklo_epi8(a, b) low_bytes(a, b, NULL)
#define _mm512_unpackhi_epi8(a, b) high_bytes(a, b, NULL)
#define _mm512_unpacklo_epi16(a, b) low_halves(a, b, NULL)
#define _mm512_unpackhi_epi16(a, b) high_halves(a, b, NULL)

FUNCTION __m512i widened(__m256i a) { return (union any){.half = {a, a}}.i; }

FUNCTION __m512i loaded(const void *from) {
    union any r;
    memcpy(&r, from, sizeof r);
    return r.i;
}
FUNCTION void stored(void *to, __m512i a) { memcpy(to, &a, sizeof a); }
#define _mm512_loadu_si512 loaded
#define _mm512_storeu_si512 stored
#define _mm512_stream_ps(to, a) stored(to, (__m512i)(a))
#define _mm512_setr_epi32(...) loaded((const int32_t[16]){__VA_ARGS__})
#define _mm512_set_epi8(...) reversed((const uint8_t[64]){__VA_ARGS__})

FUNCTION __m512i reversed(const uint8_t *from) {
    union any r;
    for (int k = 0; k < 64; k++) r.b[k] = from[63 - k];
    return r.i;
}

FUNCTION __mmask64 signs(__m512i a) {
    const union any p = {.i = a};
    __mmask64 found = 0;
    for (int k = 0; k < 64; k++) found |= (__mmask64)(p.b[k] >> 7) << k;
    return found;
}
#define _mm512_movepi8_mask signs

FUNCTION __m512i blended(__mmask64 where, __m512i a, __m512i b) {
    union any r = {.i = a};
    const union any q = {.i = b};
    for (int k = 0; k < 64; k++) r.b[k] = where >> k & 1 ? q.b[k] : r.b[k];
    return r.i;
}
#define _mm512_mask_blend_epi8 blended

FUNCTION __m512i permuted_of_two(__m512i a, __m512i at, __m512i b) {
    union any r = {.i = at};
    const union any p = {.i = a}, q = {.i = b};
    for (int k = 0; k < 64; k++) r.b[k] = (r.b[k] & 64 ? q : p).b[r.b[k] & 63];
    return r.i;
}
#define _mm512_permutex2var_epi8 permuted_of_two

/* Of each number's kind `table` has what becomes of it: 0, the number of `a`; 8, zero. */
FUNCTION __m512 fixed_up(__m512 a, __m512 numbers, __m512i table) {
    union any r = {.s = a};
    const union any p = {.s = numbers}, q = {.i = table};
    for (int k = 0; k < 16; k++) {
        const float x = p.f[k];
        const int kind = isnan(x) ? !(p.w[k] & 0x400000) : x == 0 ? 2 : x == 1 ? 3 : (isinf(x) ? 4 : 6) + (x > 0);
        if ((q.w[k] >> 4 * kind & 15) == 8) r.f[k] = 0.0f;
    }
    return r.s;
}
#define _mm512_fixupimm_ps(a, numbers, table, flags) fixed_up(a, numbers, table)

FUNCTION __m512 from_f16(__m256i a) {
    union any r;
    for (int k = 0; k < 16; k++) r.f[k] = _cvtsh_ss(((union any){.half = {a, a}}).h[k]);
    return r.s;
}
FUNCTION __m256i to_f16(__m512 a) {
    union any r = {.s = a};
    for (int k = 0; k < 16; k++) r.h[k] = _cvtss_sh(r.f[k], 0); /* never ahead of what is read */
    return r.half[0];
}
#define _mm512_cvtph_ps from_f16
#define _mm512_cvtps_ph(a, mode) to_f16(a)

#define LANES 16
#include "level.h"
const struct level procam_avx512 = {search, bundle, residuals, rays, frame, scattered, warp};
