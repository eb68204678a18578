/* Vectors of floats and of integers, in the vector types of GCC and Clang: + - * / & | ~ << >> and
   comparisons work on them as on numbers, and a number beside a vector stands for a vector of it. A
   comparison gives integers with all bits set where it holds; it fails with NaN.

       level     LANES
       AVX-512   16      F, BW, DQ, VL, VBMI
       AVX2       8      with FMA and F16C
       base       4      any processor: NEON on ARM, SSE2 on x86, plain C elsewhere

   What these types lack is written below, for each level. Minimum and maximum return their second argument
   where either is NaN, as x86 does. */
#include <float.h>
#include <math.h>
#include <string.h>

#ifdef __OPTIMIZE__
#define INLINE static inline __attribute__((always_inline))
#else /* builds with sanitizers compile much faster without inlining */
#define INLINE static inline __attribute__((unused))
#endif

#define UNROLL _Pragma("GCC unroll 8")

typedef float vf __attribute__((vector_size(4 * LANES)));
typedef int32_t vi __attribute__((vector_size(4 * LANES)));
typedef uint16_t vhalves __attribute__((vector_size(2 * LANES))); /* 16-bit numbers, also of floats */

INLINE vf vset(float a) { return a - (vf){0}; } /* 0 + a is an addition: it makes 0 of -0 */
INLINE vf vload(const float *p) {
    vf a;
    memcpy(&a, p, sizeof a);
    return a;
}
INLINE vi vload_i(const int32_t *p) {
    vi a;
    memcpy(&a, p, sizeof a);
    return a;
}
INLINE vhalves vload_halves(const uint16_t *p) {
    vhalves a;
    memcpy(&a, p, sizeof a);
    return a;
}
INLINE void vstore(float *p, vf a) { memcpy(p, &a, sizeof a); }
INLINE void vstore_i(int32_t *p, vi a) { memcpy(p, &a, sizeof a); }
INLINE void vstore_halves(uint16_t *p, vhalves a) { memcpy(p, &a, sizeof a); }
INLINE vf vfloat(vi a) { return __builtin_convertvector(a, vf); }
INLINE vi vtruncate(vf a) { return __builtin_convertvector(a, vi); } /* towards zero */
INLINE vf vsel(vi m, vf yes, vf no) { return (vf)(((m < 0) & (vi)yes) | (~(m < 0) & (vi)no)); } /* becomes one blend */
INLINE vf vabs(vf a) { return (vf)((vi)a & INT32_MAX); }

#if LANES == 16
INLINE vf vmin(vf a, vf b) { return _mm512_min_ps(a, b); }
INLINE vf vmax(vf a, vf b) { return _mm512_max_ps(a, b); }
INLINE vf vsqrt(vf a) { return _mm512_sqrt_ps(a); }
INLINE vf vfinite(vf a) { /* a digit for each of, from the last: NaN, signalling NaN, 0, 1, -inf, inf, < 0, > 0 */
    const vi replies = (vi){0} + 0x00880088; /* 0 keeps the number, 8 makes it 0 */
    return _mm512_fixupimm_ps(a, a, (__m512i)replies, 0);
}
INLINE vf vroot(vf a) { /* to 6e-5 of it; 1e-19 where `a` is negative or NaN */
    const vf positive = vmax(a, vset(FLT_MIN));
    return positive * _mm512_rsqrt14_ps(positive);
}
INLINE vf vfraction(vf a) { return _mm512_reduce_ps(a, 8); }  /* a less the nearest integer */
INLINE vf vpick(const float *table, vi at) { return _mm512_permutexvar_ps((__m512i)at, vload(table)); }
INLINE vi vlookup(const uint32_t *table, vi at) { return (vi)_mm512_i32gather_epi32((__m512i)at, table, 4); }
INLINE vi vload_u8(const uint8_t *p) { return (vi)_mm512_cvtepu8_epi32(_mm_loadu_si128((const void *)p)); }
INLINE vi vload_u16(const uint16_t *p) { return (vi)_mm512_cvtepu16_epi32(_mm256_loadu_si256((const void *)p)); }
INLINE vf vfrom_f16(vhalves a) { return _mm512_cvtph_ps((__m256i)a); }
INLINE vhalves vto_f16(vf a) { return (vhalves)_mm512_cvtps_ph(a, 0); }
INLINE void vstore_codes(uint8_t *p, const vf *a) { /* integer parts of 64 numbers, 0 to 255 */
    const __m512i order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
    const __m512i low = _mm512_packus_epi32(_mm512_cvttps_epi32(a[0]), _mm512_cvttps_epi32(a[1]));
    const __m512i high = _mm512_packus_epi32(_mm512_cvttps_epi32(a[2]), _mm512_cvttps_epi32(a[3]));
    _mm512_storeu_si512(p, _mm512_permutexvar_epi32(order, _mm512_packus_epi16(low, high)));
}
INLINE void vstream(float *p, vf a) { _mm512_stream_ps(p, a); }

#elif LANES == 8
INLINE vf vmin(vf a, vf b) { return _mm256_min_ps(a, b); }
INLINE vf vmax(vf a, vf b) { return _mm256_max_ps(a, b); }
INLINE vf vsqrt(vf a) { return _mm256_sqrt_ps(a); }
INLINE vf vfraction(vf a) { return a - _mm256_round_ps(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC); }
INLINE vf vpick(const float *table, vi at) { return _mm256_permutevar8x32_ps(vload(table), (__m256i)at); }
INLINE vi vload_u8(const uint8_t *p) { return (vi)_mm256_cvtepu8_epi32(_mm_loadl_epi64((const void *)p)); }
INLINE vi vload_u16(const uint16_t *p) { return (vi)_mm256_cvtepu16_epi32(_mm_loadu_si128((const void *)p)); }
INLINE vf vfrom_f16(vhalves a) { return _mm256_cvtph_ps((__m128i)a); }
INLINE vhalves vto_f16(vf a) { return (vhalves)_mm256_cvtps_ph(a, 0); }
INLINE void vstore_codes(uint8_t *p, const vf *a) { /* integer parts of 64 numbers, 0 to 255 */
    const __m256i order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
    for (int k = 0; k < 2; k++, a += 4) {
        const __m256i low = _mm256_packus_epi32(_mm256_cvttps_epi32(a[0]), _mm256_cvttps_epi32(a[1]));
        const __m256i high = _mm256_packus_epi32(_mm256_cvttps_epi32(a[2]), _mm256_cvttps_epi32(a[3]));
        const __m256i bytes = _mm256_permutevar8x32_epi32(_mm256_packus_epi16(low, high), order);
        _mm256_storeu_si256((void *)(p + 32 * k), bytes);
    }
}
INLINE void vstream(float *p, vf a) { _mm256_stream_ps(p, a); }

#else
INLINE vf vmin(vf a, vf b) { return vsel(a < b, a, b); }
INLINE vf vmax(vf a, vf b) { return vsel(a > b, a, b); }
INLINE vf vfraction(vf a) {
    const vf much = vset(12582912.0f); /* 1.5 * 2^23: sums with it are whole numbers */
    return a - ((a + much) - much);
}
INLINE void vstream(float *p, vf a) { vstore(p, a); }
#if defined(__ARM_NEON) && defined(__aarch64__)
INLINE vf vsqrt(vf a) { return vsqrtq_f32(a); }
INLINE vf vpick(const float *table, vi at) { /* of 8 floats: bytes 4 at .. 4 at + 3 */
    const uint8x16x2_t bytes = vld1q_u8_x2((const uint8_t *)table);
    return (vf)vqtbl2q_u8(bytes, (uint8x16_t)((at & 7) * 0x04040404 + 0x03020100));
}
INLINE vi vload_u16(const uint16_t *p) { return (vi)vmovl_u16(vld1_u16(p)); }
INLINE vi vload_u8(const uint8_t *p) {
    uint32_t word;
    memcpy(&word, p, sizeof word);
    return (vi)vmovl_u16(vget_low_u16(vmovl_u8(vcreate_u8(word))));
}
INLINE vf vfrom_f16(vhalves a) { return vcvt_f32_f16((float16x4_t)a); }
INLINE vhalves vto_f16(vf a) { return (vhalves)vcvt_f16_f32(a); }
INLINE void vstore_codes(uint8_t *p, const vf *a) { /* integer parts of 64 numbers, 0 to 255 */
    for (int k = 0; k < 8; k++) {
        const uint16x4_t low = vqmovun_s32(vtruncate(a[2 * k])), high = vqmovun_s32(vtruncate(a[2 * k + 1]));
        vst1_u8(p + 8 * k, vqmovn_u16(vcombine_u16(low, high)));
    }
}
#else
INLINE vf vsqrt(vf a) { return (vf){sqrtf(a[0]), sqrtf(a[1]), sqrtf(a[2]), sqrtf(a[3])}; }
INLINE vf vpick(const float *table, vi at) {
    at &= 7;
    return (vf){table[at[0]], table[at[1]], table[at[2]], table[at[3]]};
}
INLINE vi vload_u8(const uint8_t *p) { return (vi){p[0], p[1], p[2], p[3]}; }
INLINE vi vload_u16(const uint16_t *p) { return (vi){p[0], p[1], p[2], p[3]}; }
INLINE vf vfrom_f16(vhalves a) { /* infinity counts as NaN */
    const vi bits = __builtin_convertvector(a, vi), size = (bits & 0x7fff) << 13;
    return (vf)((vi)((vf)size * 0x1p112f) | (bits & 0x8000) << 16 | ((size >= 0x7c00 << 13) & 0x7fc00000));
}
INLINE vhalves vto_f16(vf a) { /* to nearest, ties to even */
    const vi size = (vi)a & INT32_MAX, sign = ((vi)a >> 16) & 0x8000;
    const vi small = (vi)((vf)size + 0.5f) - 0x3f000000; /* subnormal: the adder rounds */
    const vi normal = (size + 0xfff + ((size >> 13) & 1) - 0x38000000) >> 13;
    vi half = (size < 0x38800000) & small;
    half |= (size >= 0x38800000) & (size < 0x477ff000) & normal;
    half |= (size >= 0x477ff000) & 0x7c00; /* 65520 and more */
    half |= (size > 0x7f800000) & 0x200;
    return __builtin_convertvector(half | sign, vhalves);
}
INLINE void vstore_codes(uint8_t *p, const vf *a) { /* integer parts of 64 numbers, 0 to 255 */
    for (int i = 0; i < 64; i++) p[i] = (uint8_t)fminf(fmaxf(a[i / LANES][i % LANES], 0.0f), 255.0f);
}
#endif
#endif

#if LANES < 16
INLINE vf vroot(vf a) { return vsqrt(vmax(a, vset(0.0f))); } /* 0 where `a` is negative or NaN */
INLINE vf vfinite(vf a) { return vsel(vabs(a) < INFINITY, a, vset(0.0f)); } /* 0 where it is NaN or infinite */

/* AVX2's gathers are slower than loads on many processors. */
INLINE vi vlookup(const uint32_t *table, vi at) {
    vi found;
    for (int k = 0; k < LANES; k++) found[k] = (int32_t)table[at[k]];
    return found;
}
#endif

/* Makes stores that bypassed the cache visible to other threads. */
INLINE void vfence(void) {
#if LANES > 4
    _mm_sfence();
#endif
}

/* Copies, bypassing the cache where whole lines are written; 32 bytes at a time, since what was just stored in
   two halves is late as a whole. */
INLINE void vcopy(uint8_t *to, const uint8_t *from, size_t bytes) {
#if LANES > 4
    if (((uintptr_t)to | bytes) % 64 == 0) {
        for (size_t i = 0; i < bytes; i += 32)
            _mm256_stream_ps((float *)(to + i), _mm256_loadu_ps((const float *)(from + i)));
        return;
    }
#endif
    memcpy(to, from, bytes);
}

/* One vector of a picture; the kind is a constant where this is inlined. */
INLINE vf vload_kind(int kind, const void *picture, size_t at) {
    if (kind == U8) return vfloat(vload_u8((const uint8_t *)picture + at));
    if (kind == U16) return vfloat(vload_u16((const uint16_t *)picture + at));
    if (kind == F16) return vfrom_f16(vload_halves((const uint16_t *)picture + at));
    return vload((const float *)picture + at);
}

INLINE size_t bytes_of(int kind) { return kind == U8 ? 1 : kind == F32 ? 4 : 2; }

/* The last, incomplete vector of a picture, `left` pixels and zeros after them. */
INLINE vf vload_part(int kind, const void *picture, size_t at, size_t left) {
    const size_t width = bytes_of(kind);
    unsigned char room[4 * LANES] __attribute__((aligned(64))) = {0};
    memcpy(room, (const unsigned char *)picture + at * width, left * width);
    return vload_kind(kind, room, 0);
}

INLINE void vstore_part(float *plane, vf a, size_t left) { memcpy(plane, &a, left * sizeof(float)); }

/* A smooth curve at x >= 0: a cubic for each of 8 octaves of x, numbered by its exponent modulo 8.
   `pieces` (4, PIECES) holds their coefficients, the constants first, repeated to 16. x may reach into a ninth
   octave, which then shares the cubic of the first: see native/curve.py. */
INLINE vf vcurve(const float *pieces, vf x) {
    const vi number = (vi)x >> 23;
    vf value = vpick(pieces + 3 * PIECES, number);
    UNROLL for (int k = 2; k >= 0; k--) value = value * x + vpick(pieces + k * PIECES, number);
    return value;
}

/* Entries of a table of 256 for 64 codes; AVX-512 takes each byte of them from a table of its own, (4, 256). */
#if LANES == 16
INLINE __m512i bytes_looked_up(const uint8_t *table, __m512i codes) { /* by halves of the table */
    const __m512i *quarter = (const __m512i *)table;
    const __m512i low = _mm512_permutex2var_epi8(_mm512_loadu_si512(quarter), codes, _mm512_loadu_si512(quarter + 1));
    const __m512i high = _mm512_permutex2var_epi8(_mm512_loadu_si512(quarter + 2), codes, _mm512_loadu_si512(quarter + 3));
    return _mm512_mask_blend_epi8(_mm512_movepi8_mask(codes), low, high);
}
INLINE void vlook_up(const float *table, const uint8_t *bytes, const uint8_t *codes, float *to) {
    const __m512i order = _mm512_set_epi8( /* so that unpacking puts them back in turn */
        63, 62, 61, 60, 47, 46, 45, 44, 31, 30, 29, 28, 15, 14, 13, 12, 59, 58, 57, 56, 43, 42, 41, 40, 27, 26, 25, 24,
        11, 10, 9, 8, 55, 54, 53, 52, 39, 38, 37, 36, 23, 22, 21, 20, 7, 6, 5, 4, 51, 50, 49, 48, 35, 34, 33, 32, 19, 18,
        17, 16, 3, 2, 1, 0);
    const __m512i at = _mm512_permutexvar_epi8(order, _mm512_loadu_si512(codes));
    (void)table;
    const __m512i b0 = bytes_looked_up(bytes, at), b1 = bytes_looked_up(bytes + 256, at);
    const __m512i b2 = bytes_looked_up(bytes + 512, at), b3 = bytes_looked_up(bytes + 768, at);
    const __m512i low0 = _mm512_unpacklo_epi8(b0, b1), low1 = _mm512_unpacklo_epi8(b2, b3);
    const __m512i high0 = _mm512_unpackhi_epi8(b0, b1), high1 = _mm512_unpackhi_epi8(b2, b3);
    vstore(to, (vf)_mm512_unpacklo_epi16(low0, low1));
    vstore(to + 16, (vf)_mm512_unpackhi_epi16(low0, low1));
    vstore(to + 32, (vf)_mm512_unpacklo_epi16(high0, high1));
    vstore(to + 48, (vf)_mm512_unpackhi_epi16(high0, high1));
}
#else /* loads are faster than gathers on many processors, and than polynomials */
INLINE void vlook_up(const float *table, const uint8_t *bytes, const uint8_t *codes, float *to) {
    (void)bytes;
    UNROLL for (size_t k = 0; k < 64; k += 8) {
        uint32_t four[2]; /* one load, not four */
        memcpy(four, codes + k, sizeof four);
        float found[8]; /* one store, which a load of a vector can wait for */
        for (int i = 0; i < 8; i++) found[i] = table[four[i / 4] >> 8 * (i % 4) & 255];
        memcpy(to + k, found, sizeof found);
    }
}
#endif

/* Angle of (cosine, sine) in [0, 2 pi); 0 for (0, 0). */
INLINE vf vangle(vf cosine, vf sine) {
    const vf c = vabs(cosine), s = vabs(sine);
    const vf a = vmin(s, c) / vmax(vset(FLT_MIN), vmax(s, c)), y = a * a;
    vf p = vset(8.006897622e-03f); /* atan(a) / a on [0, 1] to 6e-7 */
    p = p * y - 3.744296841e-02f;
    p = p * y + 8.435407192e-02f;
    p = p * y - 1.351217460e-01f;
    p = p * y + 1.988732081e-01f;
    p = p * y - 3.332701332e-01f;
    p = p * y + 9.999994166e-01f;
    p = p * a;
    p = vsel(c < s, 1.57079632679f - p, p);
    p = vsel(cosine < 0.0f, 3.14159265359f - p, p);
    p = vsel(sine < 0.0f, 6.28318530718f - p, p);
    return vsel(p > 6.2831850f, vset(0.0f), p);
}

/* Cosine and sine of u turns, u in [-1/2, 1/2]. */
INLINE void vturn(vf u, vf *cosine, vf *sine) {
    const vf y = u * u;
    vf s = vset(7.765940826e-02f), c = vset(2.196967983e-01f); /* of half the angle: 1e-8, 5e-8 */
    s = s * y - 5.982921595e-01f;
    c = c * y - 1.331880161e+00f;
    s = s * y + 2.550077660e+00f;
    c = c * y + 4.058411914e+00f;
    s = s * y - 5.167710090e+00f;
    c = c * y - 4.934792859e+00f;
    s = (s * y + 3.141592640e+00f) * u;
    c = c * y + 9.999999535e-01f;
    const vf twice = s + s;
    *cosine = 1.0f - twice * s;
    *sine = twice * c;
}
