/* A dome master against the model of what bounces: sums of its light, or the light to send.

   Fields lie on a coarse grid of nodes and are interpolated: along node rows once per pair of them (an
   interval), down the interval for every row of the picture. Values stay interleaved, red, green, blue,
   until they are summed up: each goes in shares to the upper and lower edge of its band of intervals,
   where its direction, and its area if all of the band is lit, are those of the node row there. */

enum { FRAME_STRIP = 1536, FRAME_CHUNK = 64 }; /* values, intervals; a strip is 512 pixels */
enum { STRIP_BLOCKS = FRAME_STRIP / FRAME_BLOCK, STEP = 16 };
enum plane { LIGHT, LEAST, MOST, GAIN, AREA, PLANES };
enum { AXES = 3, AHEAD = 8, NODES_AHEAD = 2 }; /* rows that are fetched ahead */

struct edge { /* of bands, in one strip: what falls to it */
    float plain[FRAME_STRIP], weighed[FRAME_STRIP]; /* the latter times the area of each pixel */
    uint8_t lit[STRIP_BLOCKS];                      /* bits: either is there */
} __attribute__((aligned(64)));

struct room { /* of one strip */
    float below[PLANES][FRAME_STRIP];               /* node row `row` of each block */
    struct edge edges[2];                           /* of a band, the upper one is number `upper` */
    size_t upper, row[STRIP_BLOCKS];
    uint8_t area[STRIP_BLOCKS];                     /* AREA is there */
} __attribute__((aligned(64)));

struct ramp { /* a field in a block, between two node rows */
    vf at[VECTORS], step[VECTORS];
};

struct columns { /* of one vector, among the nodes of a row */
    size_t start;
    vi left, right;
    vf across;
};

INLINE struct columns columns_from(const struct places *places, size_t i) {
    const vi pair = vload_i(places->pair + i);
    return (struct columns){(size_t)places->start[i / STEP], pair, vright(pair, 8), vload(places->across + i)};
}

INLINE vf widened(const struct columns *columns, const float *row) {
    const float *from = row + columns->start;
    const vf left = vpick(from, columns->left), right = vpick(from, columns->right);
    return vfma(columns->across, vsub(right, left), left);
}

struct cell { /* of a picture: a block's rows between two node rows */
    size_t first, left, block, row, end; /* value, values, number in the strip, rows */
    size_t above, below;                 /* node rows */
    size_t order;                        /* of the interval in its band */
    int lit;
};

struct field { /* in a cell */
    const float *above, *below, *next; /* node rows, the last to come soon */
    float *kept;                       /* holds `above` where it is known, then `below` */
    int known;
};

INLINE struct field field_of(const struct procam_frame *how, const float *nodes, size_t colours,
                             const struct cell *cell, float *kept, int known) {
    const size_t width = colours * (size_t)how->nodes, last = (size_t)how->nodes - 1;
    const size_t next = cell->below + NODES_AHEAD < last ? cell->below + NODES_AHEAD : last;
    return (struct field){nodes + cell->above * width, nodes + cell->below * width, nodes + next * width,
                          kept + cell->block * FRAME_BLOCK, known};
}

INLINE void enter(const struct columns *columns, const struct field *field, int k, struct ramp *ramp) {
    float *kept = field->kept + (size_t)k * LANES;
    const vf below = widened(columns, field->below);
    ramp->at[k] = field->known ? vload(kept) : widened(columns, field->above);
    ramp->step[k] = vsub(below, ramp->at[k]);
    vstore(kept, below);
    fetch(field->next + columns->start);
}

struct way { /* how a cell is done; known to the compiler */
    int kind, mode, lit;
    int plain; /* neither gain nor `most` */
};

INLINE void enter_all(struct way way, const struct procam_frame *how, struct room *room, const struct cell *cell,
                      struct ramp *ramps) {
    const int known = room->row[cell->block] == cell->above, measured = known && room->area[cell->block];
    const struct field light = field_of(how, how->light, 3, cell, room->below[LIGHT], known);
    const struct field least = field_of(how, how->least, 3, cell, room->below[LEAST], known);
    const struct field area = field_of(how, how->area, 1, cell, room->below[AREA], measured);
    const int limits = !way.plain && how->most, gains = !way.plain && how->gain, weighs = way.lit == IN_PART;
    struct field most = {0}, gain = {0};
    if (limits) most = field_of(how, how->most, 3, cell, room->below[MOST], known);
    if (gains) gain = field_of(how, how->gain, 1, cell, room->below[GAIN], known);
    for (int k = 0; k < VECTORS; k++) {
        const struct columns columns = columns_from(&how->values, cell->first + (size_t)k * LANES);
        enter(&columns, &light, k, ramps + LIGHT);
        enter(&columns, &least, k, ramps + LEAST);
        if (limits) enter(&columns, &most, k, ramps + MOST);
    }
    for (int k = 0; (gains || weighs) && k < VECTORS; k++) {
        const struct columns columns = columns_from(&how->shared, cell->first + (size_t)k * LANES);
        if (weighs) enter(&columns, &area, k, ramps + AREA);
        if (gains) enter(&columns, &gain, k, ramps + GAIN);
    }
    room->row[cell->block] = cell->below;
    room->area[cell->block] = weighs;
}

INLINE vf between(const struct ramp *ramp, int k, vf down) { return vfma(down, ramp->step[k], ramp->at[k]); }

/* What a mode keeps of one vector. */
INLINE vf kept(struct way way, const struct procam_frame *how, const struct ramp *ramps, int k, vf down, vf content) {
    const vf light = between(ramps + LIGHT, k, down);
    const int gains = !way.plain && how->gain;
    const vf wanted = gains ? vfms(content, between(ramps + GAIN, k, down), light) : vsub(content, light);
    if (way.mode == SUM_CONTENT) return wanted;
    const vf least = between(ramps + LEAST, k, down), one = vset(1.0f), none = vset(0.0f);
    vf most = vset(how->top);
    if (!way.plain && how->most) most = vmin(most, between(ramps + MOST, k, down));
    if (way.mode == COUNT_LEAST) return vsel(vlt(least, wanted), none, one);
    if (way.mode == COUNT_MOST) return vsel(vlt(wanted, most), none, one);
    const vf sent = vmin(vmax(wanted, least), most);
    return way.mode == SUM_EXCESS ? vsub(sent, wanted) : sent;
}

struct tally { /* of a cell: what is kept; the same times how far down it lies */
    vf sum[VECTORS], down[VECTORS];
};

/* One row of a block, from its content to what is kept. */
INLINE void one_row(struct way way, const struct procam_frame *how, const struct ramp *ramps, vf down, vf *values,
                    struct tally *tally) {
    const vf none = vset(0.0f);
    for (int k = 0; k < VECTORS; k++) {
        vf counted = values[k] = way.lit == NOWHERE ? none : kept(way, how, ramps, k, down, values[k]);
        if (way.lit == IN_PART) {
            const vf area = between(ramps + AREA, k, down);
            values[k] = vsel(vlt(none, area), values[k], none);
            counted = vmul(area, values[k]);
        }
        tally->sum[k] = vadd(tally->sum[k], counted);
        tally->down[k] = vfma(down, counted, tally->down[k]);
    }
}

/* The rows of a whole block; content is read a row ahead of its use. */
INLINE void whole_rows(struct way way, const struct procam_frame *how, const struct cell *cell,
                       const struct ramp *ramps, struct tally *tally) {
    const size_t width = bytes_of(way.kind), pitch = 3 * how->size * width;
    const size_t start = cell->row * pitch + cell->first * width;
    const unsigned char *from = (const unsigned char *)how->image + start;
    unsigned char *to = way.mode == APPLY ? (unsigned char *)how->out + start : NULL;
    vf next[VECTORS], values[VECTORS];
    load_block(way.kind, how, from, next);
    for (size_t y = cell->row; y < cell->end; y++, from += pitch) {
        const float *tile = how->threshold + y % TILE_ROWS * TILE_WIDTH + cell->first % TILE_WIDTH;
        for (size_t ahead = 0; y + AHEAD < how->size && ahead < FRAME_BLOCK * width; ahead += 64)
            fetch(from + AHEAD * pitch + ahead);
        memcpy(values, next, sizeof values);
        if (y + 1 < cell->end) load_block(way.kind, how, from + pitch, next);
        one_row(way, how, ramps, vset(how->down[y]), values, tally);
        if (way.mode != APPLY) continue;
        store_block(way.kind, how, from, tile, values, to);
        to += pitch;
    }
}

/* The rows of the block at the picture's right edge. */
INLINE void edge_rows(struct way way, const struct procam_frame *how, const struct cell *cell,
                      const struct ramp *ramps, struct tally *tally) {
    const size_t width = bytes_of(way.kind), pitch = 3 * how->size * width, bytes = cell->left * width;
    unsigned char in[FRAME_BLOCK * 4] = {0}, out[FRAME_BLOCK * 4];
    for (size_t y = cell->row; y < cell->end; y++) {
        const size_t start = y * pitch + cell->first * width;
        const float *tile = how->threshold + y % TILE_ROWS * TILE_WIDTH + cell->first % TILE_WIDTH;
        vf values[VECTORS];
        memcpy(in, (const unsigned char *)how->image + start, bytes);
        load_block(way.kind, how, in, values);
        one_row(way, how, ramps, vset(how->down[y]), values, tally);
        if (way.mode != APPLY) continue;
        store_block(way.kind, how, in, tile, values, out);
        memcpy((unsigned char *)how->out + start, out, bytes);
    }
}

INLINE void clear_rows(int kind, const struct procam_frame *how, const struct cell *cell) {
    const size_t width = bytes_of(kind), pitch = 3 * how->size * width;
    unsigned char *to = (unsigned char *)how->out + cell->row * pitch + cell->first * width;
    for (size_t y = cell->row; y < cell->end; y++, to += pitch) clear(to, cell->left * width);
}

/* A cell's share to both edges of its band. */
INLINE void add_up(const struct procam_frame *how, struct room *room, const struct cell *cell,
                   const struct tally *tally) {
    const size_t first = cell->block * FRAME_BLOCK, bytes = (FRAME_BLOCK - cell->left) * sizeof(float);
    const vf step = vset(1.0f / (float)how->band), start = vset((float)cell->order / (float)how->band);
    struct edge *edges[] = {room->edges + room->upper, room->edges + !room->upper};
    float *to[2];
    for (int e = 0; e < 2; e++) {
        to[e] = (cell->lit == IN_PART ? edges[e]->weighed : edges[e]->plain) + first;
        edges[e]->lit[cell->block] |= (uint8_t)(1 << cell->lit);
    }
    for (int k = 0; k < VECTORS; k++) {
        const vf lower = vfma(step, tally->down[k], vmul(start, tally->sum[k]));
        float *above = to[0] + (size_t)k * LANES, *below = to[1] + (size_t)k * LANES;
        vstore(above, vadd(vload(above), vsub(tally->sum[k], lower)));
        vstore(below, vadd(vload(below), lower));
    }
    for (int e = 0; e < 2 && bytes; e++) memset(to[e] + cell->left, 0, bytes);
}

INLINE void one_way(struct way way, const struct procam_frame *how, struct room *room, const struct cell *cell) {
    struct ramp ramps[PLANES];
    struct tally tally;
    for (int k = 0; k < VECTORS; k++) tally.sum[k] = tally.down[k] = vset(0.0f);
    if (way.lit != NOWHERE) enter_all(way, how, room, cell, ramps);
    if (cell->left == FRAME_BLOCK) whole_rows(way, how, cell, ramps, &tally);
    else edge_rows(way, how, cell, ramps, &tally);
    if (way.lit != NOWHERE) add_up(how, room, cell, &tally);
}

INLINE void one_cell(int kind, int mode, const struct procam_frame *how, struct room *room,
                     const struct cell *cell) {
    const int plain = !how->gain && !how->most;
    if (cell->lit == EVERYWHERE && plain) one_way((struct way){kind, mode, EVERYWHERE, 1}, how, room, cell);
    else if (cell->lit == EVERYWHERE) one_way((struct way){kind, mode, EVERYWHERE, 0}, how, room, cell);
    else if (cell->lit == IN_PART) one_way((struct way){kind, mode, IN_PART, 0}, how, room, cell);
    else if (mode == APPLY && how->strength < 1) one_way((struct way){kind, mode, NOWHERE, 0}, how, room, cell);
    else if (mode == APPLY) clear_rows(kind, how, cell);
}

/* The colours of LANES pixels, one by one. */
INLINE void apart(const float *from, vf *colours) {
#if LEVEL == 512
    const __m512i step = _mm512_set_epi32(45, 42, 39, 36, 33, 30, 27, 24, 21, 18, 15, 12, 9, 6, 3, 0);
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

/* Adds what falls to an edge to the sums of each colour and term, LANES pixels at a time. */
INLINE void gather_pixels(int mode, const struct procam_frame *how, const struct edge *edge, size_t number,
                          size_t at, size_t pixel, vf (*sums)[FRAME_TERMS]) {
    const size_t nodes = (size_t)how->nodes;
    const int lit = edge->lit[at / FRAME_BLOCK] | edge->lit[(at + 3 * LANES - 1) / FRAME_BLOCK];
    if (!lit) return;
    const struct columns columns = columns_from(&how->pixels, pixel);
    const vf weight = widened(&columns, how->weight + number * nodes), none = vset(0.0f);
    vf plain[3], weighed[3] = {none, none, none}, axes[AXES] = {none, none, none};
    apart(edge->plain + at, plain);
    if (lit & 1 << IN_PART) apart(edge->weighed + at, weighed);
    for (int axis = 0; how->terms > 1 && axis < AXES; axis++)
        axes[axis] = widened(&columns, how->direction + (number * AXES + (size_t)axis) * nodes);
    const vf x = axes[0], y = axes[1], z = axes[2];
    const vf more[5] = {vmul(x, y), vmul(y, z), vmul(x, z), vsub(vmul(x, x), vmul(y, y)), vmul(z, z)};
    for (int c = 0; c < 3; c++) {
        vf *sum = sums[c], v = vfma(weight, plain[c], weighed[c]);
        if (mode == SUM_EXCESS) v = vmul(v, widened(&columns, how->paint + (number * 3 + (size_t)c) * nodes));
        sum[0] = vadd(sum[0], v);
        for (int axis = 0; how->terms > 1 && axis < AXES; axis++) sum[1 + axis] = vfma(v, axes[axis], sum[1 + axis]);
        for (int k = 0; how->terms > 4 && k < 5; k++) sum[4 + k] = vfma(v, more[k], sum[4 + k]);
    }
}

/* Empties a band's upper edge; the lower one is the next band's upper one. */
INLINE void gather(int mode, const struct procam_frame *how, struct room *room, size_t number, size_t first,
                   double (*to)[FRAME_TERMS][LANES]) {
    struct edge *edge = room->edges + room->upper;
    vf sums[3][FRAME_TERMS];
    for (int c = 0; c < 3; c++)
        for (int term = 0; term < how->terms; term++) sums[c][term] = vset(0.0f);
    for (size_t at = 0; at < FRAME_STRIP; at += 3 * LANES)
        gather_pixels(mode, how, edge, number, at, (first + at) / 3, sums);
    for (size_t block = 0; block < STRIP_BLOCKS; block++) {
        const size_t at = block * FRAME_BLOCK, bytes = FRAME_BLOCK * sizeof(float);
        if (edge->lit[block]) memset(edge->plain + at, 0, bytes);
        if (edge->lit[block] & 1 << IN_PART) memset(edge->weighed + at, 0, bytes);
        edge->lit[block] = 0;
    }
    room->upper = !room->upper;
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
        struct cell cell = {.row = (size_t)how->rows[interval], .end = (size_t)how->rows[interval + 1]};
        const size_t band = interval / (size_t)how->band;
        cell.above = above, cell.below = below, cell.order = interval % (size_t)how->band;
        for (; cell.row < cell.end && cell.block < STRIP_BLOCKS; cell.block++) {
            cell.first = first + cell.block * FRAME_BLOCK;
            if (cell.first >= total) break;
            cell.left = total - cell.first < FRAME_BLOCK ? total - cell.first : FRAME_BLOCK;
            cell.lit = how->lit[interval * wide + cell.first / FRAME_BLOCK];
            one_cell(kind, mode, how, &room, &cell);
        }
        if ((interval + 1) % (size_t)how->band == 0 || interval == end - 1) gather(mode, how, &room, band, first, sums);
        if (interval == end - 1) gather(mode, how, &room, band + 1, first, sums);
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
