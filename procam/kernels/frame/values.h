/* Values of dome masters as they are stored, to and from linear light: 64 at a time.

   8-bit codes are decoded by a table and encoded by parabolas in the root of the light, with dither.
   Results bypass the cache where they are aligned. */

enum { FRAME_BLOCK = 64, VECTORS = FRAME_BLOCK / LANES };
enum { SEGMENTS = 32, TILE_WIDTH = 192, TILE_ROWS = 64 };
#define WRITTEN_BLACK 0x1p-30f /* light written as black: the parabolas start at its root */

#if LEVEL == 512
struct codes { /* and in which quarters of a table they lie */
    __m512i of;
    __mmask64 odd, upper, last;
};

INLINE struct codes codes_of(__m512i of) {
    struct codes codes = {.of = of, .upper = _mm512_movepi8_mask(of)};
    codes.odd = _mm512_movepi8_mask(_mm512_add_epi8(of, of));
    codes.last = codes.odd & codes.upper;
    return codes;
}

INLINE __m512i looked_up(const uint8_t *table, const struct codes *codes) { /* table of 256 */
    __m512i found = _mm512_permutexvar_epi8(codes->of, _mm512_loadu_si512(table));
    found = _mm512_mask_permutexvar_epi8(found, codes->odd, codes->of, _mm512_loadu_si512(table + 64));
    found = _mm512_mask_permutexvar_epi8(found, codes->upper, codes->of, _mm512_loadu_si512(table + 128));
    return _mm512_mask_permutexvar_epi8(found, codes->last, codes->of, _mm512_loadu_si512(table + 192));
}

/* Table lookup of 64 codes: floats are looked up byte by byte, from four tables of their bytes. */
INLINE void decode_block(const struct procam_frame *setup, const uint8_t *from, vf *values) {
    const __m512i order = _mm512_set_epi8(
        63, 62, 61, 60, 47, 46, 45, 44, 31, 30, 29, 28, 15, 14, 13, 12, 59, 58, 57, 56, 43, 42, 41,
        40, 27, 26, 25, 24, 11, 10, 9, 8, 55, 54, 53, 52, 39, 38, 37, 36, 23, 22, 21, 20, 7, 6, 5, 4,
        51, 50, 49, 48, 35, 34, 33, 32, 19, 18, 17, 16, 3, 2, 1, 0);
    const struct codes codes = codes_of(_mm512_permutexvar_epi8(order, _mm512_loadu_si512(from)));
    const uint8_t *table = setup->decode_bytes;
    __asm__("" : "+r"(table)); /* keeps the compiler from copying the table to the stack */
    const __m512i b0 = looked_up(table, &codes), b1 = looked_up(table + 256, &codes);
    const __m512i b2 = looked_up(table + 512, &codes), b3 = looked_up(table + 768, &codes);
    const __m512i low0 = _mm512_unpacklo_epi8(b0, b1), low1 = _mm512_unpacklo_epi8(b2, b3);
    const __m512i high0 = _mm512_unpackhi_epi8(b0, b1), high1 = _mm512_unpackhi_epi8(b2, b3);
    values[0] = _mm512_castsi512_ps(_mm512_unpacklo_epi16(low0, low1));
    values[1] = _mm512_castsi512_ps(_mm512_unpackhi_epi16(low0, low1));
    values[2] = _mm512_castsi512_ps(_mm512_unpacklo_epi16(high0, high1));
    values[3] = _mm512_castsi512_ps(_mm512_unpackhi_epi16(high0, high1));
}
INLINE vf vload_f16(const uint16_t *p) { return _mm512_cvtph_ps(_mm256_loadu_si256((const void *)p)); }
INLINE void vstore_16(uint16_t *p, __m256i a) {
    if ((uintptr_t)p % 32) _mm256_storeu_si256((void *)p, a);
    else _mm256_stream_si256((void *)p, a); /* bypasses the cache */
}
INLINE void vstore_f16(uint16_t *p, vf a) { vstore_16(p, _mm512_cvtps_ph(a, 0)); }
INLINE void vstore_u16(uint16_t *p, vf a) {
    vstore_16(p, _mm512_cvtusepi32_epi16(_mm512_cvtps_epu32(a)));
}
INLINE void store_codes(uint8_t *to, const vf *codes) { /* integer parts of 64 codes, at most 255 */
    const __m512i order = _mm512_set_epi32(15, 11, 7, 3, 14, 10, 6, 2, 13, 9, 5, 1, 12, 8, 4, 0);
    __m512i whole[VECTORS];
    for (int k = 0; k < VECTORS; k++) whole[k] = _mm512_cvttps_epi32(codes[k]);
    const __m512i low = _mm512_packus_epi32(whole[0], whole[1]);
    const __m512i high = _mm512_packus_epi32(whole[2], whole[3]);
    const __m512i bytes = _mm512_permutexvar_epi32(order, _mm512_packus_epi16(low, high));
    if ((uintptr_t)to % 64) _mm512_storeu_si512(to, bytes);
    else _mm512_stream_si512((void *)to, bytes); /* bypasses the cache */
}
INLINE void clear(void *to, size_t bytes) { /* bypasses the cache */
    if ((uintptr_t)to % 64 || bytes % 64) memset(to, 0, bytes);
    else
        for (size_t at = 0; at < bytes; at += 64)
            _mm512_stream_si512((void *)((char *)to + at), _mm512_setzero_si512());
}
INLINE void prefetch(const void *from) { _mm_prefetch(from, _MM_HINT_T2); }
INLINE vf root(vf a) { return vmul(a, _mm512_rsqrt14_ps(a)); }
#elif LEVEL == 256
INLINE void clear(void *to, size_t bytes) { memset(to, 0, bytes); }
INLINE void prefetch(const void *from) { _mm_prefetch(from, _MM_HINT_T0); }
INLINE vf vload_f16(const uint16_t *p) { return _mm256_cvtph_ps(_mm_loadu_si128((const void *)p)); }
INLINE void vstore_f16(uint16_t *p, vf a) { _mm_storeu_si128((void *)p, _mm256_cvtps_ph(a, 0)); }
INLINE void vstore_u16(uint16_t *p, vf a) {
    const __m256i whole = _mm256_cvtps_epi32(a);
    _mm_storeu_si128((void *)p, _mm_packus_epi32(_mm256_castsi256_si128(whole),
                                                 _mm256_extracti128_si256(whole, 1)));
}
INLINE void decode_block(const struct procam_frame *setup, const uint8_t *from, vf *values) {
    for (int k = 0; k < VECTORS; k++)
        values[k] = _mm256_i32gather_ps(
            setup->decode, _mm256_cvtepu8_epi32(_mm_loadl_epi64((const void *)(from + 8 * k))), 4);
}
INLINE void store_codes(uint8_t *to, const vf *codes) {
    for (int k = 0; k < VECTORS; k++) {
        const __m256i whole = _mm256_cvttps_epi32(codes[k]);
        const __m128i words = _mm_packus_epi32(_mm256_castsi256_si128(whole),
                                               _mm256_extracti128_si256(whole, 1));
        _mm_storel_epi64((void *)(to + 8 * k), _mm_packus_epi16(words, words));
    }
}
INLINE vf root(vf a) { return vsqrt(a); }
#else
INLINE void clear(void *to, size_t bytes) { memset(to, 0, bytes); }
INLINE void prefetch(const void *from) { (void)from; }
union word {
    uint32_t bits;
    float value;
};
INLINE float half_to_float(uint16_t half) {
    const uint32_t rest = half & 0x7fff;
    union word word = {rest << 13};
    if (rest >= 0x7c00) word.bits |= 0x7f800000; /* infinite, or not a number */
    else word.value *= 0x1p112f;
    word.bits |= (uint32_t)(half & 0x8000) << 16;
    return word.value;
}
INLINE uint16_t float_to_half(float value) { /* to nearest, ties to even */
    union word word = {.value = value};
    const uint16_t sign = (uint16_t)(word.bits >> 16 & 0x8000);
    const uint32_t bits = word.bits &= 0x7fffffff;
    if (bits > 0x7f800000) return sign | 0x7e00;
    if (bits >= 0x477ff000) return sign | 0x7c00; /* 65520 and more */
    if (bits < 0x38800000) {                      /* subnormal: let the adder round */
        word.value += 0.5f;
        return sign | (uint16_t)(word.bits - 0x3f000000);
    }
    return sign | (uint16_t)((bits + 0xfff + (bits >> 13 & 1) - 0x38000000) >> 13);
}
INLINE vf vload_f16(const uint16_t *p) { return half_to_float(*p); }
INLINE void vstore_f16(uint16_t *p, vf a) { *p = float_to_half(a); }
INLINE void vstore_u16(uint16_t *p, vf a) { *p = (uint16_t)lrintf(a); }
INLINE void decode_block(const struct procam_frame *setup, const uint8_t *from, vf *values) {
    for (int k = 0; k < VECTORS; k++) values[k] = setup->decode[from[k]];
}
INLINE void store_codes(uint8_t *to, const vf *codes) {
    for (int k = 0; k < VECTORS; k++) to[k] = (uint8_t)(codes[k] < 255 ? codes[k] : 255);
}
INLINE vf root(vf a) { return vsqrt(a); }
#endif

INLINE size_t bytes_of(int kind) { return kind == U8 ? 1 : kind == F32 ? 4 : 2; }

/* 64 values in linear light; what is not finite is black. */
INLINE void load_block(int kind, const struct procam_frame *setup, const void *from, vf *values) {
    if (kind == U8) {
        decode_block(setup, from, values);
        return;
    }
    for (int k = 0; k < VECTORS; k++) {
        const size_t at = (size_t)k * LANES;
        if (kind == U16) {
            values[k] = vmul(vload_u16((const uint16_t *)from + at), vset(1 / 65535.0f));
            continue;
        }
        const vf v = kind == F16 ? vload_f16((const uint16_t *)from + at) : vload((const float *)from + at);
        values[k] = vsel(vlt(vabs(v), vset(INFINITY)), v, vset(0.0f));
    }
}

/* Stores 64 values of light, mixed with the original ones; `from` may be `to`. */
INLINE void store_block(int kind, const struct procam_frame *setup, const void *from,
                        const float *threshold, const vf *values, void *to) {
    vf codes[VECTORS];
    for (int k = 0; k < VECTORS; k++) {
        const size_t at = (size_t)k * LANES;
        vf v = values[k], original;
        if (kind == U8) {
            const vf x = root(vmax(v, vset(WRITTEN_BLACK)));
            const vi number = vshift(vbits(x), 22);
            const float *constant = setup->encode, *linear = constant + SEGMENTS, *squared = linear + SEGMENTS;
            v = vfma(vpick(window_at(squared), number), x, vpick(window_at(linear), number));
            v = vfma(v, x, vpick(window_at(constant), number));
        } else if (kind == U16)
            v = vmin(vmax(vmul(v, vset(65535.0f)), vset(0.0f)), vset(65535.0f));
        if (setup->strength < 1) {
            original = kind == U8    ? vload_u8((const uint8_t *)from + at)
                   : kind == U16 ? vload_u16((const uint16_t *)from + at)
                   : kind == F16 ? vload_f16((const uint16_t *)from + at)
                                 : vload((const float *)from + at);
            if (kind == F16 || kind == F32) original = vsel(vlt(vabs(original), vset(INFINITY)), original, vset(0.0f));
            v = vfma(vset(setup->strength), vsub(v, original), original);
        }
        if (kind == U8) codes[k] = vadd(v, vload(threshold + at));
        else if (kind == U16) vstore_u16((uint16_t *)to + at, v);
        else if (kind == F16) vstore_f16((uint16_t *)to + at, v);
        else if ((uintptr_t)to % 64) vstore((float *)to + at, v);
        else vstream((float *)to + at, v);
    }
    if (kind == U8) store_codes(to, codes);
}

