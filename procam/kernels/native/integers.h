/* Vectors of 32-bit integers to go with the floats of vector.h, small tables held in registers, and
   pixels of three bytes. */

#if LEVEL == 512
typedef __m512i vi;
INLINE vi vset_i(int32_t a) { return _mm512_set1_epi32(a); }
INLINE vi vload_i(const int32_t *p) { return _mm512_loadu_si512(p); }
INLINE void vstore_i(int32_t *p, vi a) { _mm512_storeu_si512(p, a); }
INLINE vi vadd_i(vi a, vi b) { return _mm512_add_epi32(a, b); }
INLINE vi vsub_i(vi a, vi b) { return _mm512_sub_epi32(a, b); }
INLINE vi vmul_i(vi a, vi b) { return _mm512_mullo_epi32(a, b); }
INLINE vi vand_i(vi a, vi b) { return _mm512_and_si512(a, b); }
INLINE vi vshift(vi a, int by) { return _mm512_srli_epi32(a, (unsigned)by); }
INLINE vi vtruncate(vf a) { return _mm512_cvttps_epi32(a); } /* towards zero */
INLINE vf vfloat(vi a) { return _mm512_cvtepi32_ps(a); }
INLINE vi vbits(vf a) { return _mm512_castps_si512(a); }
INLINE vi vlookup(const uint32_t *table, vi at) { return _mm512_i32gather_epi32(at, table, 4); }
/* Entries of a window of 32 floats, by the low 5 bits of an index. */
struct window {
    vf low, high;
};
INLINE struct window window_at(const float *of) { return (struct window){vload(of), vload(of + 16)}; }
INLINE vf vpick(struct window of, vi at) { return _mm512_permutex2var_ps(of.low, at, of.high); }
/* The low 32 bits of 64-bit integers shifted right by `by`. */
INLINE vi vlow_half(const uint64_t *p, int by) {
    const vi even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
    const vi a = _mm512_srli_epi64(_mm512_loadu_si512(p), (unsigned)by);
    const vi b = _mm512_srli_epi64(_mm512_loadu_si512(p + 8), (unsigned)by);
    return _mm512_permutex2var_epi32(a, even, b);
}
/* Light of the byte at bit `from`: 32 parabolas are faster than a table of 256. */
INLINE vf vdecoded(const float *decode, const float *curve, vi word, int from) {
    const vi part = vshift(word, from + 3);
    const vf code = vfloat(vand_i(vshift(word, from), vset_i(255)));
    const vf a = vpick(window_at(curve), part), b = vpick(window_at(curve + 32), part);
    const vf c = vpick(window_at(curve + 64), part);
    (void)decode;
    return vfma(vfma(c, code, b), code, a);
}
INLINE void vstore_bytes(uint8_t *p, vi red, vi green, vi blue) { /* writes 64 bytes */
    const vi word = _mm512_or_si512(
        red, _mm512_or_si512(_mm512_slli_epi32(green, 8), _mm512_slli_epi32(blue, 16)));
    const vi dense = _mm512_shuffle_epi8(
        word, _mm512_broadcast_i32x4(
                  _mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1)));
    const vi order = _mm512_setr_epi32(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 3, 3, 3, 3);
    _mm512_storeu_si512(p, _mm512_permutexvar_epi32(order, dense));
}

#elif LEVEL == 256
typedef __m256i vi;
INLINE vi vset_i(int32_t a) { return _mm256_set1_epi32(a); }
INLINE vi vload_i(const int32_t *p) { return _mm256_loadu_si256((const __m256i *)p); }
INLINE void vstore_i(int32_t *p, vi a) { _mm256_storeu_si256((__m256i *)p, a); }
INLINE vi vadd_i(vi a, vi b) { return _mm256_add_epi32(a, b); }
INLINE vi vsub_i(vi a, vi b) { return _mm256_sub_epi32(a, b); }
INLINE vi vmul_i(vi a, vi b) { return _mm256_mullo_epi32(a, b); }
INLINE vi vand_i(vi a, vi b) { return _mm256_and_si256(a, b); }
INLINE vi vshift(vi a, int by) { return _mm256_srli_epi32(a, by); }
INLINE vi vtruncate(vf a) { return _mm256_cvttps_epi32(a); }
INLINE vf vfloat(vi a) { return _mm256_cvtepi32_ps(a); }
INLINE vi vbits(vf a) { return _mm256_castps_si256(a); }
INLINE vi vlookup(const uint32_t *table, vi at) {
    return _mm256_i32gather_epi32((const int *)table, at, 4);
}
struct window {
    const float *of;
};
INLINE struct window window_at(const float *of) { return (struct window){of}; }
INLINE vf vpick(struct window window, vi at) { return _mm256_i32gather_ps(window.of, vand_i(at, vset_i(31)), 4); }
INLINE vi vlow_half(const uint64_t *p, int by) {
    const vi a = _mm256_srli_epi64(_mm256_loadu_si256((const __m256i *)p), by);
    const vi b = _mm256_srli_epi64(_mm256_loadu_si256((const __m256i *)(p + 4)), by);
    const __m256 low = _mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), 0x88);
    return _mm256_permute4x64_epi64(_mm256_castps_si256(low), 0xd8);
}
INLINE vf vdecoded(const float *decode, const float *curve, vi word, int from) {
    (void)curve;
    return _mm256_i32gather_ps(decode, vand_i(vshift(word, from), vset_i(255)), 4);
}
INLINE void vstore_bytes(uint8_t *p, vi red, vi green, vi blue) { /* writes 32 bytes */
    const vi word = _mm256_or_si256(
        red, _mm256_or_si256(_mm256_slli_epi32(green, 8), _mm256_slli_epi32(blue, 16)));
    const vi dense = _mm256_shuffle_epi8(
        word, _mm256_broadcastsi128_si256(
                  _mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1)));
    const vi order = _mm256_setr_epi32(0, 1, 2, 4, 5, 6, 3, 3);
    _mm256_storeu_si256((__m256i *)p, _mm256_permutevar8x32_epi32(dense, order));
}

#else
typedef int32_t vi;
INLINE vi vset_i(int32_t a) { return a; }
INLINE vi vload_i(const int32_t *p) { return *p; }
INLINE void vstore_i(int32_t *p, vi a) { *p = a; }
INLINE vi vadd_i(vi a, vi b) { return a + b; }
INLINE vi vsub_i(vi a, vi b) { return a - b; }
INLINE vi vmul_i(vi a, vi b) { return a * b; }
INLINE vi vand_i(vi a, vi b) { return a & b; }
INLINE vi vshift(vi a, int by) { return (vi)((uint32_t)a >> by); }
INLINE vi vtruncate(vf a) { return (vi)a; }
INLINE vf vfloat(vi a) { return (vf)a; }
INLINE vi vbits(vf a) {
    vi bits;
    memcpy(&bits, &a, sizeof bits);
    return bits;
}
INLINE vi vlookup(const uint32_t *table, vi at) { return (vi)table[at]; }
struct window {
    const float *of;
};
INLINE struct window window_at(const float *of) { return (struct window){of}; }
INLINE vf vpick(struct window window, vi at) { return window.of[at & 31]; }
INLINE vi vlow_half(const uint64_t *p, int by) { return (vi)(uint32_t)(*p >> by); }
INLINE vf vdecoded(const float *decode, const float *curve, vi word, int from) {
    (void)curve;
    return decode[vshift(word, from) & 255];
}
INLINE void vstore_bytes(uint8_t *p, vi red, vi green, vi blue) {
    p[0] = (uint8_t)red, p[1] = (uint8_t)green, p[2] = (uint8_t)blue;
}
#endif

typedef float quad __attribute__((vector_size(16)));
typedef int32_t int_quad __attribute__((vector_size(16)));

/* Four 16-bit numbers. */
INLINE int_quad quad_u16(const uint16_t *p) {
#if LEVEL > 1
    return (int_quad)_mm_cvtepu16_epi32(_mm_loadl_epi64((const __m128i *)p));
#else
    return (int_quad){p[0], p[1], p[2], p[3]};
#endif
}

/* Copies, bypassing the cache where whole lines are written; `from` is aligned. */
INLINE void vcopy(uint8_t *to, const uint8_t *from, size_t bytes) {
    if (LEVEL == 1 || ((uintptr_t)to | bytes) % 64) {
        memcpy(to, from, bytes);
        return;
    }
    for (size_t i = 0; i < bytes; i += sizeof(vf))
        vstream((float *)(to + i), vload((const float *)(from + i)));
}
