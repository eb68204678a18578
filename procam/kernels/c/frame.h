/* A dome master against the model of what bounces: sums of its light, or the light to send.

   Fields lie on a coarse grid of nodes and are interpolated: along node rows once per pair of them (an
   interval), down the interval for every row of the picture. Values are interleaved, red, green, blue;
   pixels are never taken apart. */

enum { FRAME_STRIP = 1536, FRAME_CHUNK = 32 }; /* values, intervals; a strip is 256 pixels */
enum { STRIP_BLOCKS = FRAME_STRIP / FRAME_BLOCK, STEP = 16 };
enum plane { LIGHT, LEAST, MOST, GAIN, COVER, PLANES };
enum { AXES = 3, AHEAD = 8, NODES_AHEAD = 2 }; /* rows that are fetched ahead */

struct room { /* of one strip */
    float below[PLANES][FRAME_STRIP];                   /* node row `row` of each block */
    float total[FRAME_STRIP];                           /* of a band's rows */
    float count[FRAME_STRIP];                           /* lit rows of a band, of blocks lit in part */
    size_t row[STRIP_BLOCKS], whole[STRIP_BLOCKS];      /* lit rows of a band, of blocks lit everywhere */
    uint8_t mixed[STRIP_BLOCKS], cover[STRIP_BLOCKS];   /* lit in part in this band; COVER is there */
} __attribute__((aligned(64)));

struct ramp { /* a field in a block, between two node rows */
    vf at[VECTORS], step[VECTORS];
};

/* One vector of a node row at places of the picture, from number `i` on. */
INLINE vf widened(const struct places *places, const float *row, size_t i) {
    const int32_t *pair = places->pair + i;
    const float *from = row + places->start[i / STEP];
#if LEVEL == 512
    const __m512i left = _mm512_loadu_si512(pair), right = _mm512_srli_epi32(left, 8);
    const __m512 low = _mm512_loadu_ps(from), high = _mm512_loadu_ps(from + STEP);
    const vf a = _mm512_permutex2var_ps(low, left, high), b = _mm512_permutex2var_ps(low, right, high);
#elif LEVEL == 256
    const __m256i both = _mm256_loadu_si256((const void *)pair);
    const vf a = _mm256_i32gather_ps(from, _mm256_and_si256(both, _mm256_set1_epi32(31)), 4);
    const vf b = _mm256_i32gather_ps(from, _mm256_srli_epi32(both, 8), 4);
#else
    const vf a = from[*pair & 31], b = from[*pair >> 8];
#endif
    return vfma(vload(places->across + i), vsub(b, a), a);
}

/* A field between node rows `above` and `below` in a block; `kept` holds `above` where `known`. */
INLINE void enter(const struct procam_frame *how, const struct places *places, const float *field,
                  size_t above, size_t below, size_t i, int known, float *kept, struct ramp *ramp) {
    const size_t width = (size_t)how->nodes * (places == &how->values ? 3 : 1);
    for (int k = 0; k < VECTORS; k++) {
        const size_t at = (size_t)k * LANES;
        if (below + NODES_AHEAD < (size_t)how->nodes)
            fetch(field + (below + NODES_AHEAD) * width + places->start[(i + at) / STEP]);
        ramp->at[k] = known ? vload(kept + at) : widened(places, field + above * width, i + at);
        const vf next = widened(places, field + below * width, i + at);
        vstore(kept + at, next);
        ramp->step[k] = vsub(next, ramp->at[k]);
    }
}

INLINE vf between(const struct ramp *ramp, int k, vf down) { return vfma(down, ramp->step[k], ramp->at[k]); }

/* What a mode keeps of one vector. */
INLINE vf kept(int mode, int plain, const struct procam_frame *how, const struct ramp *ramps, int k, vf down,
               vf content) {
    if (!plain && how->gain) content = vmul(content, between(ramps + GAIN, k, down));
    const vf wanted = vsub(content, between(ramps + LIGHT, k, down));
    if (mode == SUM_CONTENT) return wanted;
    const vf least = between(ramps + LEAST, k, down), one = vset(1.0f), none = vset(0.0f);
    vf most = vset(how->top);
    if (!plain && how->most) most = vmin(most, between(ramps + MOST, k, down));
    if (mode == COUNT_LEAST) return vsel(vlt(least, wanted), none, one);
    if (mode == COUNT_MOST) return vsel(vlt(wanted, most), none, one);
    const vf sent = vmin(vmax(wanted, least), most);
    return mode == SUM_EXCESS ? vsub(sent, wanted) : sent;
}

struct rows { /* a block of the picture in the rows of an interval */
    size_t first, left, block, row, end; /* value, values, number in the strip, rows */
    int lit;
};

/* One row of a block: what is kept is added to `sum`, what is lit in part to `count`. */
INLINE void one_row(int kind, int mode, int lit, int plain, const struct procam_frame *how, const struct ramp *ramps,
                    size_t row, const void *from, void *to, const float *threshold, vf *sum, vf *count) {
    const vf down = vset(how->down[row]);
    vf values[VECTORS];
    load_block(kind, how, from, values);
    for (int k = 0; k < VECTORS; k++) {
        values[k] = lit == NOWHERE ? vset(0.0f) : kept(mode, plain, how, ramps, k, down, values[k]);
        if (lit == IN_PART) {
            const vf none = vset(0.0f);
            const vf one = vsel(vlt(none, between(ramps + COVER, k, down)), vset(1.0f), none);
            values[k] = vmul(one, values[k]);
            count[k] = vadd(count[k], one);
        }
        sum[k] = vadd(sum[k], values[k]);
    }
    if (mode == APPLY) store_block(kind, how, from, threshold, values, to);
}

INLINE void rows_of(int kind, int mode, int lit, int plain, const struct procam_frame *how, const struct rows *part,
                    const struct ramp *ramps, vf *sum, vf *count) {
    const size_t width = bytes_of(kind), pitch = 3 * how->size * width;
    const unsigned char *from = (const unsigned char *)how->image + part->row * pitch + part->first * width;
    unsigned char *to = mode == APPLY ? (unsigned char *)how->out + (from - (const unsigned char *)how->image) : NULL;
    for (size_t y = part->row; y < part->end; y++, from += pitch, to += mode == APPLY ? pitch : 0) {
        const float *tile = how->threshold + y % TILE_ROWS * TILE_WIDTH + part->first % TILE_WIDTH;
        for (size_t ahead = 0; y + AHEAD < how->size && ahead < FRAME_BLOCK * width; ahead += 64)
            fetch(from + AHEAD * pitch + ahead);
        if (part->left == FRAME_BLOCK) {
            one_row(kind, mode, lit, plain, how, ramps, y, from, to, tile, sum, count);
            continue;
        }
        unsigned char in[FRAME_BLOCK * 4] = {0}, out[FRAME_BLOCK * 4]; /* the picture's right edge */
        memcpy(in, from, part->left * width);
        one_row(kind, mode, lit, plain, how, ramps, y, in, out, tile, sum, count);
        if (mode == APPLY) memcpy(to, out, part->left * width);
    }
}

INLINE void clear_rows(int kind, const struct procam_frame *how, const struct rows *part) {
    const size_t width = bytes_of(kind), pitch = 3 * how->size * width;
    unsigned char *to = (unsigned char *)how->out + part->row * pitch + part->first * width;
    for (size_t y = part->row; y < part->end; y++, to += pitch) clear(to, part->left * width);
}

INLINE void add_up(struct room *room, const struct rows *part, const vf *sum, const vf *count) {
    const size_t first = part->block * FRAME_BLOCK;
    for (int k = 0; k < VECTORS; k++) {
        float *total = room->total + first + (size_t)k * LANES, *lit = room->count + first + (size_t)k * LANES;
        vstore(total, vadd(vload(total), sum[k]));
        if (part->lit == IN_PART) vstore(lit, vadd(vload(lit), count[k]));
    }
    if (part->left < FRAME_BLOCK)
        memset(room->total + first + part->left, 0, (FRAME_BLOCK - part->left) * sizeof(float));
    if (part->lit == IN_PART) room->mixed[part->block] = 1;
    else room->whole[part->block] += part->end - part->row;
}

/* A block in the rows between two node rows. */
INLINE void one_part(int kind, int mode, const struct procam_frame *how, struct room *room,
                     const struct rows *part, size_t above, size_t below) {
    struct ramp ramps[PLANES];
    vf sum[VECTORS], count[VECTORS];
    if (part->lit == NOWHERE && (mode != APPLY || how->strength >= 1)) {
        if (mode == APPLY) clear_rows(kind, how, part);
        return;
    }
    for (int k = 0; k < VECTORS; k++) sum[k] = count[k] = vset(0.0f);
    if (part->lit == NOWHERE) {
        rows_of(kind, mode, NOWHERE, 0, how, part, ramps, sum, count);
        return;
    }
    const int known = room->row[part->block] == above, covered = known && room->cover[part->block];
    const size_t at = part->block * FRAME_BLOCK;
    enter(how, &how->values, how->light, above, below, part->first, known, room->below[LIGHT] + at, ramps + LIGHT);
    enter(how, &how->values, how->least, above, below, part->first, known, room->below[LEAST] + at, ramps + LEAST);
    if (how->most)
        enter(how, &how->values, how->most, above, below, part->first, known, room->below[MOST] + at, ramps + MOST);
    if (how->gain)
        enter(how, &how->shared, how->gain, above, below, part->first, known, room->below[GAIN] + at, ramps + GAIN);
    if (part->lit == IN_PART)
        enter(how, &how->shared, how->coverage, above, below, part->first, covered, room->below[COVER] + at,
              ramps + COVER);
    room->row[part->block] = below;
    room->cover[part->block] = part->lit == IN_PART;
    if (part->lit == EVERYWHERE && !how->gain && !how->most)
        rows_of(kind, mode, EVERYWHERE, 1, how, part, ramps, sum, count);
    else if (part->lit == EVERYWHERE) rows_of(kind, mode, EVERYWHERE, 0, how, part, ramps, sum, count);
    else rows_of(kind, mode, IN_PART, 0, how, part, ramps, sum, count);
    add_up(room, part, sum, count);
}

/* The colours of LANES pixels, one by one. */
INLINE void apart(const float *from, vf *colours) {
#if LEVEL == 512
    const __m512i step = _mm512_mullo_epi32(_mm512_set1_epi32(3), _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0));
    const vf a = vload(from), b = vload(from + LANES), c = vload(from + 2 * LANES);
    for (int colour = 0; colour < 3; colour++) {
        const __m512i place = _mm512_add_epi32(step, _mm512_set1_epi32(colour));
        const __mmask16 late = _mm512_cmpge_epi32_mask(place, _mm512_set1_epi32(2 * LANES));
        colours[colour] = _mm512_mask_permutexvar_ps(_mm512_permutex2var_ps(a, place, b), late, place, c);
    }
#elif LEVEL == 256
    const __m256i step = _mm256_set_epi32(21, 18, 15, 12, 9, 6, 3, 0);
    for (int colour = 0; colour < 3; colour++) colours[colour] = _mm256_i32gather_ps(from + colour, step, 4);
#else
    for (int colour = 0; colour < 3; colour++) colours[colour] = from[colour];
#endif
}

/* Adds a band's means over its lit rows, weighted, to the sums of each colour and term, LANES pixels at
   a time. */
INLINE void gather_pixels(int mode, const struct procam_frame *how, const struct room *room, size_t band,
                          size_t at, size_t pixel, vf (*sums)[FRAME_TERMS]) {
    const size_t nodes = (size_t)how->nodes;
    float means[3 * LANES] __attribute__((aligned(64)));
    vf colours[3], axes[AXES], weight = vset(0.0f);
    for (size_t i = at; i < at + 3 * LANES; i += LANES) {
        const size_t block = i / FRAME_BLOCK, whole = room->whole[block];
        vf rows = vset(1.0f / (float)(whole ? whole : 1));
        if (room->mixed[block])
            rows = vdiv(vset(1.0f), vmax(vadd(vload(room->count + i), vset((float)whole)), vset(1.0f)));
        vstore(means + (i - at), vmul(rows, vload(room->total + i)));
    }
    apart(means, colours);
    for (int axis = 0; how->terms > 1 && axis < AXES; axis++)
        axes[axis] = widened(&how->pixels, how->direction + (band * AXES + (size_t)axis) * nodes, pixel);
    const vf x = axes[0], y = axes[1], z = axes[2];
    const vf more[5] = {vmul(x, y), vmul(y, z), vmul(x, z), vsub(vmul(x, x), vmul(y, y)), vmul(z, z)};
    if (mode != SUM_EXCESS) weight = widened(&how->pixels, how->weight + band * nodes, pixel);
    for (int c = 0; c < 3; c++) {
        if (mode == SUM_EXCESS)
            weight = widened(&how->pixels, how->painted + (band * 3 + (size_t)c) * nodes, pixel);
        const vf v = vmul(weight, colours[c]);
        vf *sum = sums[c];
        sum[0] = vadd(sum[0], v);
        for (int axis = 0; how->terms > 1 && axis < AXES; axis++) sum[1 + axis] = vfma(v, axes[axis], sum[1 + axis]);
        for (int k = 0; how->terms > 4 && k < 5; k++) sum[4 + k] = vfma(v, more[k], sum[4 + k]);
    }
}

INLINE void gather(int mode, const struct procam_frame *how, struct room *room, size_t band, size_t first,
                   double (*to)[FRAME_TERMS][LANES]) {
    vf sums[3][FRAME_TERMS];
    for (int c = 0; c < 3; c++)
        for (int term = 0; term < how->terms; term++) sums[c][term] = vset(0.0f);
    for (size_t at = 0; at < FRAME_STRIP; at += 3 * LANES) {
        const size_t block = at / FRAME_BLOCK, other = (at + 3 * LANES - 1) / FRAME_BLOCK;
        if (room->whole[block] || room->mixed[block] || room->whole[other] || room->mixed[other])
            gather_pixels(mode, how, room, band, at, (first + at) / 3, sums);
    }
    for (size_t block = 0; block < STRIP_BLOCKS; block++) {
        const size_t at = block * FRAME_BLOCK, bytes = FRAME_BLOCK * sizeof(float);
        if (!room->whole[block] && !room->mixed[block]) continue;
        memset(room->total + at, 0, bytes);
        if (room->mixed[block]) memset(room->count + at, 0, bytes);
        room->whole[block] = room->mixed[block] = 0;
    }
    for (int c = 0; c < 3; c++)
        for (int term = 0; term < how->terms; term++) {
            float lanes[LANES];
            memcpy(lanes, &sums[c][term], sizeof lanes);
            for (int lane = 0; lane < LANES; lane++) to[c][term][lane] += (double)lanes[lane];
        }
}

INLINE void frame_of_kind(int kind, int mode, const struct procam_frame *how, size_t strip,
                          size_t chunk, double *to) {
    struct room room;
    double sums[3][FRAME_TERMS][LANES] = {0};
    const size_t total = 3 * how->size, first = strip * FRAME_STRIP, wide = (total + FRAME_BLOCK - 1) / FRAME_BLOCK;
    const size_t intervals = (size_t)how->nodes + 1, last = (size_t)how->nodes - 1, begin = chunk * FRAME_CHUNK;
    const size_t end = begin + FRAME_CHUNK < intervals ? begin + FRAME_CHUNK : intervals;
    memset(&room, 0, sizeof room);
    for (size_t block = 0; block < STRIP_BLOCKS; block++) room.row[block] = intervals; /* none */
    for (size_t interval = begin; interval < end; interval++) { /* between nodes interval - 1 and it */
        const size_t above = interval ? interval - 1 : 0, below = interval < last ? interval : last;
        struct rows part = {.row = (size_t)how->rows[interval], .end = (size_t)how->rows[interval + 1]};
        for (; part.row < part.end && part.block < STRIP_BLOCKS; part.block++) {
            part.first = first + part.block * FRAME_BLOCK;
            if (part.first >= total) break;
            part.left = total - part.first < FRAME_BLOCK ? total - part.first : FRAME_BLOCK;
            part.lit = how->lit[interval * wide + part.first / FRAME_BLOCK];
            one_part(kind, mode, how, &room, &part, above, below);
        }
        if ((interval + 1) % (size_t)how->band == 0 || interval == end - 1)
            gather(mode, how, &room, interval / (size_t)how->band, first, sums);
    }
    for (int c = 0; c < 3; c++)
        for (int term = 0; term < FRAME_TERMS; term++)
            for (int lane = 0; lane < LANES; lane++) to[c * FRAME_TERMS + term] += sums[c][term][lane];
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
