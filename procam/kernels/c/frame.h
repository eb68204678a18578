/* A dome master against the model of what bounces: sums of its light, or the light to send.

   Fields lie on a coarse grid of nodes and are interpolated: along a node row once per strip of
   columns and pair of node rows (an interval), down the interval for every row of the picture.
   Values are interleaved, red, green, blue; pixels are never taken apart. */

enum { FRAME_STRIP = 768, FRAME_BLOCK = 64, FRAME_CHUNK = 32 }; /* values, values, intervals; a strip is 256 pixels */
enum { CYCLE = 48, SEGMENTS = 32, TILE_WIDTH = 192, TILE_ROWS = 64 };
enum plane { LIGHT, LEAST, MOST, GAIN, COVER, PLANES };
enum { VECTORS = FRAME_BLOCK / LANES, AXES = 3, AHEAD = 6 }; /* rows that are fetched ahead */

struct room { /* of one strip */
    float at[PLANES][FRAME_STRIP], to[PLANES][FRAME_STRIP], step[PLANES][FRAME_STRIP], total[FRAME_STRIP];
    float weight[FRAME_STRIP], axes[AXES][FRAME_STRIP];
    float count[FRAME_STRIP], whole[FRAME_STRIP / FRAME_BLOCK]; /* lit rows of a band: of values, of whole blocks */
    size_t row; /* of nodes, in `to` */
} __attribute__((aligned(64)));

struct span { /* of values of a row */
    size_t first, count, padded;
};

/* Interpolates a node row to `count` values, a multiple of FRAME_BLOCK. */
INLINE void widen(const float *row, const struct procam_frame *how, int planar, struct span span,
                  float *to) {
    const int32_t *left = (planar ? how->left_node : how->left) + span.first;
    const int32_t *right = (planar ? how->right_node : how->right) + span.first;
    const float *across = how->across + span.first;
#if LEVEL == 512
    for (size_t i = 0; i < span.padded; i += 16) {
        const int start = left[i] < 2 ? 0 : left[i] - 2;
        const __m512i base = _mm512_set1_epi32(start);
        const __m512 low = _mm512_loadu_ps(row + start), high = _mm512_loadu_ps(row + start + 16);
        const __m512i l = _mm512_sub_epi32(_mm512_loadu_si512(left + i), base);
        const __m512i r = _mm512_sub_epi32(_mm512_loadu_si512(right + i), base);
        const vf a = _mm512_permutex2var_ps(low, l, high), b = _mm512_permutex2var_ps(low, r, high);
        vstore(to + i, vfma(vload(across + i), vsub(b, a), a));
    }
#else
    for (size_t i = 0; i < span.padded; i++)
        to[i] = row[left[i]] + across[i] * (row[right[i]] - row[left[i]]);
#endif
}

/* A node row of all fields, into `to`. */
INLINE void load_nodes(const struct procam_frame *how, struct room *room, size_t row, int mixed,
                       struct span span) {
    const size_t nodes = (size_t)how->nodes;
    widen(how->light + row * 3 * nodes, how, 0, span, room->to[LIGHT]);
    widen(how->least + row * 3 * nodes, how, 0, span, room->to[LEAST]);
    if (how->most) widen(how->most + row * 3 * nodes, how, 0, span, room->to[MOST]);
    if (how->gain) widen(how->gain + row * nodes, how, 1, span, room->to[GAIN]);
    if (mixed) widen(how->coverage + row * nodes, how, 1, span, room->to[COVER]);
    room->row = row;
}

/* Fields between node rows `above` and `below`. */
INLINE void enter(const struct procam_frame *how, struct room *room, size_t above, size_t below,
                  int mixed, struct span span) {
    const int used[PLANES] = {1, 1, how->most != NULL, how->gain != NULL, mixed};
    if (room->row != above || mixed) load_nodes(how, room, above, mixed, span);
    for (int field = 0; field < PLANES; field++)
        if (used[field]) memcpy(room->at[field], room->to[field], span.padded * sizeof(float));
    load_nodes(how, room, below, mixed, span);
    for (int field = 0; field < PLANES; field++)
        for (size_t i = 0; used[field] && i < span.padded; i += LANES)
            vstore(room->step[field] + i,
                   vsub(vload(room->to[field] + i), vload(room->at[field] + i)));
}

#if LEVEL == 512
INLINE __m512i byte_of(const uint8_t *table, __m512i codes) { /* table of 256 */
    const __m512i low = _mm512_permutex2var_epi8(_mm512_loadu_si512(table), codes,
                                                 _mm512_loadu_si512(table + 64));
    const __m512i high = _mm512_permutex2var_epi8(_mm512_loadu_si512(table + 128), codes,
                                                  _mm512_loadu_si512(table + 192));
    return _mm512_mask_blend_epi8(_mm512_movepi8_mask(codes), low, high);
}

/* Table lookup of 64 codes: floats are looked up byte by byte, from four tables of their bytes. */
INLINE void decode_block(const struct procam_frame *how, const uint8_t *from, vf *values) {
    const __m512i order = _mm512_set_epi8(
        63, 62, 61, 60, 47, 46, 45, 44, 31, 30, 29, 28, 15, 14, 13, 12, 59, 58, 57, 56, 43, 42, 41,
        40, 27, 26, 25, 24, 11, 10, 9, 8, 55, 54, 53, 52, 39, 38, 37, 36, 23, 22, 21, 20, 7, 6, 5, 4,
        51, 50, 49, 48, 35, 34, 33, 32, 19, 18, 17, 16, 3, 2, 1, 0);
    const __m512i codes = _mm512_permutexvar_epi8(order, _mm512_loadu_si512(from));
    const __m512i b0 = byte_of(how->decode_bytes, codes), b1 = byte_of(how->decode_bytes + 256, codes);
    const __m512i b2 = byte_of(how->decode_bytes + 512, codes);
    const __m512i b3 = byte_of(how->decode_bytes + 768, codes);
    const __m512i low0 = _mm512_unpacklo_epi8(b0, b1), low1 = _mm512_unpacklo_epi8(b2, b3);
    const __m512i high0 = _mm512_unpackhi_epi8(b0, b1), high1 = _mm512_unpackhi_epi8(b2, b3);
    values[0] = _mm512_castsi512_ps(_mm512_unpacklo_epi16(low0, low1));
    values[1] = _mm512_castsi512_ps(_mm512_unpackhi_epi16(low0, low1));
    values[2] = _mm512_castsi512_ps(_mm512_unpacklo_epi16(high0, high1));
    values[3] = _mm512_castsi512_ps(_mm512_unpackhi_epi16(high0, high1));
}
INLINE vf vload_f16(const uint16_t *p) { return _mm512_cvtph_ps(_mm256_loadu_si256((const void *)p)); }
INLINE void vstore_f16(uint16_t *p, vf a) { _mm256_storeu_si256((void *)p, _mm512_cvtps_ph(a, 0)); }
INLINE void vstore_u16(uint16_t *p, vf a) {
    _mm256_storeu_si256((void *)p, _mm512_cvtusepi32_epi16(_mm512_cvtps_epu32(a)));
}
INLINE void store_codes(uint8_t *to, const vf *codes) { /* whole parts of 64 codes */
    const __m512i order = _mm512_set_epi32(15, 11, 7, 3, 14, 10, 6, 2, 13, 9, 5, 1, 12, 8, 4, 0);
    __m512i whole[VECTORS];
    for (int k = 0; k < VECTORS; k++) whole[k] = _mm512_cvttps_epi32(codes[k]);
    const __m512i low = _mm512_packus_epi32(whole[0], whole[1]);
    const __m512i high = _mm512_packus_epi32(whole[2], whole[3]);
    const __m512i bytes = _mm512_permutexvar_epi32(order, _mm512_packus_epi16(low, high));
    if ((uintptr_t)to % 64) _mm512_storeu_si512(to, bytes);
    else _mm512_stream_si512((void *)to, bytes); /* past the cache */
}
INLINE void fetch(const void *from) { _mm_prefetch(from, _MM_HINT_T0); }
INLINE vf fourth_root(vf a) { return _mm512_rsqrt14_ps(_mm512_rsqrt14_ps(a)); }
INLINE vf piece(const float *table, vf at) {
    return _mm512_permutex2var_ps(vload(table), _mm512_cvttps_epi32(at), vload(table + 16));
}
#elif LEVEL == 256
INLINE void fetch(const void *from) { _mm_prefetch(from, _MM_HINT_T0); }
INLINE vf vload_f16(const uint16_t *p) { return _mm256_cvtph_ps(_mm_loadu_si128((const void *)p)); }
INLINE void vstore_f16(uint16_t *p, vf a) { _mm_storeu_si128((void *)p, _mm256_cvtps_ph(a, 0)); }
INLINE void vstore_u16(uint16_t *p, vf a) {
    const __m256i whole = _mm256_cvtps_epi32(a);
    _mm_storeu_si128((void *)p, _mm_packus_epi32(_mm256_castsi256_si128(whole),
                                                 _mm256_extracti128_si256(whole, 1)));
}
INLINE void decode_block(const struct procam_frame *how, const uint8_t *from, vf *values) {
    for (int k = 0; k < VECTORS; k++)
        values[k] = _mm256_i32gather_ps(
            how->decode, _mm256_cvtepu8_epi32(_mm_loadl_epi64((const void *)(from + 8 * k))), 4);
}
INLINE void store_codes(uint8_t *to, const vf *codes) {
    for (int k = 0; k < VECTORS; k++) {
        const __m256i whole = _mm256_cvttps_epi32(codes[k]);
        const __m128i words = _mm_packus_epi32(_mm256_castsi256_si128(whole),
                                               _mm256_extracti128_si256(whole, 1));
        _mm_storel_epi64((void *)(to + 8 * k), _mm_packus_epi16(words, words));
    }
}
INLINE vf fourth_root(vf a) { return vsqrt(vsqrt(a)); }
INLINE vf piece(const float *table, vf at) {
    return _mm256_i32gather_ps(table, _mm256_cvttps_epi32(at), 4);
}
#else
INLINE void fetch(const void *from) { (void)from; }
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
INLINE void decode_block(const struct procam_frame *how, const uint8_t *from, vf *values) {
    for (int k = 0; k < VECTORS; k++) values[k] = how->decode[from[k]];
}
INLINE void store_codes(uint8_t *to, const vf *codes) {
    for (int k = 0; k < VECTORS; k++) to[k] = (uint8_t)codes[k];
}
INLINE vf fourth_root(vf a) { return vsqrt(vsqrt(a)); }
INLINE vf piece(const float *table, vf at) { return table[(int)at]; }
#endif

INLINE size_t bytes_of(int kind) { return kind == U8 ? 1 : kind == F32 ? 4 : 2; }

/* 64 values in linear light. */
INLINE void load_block(int kind, const struct procam_frame *how, const void *from, vf *values) {
    if (kind == U8) {
        decode_block(how, from, values);
        return;
    }
    for (int k = 0; k < VECTORS; k++) {
        const size_t at = (size_t)k * LANES;
        values[k] = kind == U16   ? vmul(vload_u16((const uint16_t *)from + at), vset(1 / 65535.0f))
                    : kind == F16 ? vload_f16((const uint16_t *)from + at)
                                  : vload((const float *)from + at);
    }
}

/* 64 values of light as they are stored, mixed with what came in; `from` may be `to`. */
INLINE void store_block(int kind, const struct procam_frame *how, const void *from,
                        const float *threshold, const vf *values, void *to) {
    vf codes[VECTORS];
    for (int k = 0; k < VECTORS; k++) {
        const size_t at = (size_t)k * LANES;
        vf v = values[k], came;
        if (kind == U8) {
            const vf root = fourth_root(v);
            const vf place = vmin(vmul(root, vset(SEGMENTS)), vset(SEGMENTS - 0.5f));
            v = vfma(piece(how->encode + 2 * SEGMENTS, place), root,
                     piece(how->encode + SEGMENTS, place));
            v = vfma(v, root, piece(how->encode, place));
        } else if (kind == U16)
            v = vmul(v, vset(65535.0f));
        if (how->strength < 1) {
            came = kind == U8    ? vload_u8((const uint8_t *)from + at)
                   : kind == U16 ? vload_u16((const uint16_t *)from + at)
                   : kind == F16 ? vload_f16((const uint16_t *)from + at)
                                 : vload((const float *)from + at);
            v = vfma(vset(how->strength), vsub(v, came), came);
        }
        if (kind == U8) codes[k] = vmin(vadd(v, vload(threshold + at)), vset(255.0f));
        else if (kind == U16) vstore_u16((uint16_t *)to + at, vmin(v, vset(65535.0f)));
        else if (kind == F16) vstore_f16((uint16_t *)to + at, v);
        else if ((uintptr_t)to % 64) vstore((float *)to + at, v);
        else vstream((float *)to + at, v);
    }
    if (kind == U8) store_codes(to, codes);
}

/* What a mode keeps of one vector. */
INLINE vf kept(int mode, const struct procam_frame *how, const struct room *room, size_t i, vf down,
               vf content) {
    if (how->gain) content = vmul(content, vfma(down, vload(room->step[GAIN] + i), vload(room->at[GAIN] + i)));
    const vf light = vfma(down, vload(room->step[LIGHT] + i), vload(room->at[LIGHT] + i));
    const vf wanted = vsub(content, light);
    if (mode == SUM_CONTENT) return wanted;
    const vf least = vfma(down, vload(room->step[LEAST] + i), vload(room->at[LEAST] + i));
    vf most = vset(how->top);
    if (how->most)
        most = vmin(most, vfma(down, vload(room->step[MOST] + i), vload(room->at[MOST] + i)));
    const vf one = vset(1.0f), none = vset(0.0f);
    if (mode == COUNT_LEAST) return vsel(vlt(least, wanted), none, one);
    if (mode == COUNT_MOST) return vsel(vlt(wanted, most), none, one);
    const vf light_sent = vmin(vmax(wanted, least), most);
    return mode == SUM_EXCESS ? vsub(light_sent, wanted) : light_sent;
}

INLINE void one_block(int kind, int mode, const struct procam_frame *how, struct room *room, size_t i,
                      int lit, float down, const void *from, void *to, const float *threshold) {
    vf values[VECTORS];
    load_block(kind, how, from, values);
    for (int k = 0; k < VECTORS; k++) {
        const size_t at = i + (size_t)k * LANES;
        values[k] = lit == NOWHERE ? vset(0.0f) : kept(mode, how, room, at, vset(down), values[k]);
        if (lit == IN_PART) {
            const vf cover = vfma(vset(down), vload(room->step[COVER] + at), vload(room->at[COVER] + at));
            const vf one = vsel(vlt(vset(0.0f), cover), vset(1.0f), vset(0.0f));
            values[k] = vmul(one, values[k]);
            vstore(room->count + at, vadd(vload(room->count + at), one));
        }
        if (mode != APPLY) vstore(room->total + at, vadd(vload(room->total + at), values[k]));
    }
    room->whole[i / FRAME_BLOCK] += lit == EVERYWHERE;
    if (mode == APPLY) store_block(kind, how, from, threshold, values, to);
}

INLINE void one_row(int kind, int mode, const struct procam_frame *how, struct room *room, size_t row,
                    const uint8_t *lit, struct span span) {
    const size_t width = bytes_of(kind), start = row * 3 * how->size + span.first;
    const unsigned char *from = (const unsigned char *)how->image + start * width;
    unsigned char *to = mode == APPLY ? (unsigned char *)how->out + start * width : NULL;
    const float *threshold = how->threshold + row % TILE_ROWS * TILE_WIDTH;
    for (size_t i = 0; i < span.padded; i += FRAME_BLOCK) {
        const size_t left = span.count - i < FRAME_BLOCK ? span.count - i : FRAME_BLOCK;
        const float *tile = threshold + (span.first + i) % TILE_WIDTH;
        for (size_t ahead = 0; row + AHEAD < how->size && ahead < FRAME_BLOCK * width; ahead += 64)
            fetch(from + AHEAD * 3 * how->size * width + i * width + ahead);
        if (lit[i / FRAME_BLOCK] == NOWHERE && (mode != APPLY || how->strength >= 1)) {
            if (mode == APPLY) memset(to + i * width, 0, left * width);
        } else if (left == FRAME_BLOCK) {
            one_block(kind, mode, how, room, i, lit[i / FRAME_BLOCK], how->down[row], from + i * width, to + i * width, tile);
        } else {
            unsigned char in[FRAME_BLOCK * 4] = {0}, out[FRAME_BLOCK * 4];
            memcpy(in, from + i * width, left * width);
            one_block(kind, mode, how, room, i, lit[i / FRAME_BLOCK], how->down[row], in, out, tile);
            if (mode == APPLY) memcpy(to + i * width, out, left * width);
            memset(room->total + i + left, 0, (FRAME_BLOCK - left) * sizeof(float));
        }
    }
}

/* Adds a band's means over its lit rows, weighted, to the sums of each term and lane. */
INLINE void gather(int mode, const struct procam_frame *how, struct room *room, size_t band,
                   struct span span, vf (*sums)[FRAME_TERMS]) {
    const size_t nodes = (size_t)how->nodes;
    if (mode == SUM_EXCESS) widen(how->painted + band * 3 * nodes, how, 0, span, room->weight);
    else widen(how->weight + band * nodes, how, 1, span, room->weight);
    for (size_t axis = 0; how->terms > 1 && axis < AXES; axis++)
        widen(how->direction + (band * AXES + axis) * nodes, how, 1, span, room->axes[axis]);
    for (size_t i = 0; i < span.padded; i += LANES) {
        vf *sum = sums[i % CYCLE / LANES];
        const vf rows = vmax(vadd(vload(room->count + i), vset(room->whole[i / FRAME_BLOCK])), vset(1.0f));
        const vf v = vdiv(vmul(vload(room->weight + i), vload(room->total + i)), rows);
        const vf x = vload(room->axes[0] + i), y = vload(room->axes[1] + i);
        const vf z = vload(room->axes[2] + i);
        vstore(room->total + i, vset(0.0f));
        vstore(room->count + i, vset(0.0f));
        sum[0] = vadd(sum[0], v);
        if (how->terms == 1) continue;
        sum[1] = vfma(v, x, sum[1]);
        sum[2] = vfma(v, y, sum[2]);
        sum[3] = vfma(v, z, sum[3]);
        if (how->terms == 4) continue;
        sum[4] = vfma(v, vmul(x, y), sum[4]);
        sum[5] = vfma(v, vmul(y, z), sum[5]);
        sum[6] = vfma(v, vmul(x, z), sum[6]);
        sum[7] = vfma(v, vsub(vmul(x, x), vmul(y, y)), sum[7]);
        sum[8] = vfma(v, vmul(z, z), sum[8]);
    }
    memset(room->whole, 0, sizeof room->whole);
}

INLINE void flush(const struct procam_frame *how, vf (*sums)[FRAME_TERMS], double *to) {
    for (int phase = 0; phase < CYCLE / LANES; phase++)
        for (int term = 0; term < how->terms; term++) {
            float lanes[LANES];
            memcpy(lanes, &sums[phase][term], sizeof lanes);
            for (int lane = 0; lane < LANES; lane++)
                to[(phase * LANES + lane) % 3 * FRAME_TERMS + term] += lanes[lane];
            sums[phase][term] = vset(0.0f);
        }
}

INLINE int lit_of(const uint8_t *lit, size_t blocks) {
    int least = EVERYWHERE, most = NOWHERE;
    for (size_t block = 0; block < blocks; block++) {
        least = lit[block] < least ? lit[block] : least;
        most = lit[block] > most ? lit[block] : most;
    }
    return most == NOWHERE ? NOWHERE : least == EVERYWHERE ? EVERYWHERE : IN_PART;
}

INLINE void frame_of_kind(int kind, int mode, const struct procam_frame *how, size_t strip,
                          size_t chunk, double *to) {
    struct room room;
    const size_t total = 3 * how->size, first = strip * FRAME_STRIP;
    const size_t count = total - first < FRAME_STRIP ? total - first : FRAME_STRIP;
    const struct span span = {first, count, (count + FRAME_BLOCK - 1) / FRAME_BLOCK * FRAME_BLOCK};
    const size_t intervals = (size_t)how->nodes + 1, last = (size_t)how->nodes - 1;
    const size_t begin = chunk * FRAME_CHUNK, blocks = (total + FRAME_BLOCK - 1) / FRAME_BLOCK;
    const size_t end = begin + FRAME_CHUNK < intervals ? begin + FRAME_CHUNK : intervals;
    vf sums[CYCLE / LANES][FRAME_TERMS];
    memset(sums, 0, sizeof sums);
    memset(&room, 0, sizeof room);
    room.row = intervals; /* none */
    for (size_t interval = begin; interval < end; interval++) { /* between nodes interval - 1 and it */
        const uint8_t *lit = how->lit + interval * blocks + first / FRAME_BLOCK;
        const int state = lit_of(lit, span.padded / FRAME_BLOCK);
        const size_t row = (size_t)how->rows[interval], next = (size_t)how->rows[interval + 1];
        if (row < next && (state != NOWHERE || mode == APPLY)) {
            if (state != NOWHERE)
                enter(how, &room, interval ? interval - 1 : 0, interval < last ? interval : last,
                      state == IN_PART, span);
            for (size_t y = row; y < next; y++) one_row(kind, mode, how, &room, y, lit, span);
        }
        if (mode != APPLY && ((interval + 1) % (size_t)how->band == 0 || interval == end - 1))
            gather(mode, how, &room, interval / (size_t)how->band, span, sums);
    }
    if (mode != APPLY) flush(how, sums, to);
    vfence();
}

INLINE void frame_of_mode(int mode, const struct procam_frame *how, size_t strip, size_t chunk,
                          double *to) {
    if (how->kind == U8) frame_of_kind(U8, mode, how, strip, chunk, to);
    else if (how->kind == U16) frame_of_kind(U16, mode, how, strip, chunk, to);
    else if (how->kind == F16) frame_of_kind(F16, mode, how, strip, chunk, to);
    else frame_of_kind(F32, mode, how, strip, chunk, to);
}

static void frame(const struct frame *job, size_t first, size_t count) {
    for (size_t task = first; task < first + count; task++) {
        const struct procam_frame *how = job->how;
        const size_t strip = task % job->strips, chunk = task / job->strips;
        double *to = job->sums + task * 3 * FRAME_TERMS;
        if (job->mode == APPLY) frame_of_mode(APPLY, how, strip, chunk, to);
        else if (job->mode == SUM_LIGHT) frame_of_mode(SUM_LIGHT, how, strip, chunk, to);
        else frame_of_mode(job->mode, how, strip, chunk, to); /* these can wait */
    }
}

enum { RUN = 128 }; /* nodes at a time */

INLINE void polynomial(const double *n, int terms, const float *x, const float *y, const float *z,
                       size_t count, double *to) {
    for (size_t i = 0; i < count; i++) to[i] = n[0];
    for (size_t i = 0; terms > 1 && i < count; i++)
        to[i] += n[1] * (double)x[i] + n[2] * (double)y[i] + n[3] * (double)z[i];
    for (size_t i = 0; terms > 4 && i < count; i++) {
        const double e = x[i], f = y[i], g = z[i];
        to[i] += n[4] * e * f + n[5] * f * g + n[6] * e * g + n[7] * (e * e - f * f) + n[8] * g * g;
    }
}

/* Half a unit in the last place, more or less, by the node's number: what is the same everywhere must
   not be rounded the same way everywhere, for its sum would be off by as much. */
INLINE double unround(size_t node) {
    const uint32_t mixed = (uint32_t)node * 2654435761u;
    return ((double)mixed / 4294967296.0 - 0.5) / 16777216.0;
}

/* What bounces to the nodes of some rows: a polynomial, painted; lamps on top, a second one taken off. */
static void bounce(const struct bounce *job, size_t first, size_t count) {
    const size_t nodes = (size_t)job->nodes, plane = nodes * nodes, end = (first + count) * nodes;
    for (size_t at = first * nodes; at < end; at += RUN) {
        const size_t run = end - at < RUN ? end - at : RUN;
        const float *x = job->direction + at, *y = x + plane, *z = y + plane;
        for (size_t c = 0; c < 3; c++) {
            const float *spread = job->spread + 3 * at + c;
            float *light = job->light + 3 * at + c;
            double painted[RUN], plain[RUN] = {0};
            polynomial(job->numbers + c * FRAME_TERMS, job->terms, x, y, z, run, painted);
            if (job->offset) polynomial(job->offset + c * FRAME_TERMS, job->terms, x, y, z, run, plain);
            for (size_t i = 0; i < run; i++) {
                const double lamps = job->ambient ? job->ambient[3 * (at + i) + c] : 0;
                const double sum = spread[3 * i] * painted[i] + (lamps - plain[i]);
                light[3 * i] = (float)(sum + sum * unround(at + i));
            }
        }
    }
}
