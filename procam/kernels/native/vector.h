/* Vectors of floats: one set of functions, implemented for each instruction set.

   LEVEL is 512 (AVX-512 F, BW, DQ, VL, VBMI), 256 (AVX2, FMA, F16C) or 1 (plain C). Minimum and maximum return
   their second argument where either is NaN, as the processor does; comparisons with NaN fail. */
#include <float.h>
#include <math.h>
#include <string.h>

#ifdef __OPTIMIZE__
#define INLINE static inline __attribute__((always_inline))
#else /* builds with sanitizers compile much faster without inlining */
#define INLINE static inline __attribute__((unused))
#endif

#define UNROLL _Pragma("GCC unroll 8")

#if LEVEL == 512
#define LANES 16
typedef __m512 vf;
typedef __mmask16 vm;
INLINE vf vset(float a) { return _mm512_set1_ps(a); }
INLINE vf vload(const float *p) { return _mm512_loadu_ps(p); }
INLINE void vstore(float *p, vf a) { _mm512_storeu_ps(p, a); }
INLINE void vstream(float *p, vf a) { _mm512_stream_ps(p, a); }
INLINE void vfence(void) { _mm_sfence(); }
INLINE vf vadd(vf a, vf b) { return _mm512_add_ps(a, b); }
INLINE vf vsub(vf a, vf b) { return _mm512_sub_ps(a, b); }
INLINE vf vmul(vf a, vf b) { return _mm512_mul_ps(a, b); }
INLINE vf vdiv(vf a, vf b) { return _mm512_div_ps(a, b); }
INLINE vf vsqrt(vf a) { return _mm512_sqrt_ps(a); }
INLINE vf vfma(vf a, vf b, vf c) { return _mm512_fmadd_ps(a, b, c); }   /* a b + c */
INLINE vf vfms(vf a, vf b, vf c) { return _mm512_fmsub_ps(a, b, c); }   /* a b - c */
INLINE vf vfnma(vf a, vf b, vf c) { return _mm512_fnmadd_ps(a, b, c); } /* c - a b */
INLINE vf vmin(vf a, vf b) { return _mm512_min_ps(a, b); }
INLINE vf vmax(vf a, vf b) { return _mm512_max_ps(a, b); }
INLINE vf vabs(vf a) { return _mm512_abs_ps(a); }
INLINE vf vfraction(vf a) { return _mm512_reduce_ps(a, 8); } /* a less the nearest integer */
INLINE vm vlt(vf a, vf b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
INLINE vm mand(vm a, vm b) { return a & b; }
INLINE int vany(vm m) { return m != 0; }
INLINE vf vsel(vm m, vf yes, vf no) { return _mm512_mask_blend_ps(m, no, yes); }
INLINE vf vload_u8(const uint8_t *p) {
    return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)p)));
}
INLINE vf vload_u16(const uint16_t *p) {
    return _mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)p)));
}

#elif LEVEL == 256
#define LANES 8
typedef __m256 vf;
typedef __m256 vm;
INLINE vf vset(float a) { return _mm256_set1_ps(a); }
INLINE vf vload(const float *p) { return _mm256_loadu_ps(p); }
INLINE void vstore(float *p, vf a) { _mm256_storeu_ps(p, a); }
INLINE void vstream(float *p, vf a) { _mm256_stream_ps(p, a); }
INLINE void vfence(void) { _mm_sfence(); }
INLINE vf vadd(vf a, vf b) { return _mm256_add_ps(a, b); }
INLINE vf vsub(vf a, vf b) { return _mm256_sub_ps(a, b); }
INLINE vf vmul(vf a, vf b) { return _mm256_mul_ps(a, b); }
INLINE vf vdiv(vf a, vf b) { return _mm256_div_ps(a, b); }
INLINE vf vsqrt(vf a) { return _mm256_sqrt_ps(a); }
INLINE vf vfma(vf a, vf b, vf c) { return _mm256_fmadd_ps(a, b, c); }
INLINE vf vfms(vf a, vf b, vf c) { return _mm256_fmsub_ps(a, b, c); }
INLINE vf vfnma(vf a, vf b, vf c) { return _mm256_fnmadd_ps(a, b, c); }
INLINE vf vmin(vf a, vf b) { return _mm256_min_ps(a, b); }
INLINE vf vmax(vf a, vf b) { return _mm256_max_ps(a, b); }
INLINE vf vabs(vf a) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a); }
INLINE vf vfraction(vf a) {
    return _mm256_sub_ps(a, _mm256_round_ps(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC));
}
INLINE vm vlt(vf a, vf b) { return _mm256_cmp_ps(a, b, _CMP_LT_OQ); }
INLINE vm mand(vm a, vm b) { return _mm256_and_ps(a, b); }
INLINE int vany(vm m) { return _mm256_movemask_ps(m) != 0; }
INLINE vf vsel(vm m, vf yes, vf no) { return _mm256_blendv_ps(no, yes, m); }
INLINE vf vload_u8(const uint8_t *p) {
    return _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_loadl_epi64((const __m128i *)p)));
}
INLINE vf vload_u16(const uint16_t *p) {
    return _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128((const __m128i *)p)));
}

#else
#define LANES 1
typedef float vf;
typedef int vm;
INLINE vf vset(float a) { return a; }
INLINE vf vload(const float *p) { return *p; }
INLINE void vstore(float *p, vf a) { *p = a; }
INLINE void vstream(float *p, vf a) { *p = a; }
INLINE void vfence(void) {}
INLINE vf vadd(vf a, vf b) { return a + b; }
INLINE vf vsub(vf a, vf b) { return a - b; }
INLINE vf vmul(vf a, vf b) { return a * b; }
INLINE vf vdiv(vf a, vf b) { return a / b; }
INLINE vf vsqrt(vf a) { return sqrtf(a); }
INLINE vf vfma(vf a, vf b, vf c) { return a * b + c; }
INLINE vf vfms(vf a, vf b, vf c) { return a * b - c; }
INLINE vf vfnma(vf a, vf b, vf c) { return c - a * b; }
INLINE vf vmin(vf a, vf b) { return a < b ? a : b; }
INLINE vf vmax(vf a, vf b) { return a > b ? a : b; }
INLINE vf vabs(vf a) { return fabsf(a); }
INLINE vf vfraction(vf a) {
    const float much = a < 0 ? -12582912.0f : 12582912.0f; /* 1.5 * 2^23: its last bit is 1 */
    return a - ((a + much) - much);
}
INLINE vm vlt(vf a, vf b) { return a < b; }
INLINE vm mand(vm a, vm b) { return a & b; }
INLINE int vany(vm m) { return m; }
INLINE vf vsel(vm m, vf yes, vf no) { return m ? yes : no; }
INLINE vf vload_u8(const uint8_t *p) { return *p; }
INLINE vf vload_u16(const uint16_t *p) { return *p; }
#endif

/* One vector of a picture; the kind is a constant where this is inlined. */
INLINE vf vload_kind(int kind, const void *picture, size_t at) {
    if (kind == U8) return vload_u8((const uint8_t *)picture + at);
    if (kind == U16) return vload_u16((const uint16_t *)picture + at);
    return vload((const float *)picture + at);
}

/* The last, incomplete vector of a picture, `left` pixels and zeros after them. */
INLINE vf vload_part(int kind, const void *picture, size_t at, size_t left) {
    const size_t width = kind == U8 ? 1 : kind == U16 ? 2 : 4;
    unsigned char room[4 * LANES] __attribute__((aligned(64))) = {0};
    memcpy(room, (const unsigned char *)picture + at * width, left * width);
    return vload_kind(kind, room, 0);
}

INLINE void vstore_part(float *plane, vf a, size_t left) {
    float room[LANES] __attribute__((aligned(64)));
    vstore(room, a);
    memcpy(plane, room, left * sizeof(float));
}

/* Angle of (cosine, sine) in [0, 2 pi); 0 for (0, 0). */
INLINE vf vangle(vf cosine, vf sine) {
    const vf zero = vset(0.0f), c = vabs(cosine), s = vabs(sine);
    const vf a = vdiv(vmin(s, c), vmax(vset(FLT_MIN), vmax(s, c)));
    const vf y = vmul(a, a);
    vf p = vset(8.006897622e-03f); /* atan(a) / a on [0, 1] to 6e-7 */
    p = vfma(p, y, vset(-3.744296841e-02f));
    p = vfma(p, y, vset(8.435407192e-02f));
    p = vfma(p, y, vset(-1.351217460e-01f));
    p = vfma(p, y, vset(1.988732081e-01f));
    p = vfma(p, y, vset(-3.332701332e-01f));
    p = vfma(p, y, vset(9.999994166e-01f));
    p = vmul(p, a);
    p = vsel(vlt(c, s), vsub(vset(1.57079632679f), p), p);
    p = vsel(vlt(cosine, zero), vsub(vset(3.14159265359f), p), p);
    p = vsel(vlt(sine, zero), vsub(vset(6.28318530718f), p), p);
    return vsel(vlt(vset(6.2831850f), p), zero, p);
}

/* Cosine and sine of u turns, u in [-1/2, 1/2]. */
INLINE void vturn(vf u, vf *cosine, vf *sine) {
    const vf y = vmul(u, u);
    vf s = vset(7.765940826e-02f), c = vset(2.196967983e-01f); /* of half the angle: 1e-8, 5e-8 */
    s = vfma(s, y, vset(-5.982921595e-01f));
    c = vfma(c, y, vset(-1.331880161e+00f));
    s = vfma(s, y, vset(2.550077660e+00f));
    c = vfma(c, y, vset(4.058411914e+00f));
    s = vfma(s, y, vset(-5.167710090e+00f));
    c = vfma(c, y, vset(-4.934792859e+00f));
    s = vmul(vfma(s, y, vset(3.141592640e+00f)), u);
    c = vfma(c, y, vset(9.999999535e-01f));
    const vf twice = vadd(s, s);
    *cosine = vfnma(twice, s, vset(1.0f));
    *sine = vmul(twice, c);
}
