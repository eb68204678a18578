/* The cells of a dome master: a block's rows between two rows of nodes.

   Fields are interpolated along a node row as a cell is entered, which the next cell below finds, and
   down the cell for every row of the picture. Values stay interleaved, red, green, blue. Each goes in
   shares to the upper and lower edge of its band of intervals, as far as the cell is down there.

   Every way to do a cell is a function of its own, into which what they share is inlined. */

enum { FRAME_STRIP = 1536 }; /* values: 512 pixels */
enum { STRIP_BLOCKS = FRAME_STRIP / FRAME_BLOCK, STEP = 16 };
enum plane { LIGHT, LEAST, MOST, GAIN, AREA, PLANES };
enum { AHEAD = 8, NODES_AHEAD = 2 }; /* rows of the picture, of nodes, that are fetched ahead */
enum { GAINED = HELD + 1, WAYS };    /* way of cells with a gain, lit everywhere */

struct edge { /* of bands, in one strip: what falls to it */
    float plain[FRAME_STRIP], weighed[FRAME_STRIP]; /* the latter times the area of each pixel */
    uint8_t lit[STRIP_BLOCKS];                      /* bits: either is there */
} __attribute__((aligned(64)));

struct room { /* of one strip */
    float below[PLANES][FRAME_STRIP]; /* fields along node row `row` of each block, of `planes` (bits) */
    struct edge edges[2];             /* of a band, the upper one is number `upper` */
    size_t upper, row[STRIP_BLOCKS];
    uint8_t planes[STRIP_BLOCKS];
    int mode;
} __attribute__((aligned(64)));

struct cell {
    size_t first, left, block, row, end; /* value, values, number in the strip, rows of the picture */
    size_t above, below;                 /* node rows */
    float from, share;                   /* of its band: where the interval begins, how much it is */
    enum lit lit;
    float count, down, squares; /* of the rows: how far down they lie in all, and its squares */
};

struct way { /* how a cell is done; known to the compiler, but for the mode of rarer tasks */
    int kind, mode;
    enum lit lit;
    enum { NEVER, MAYBE, SURELY } limits, gains; /* whether there are upper ones, a gain */
};

struct ramp { /* a field in a block, between two node rows */
    vf at[VECTORS], step[VECTORS];
};

struct tally { /* of a cell: what is kept; the same times how far down it lies */
    vf sum[VECTORS], down[VECTORS];
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

INLINE vf widened_in(const struct columns *columns, struct window window) {
    const vf left = vpick(window, columns->left), right = vpick(window, columns->right);
    return vfma(columns->across, vsub(right, left), left);
}

INLINE vf widened(const struct columns *columns, const float *row) {
    return widened_in(columns, window_at(row + columns->start));
}

INLINE const float *node_row(const struct procam_frame *how, int plane, size_t row) {
    const float *const planes[] = {how->light, how->least, how->most, how->gain, how->area};
    return planes[plane] + row * (size_t)how->nodes * (plane < GAIN ? 3 : 1);
}

INLINE int has(struct way way, const struct procam_frame *how, int plane) {
    return way.lit == NOWHERE ? 0
           : plane == MOST ? way.limits == SURELY || (way.limits && how->most)
           : plane == GAIN ? way.gains == SURELY || (way.gains && how->gain)
           : plane == AREA ? way.lit == IN_PART
                           : 1;
}

/* The planes of a way along the node row above a cell, where the one above has not left them. */
INLINE void start_row(struct way way, const struct procam_frame *how, struct room *room, const struct cell *cell) {
    for (int plane = 0; plane < PLANES; plane++) {
        if (!has(way, how, plane)) continue;
        const struct places *places = plane < GAIN ? &how->values : &how->shared;
        for (size_t k = 0; k < FRAME_BLOCK; k += LANES) {
            const struct columns columns = columns_from(places, cell->first + k);
            vstore(room->below[plane] + cell->block * FRAME_BLOCK + k,
                   widened(&columns, node_row(how, plane, cell->above)));
        }
    }
}

struct field { /* in a cell; all of them are made before anything is stored, which might change what they come from */
    const float *below, *next; /* node rows, the second to come soon */
    float *kept;
    struct window window; /* of `below` */
};

INLINE struct field field_of(const struct procam_frame *how, struct room *room, const struct cell *cell, int plane,
                             size_t start) {
    const size_t last = (size_t)how->nodes - 1, next = cell->below + NODES_AHEAD;
    const float *below = node_row(how, plane, cell->below);
    return (struct field){below, node_row(how, plane, next < last ? next : last),
                          room->below[plane] + cell->block * FRAME_BLOCK, window_at(below + start)};
}

INLINE void enter(int same, const struct columns *columns, const struct field *field, int k, struct ramp *ramp) {
    float *kept = field->kept + k * LANES;
    const vf above = vload(kept), below = same ? widened_in(columns, field->window) : widened(columns, field->below);
    ramp->at[k] = above;
    ramp->step[k] = vsub(below, above);
    vstore(kept, below);
    fetch(field->next + columns->start);
}

/* Fields that lie at the same places, from one window if all of the block does. */
INLINE void enter_some(int same, struct way way, const struct procam_frame *how, const struct places *places,
                       size_t first, const struct field *fields, int begin, int end, struct ramp *ramps) {
    UNROLL for (int k = 0; k < VECTORS; k++) {
        const struct columns columns = columns_from(places, first + (size_t)k * LANES);
        for (int plane = begin; plane < end; plane++)
            if (has(way, how, plane)) enter(same, &columns, fields + plane, k, ramps + plane);
    }
}

/* Fields `begin` to `end`, which lie at the same places. */
INLINE void enter_all(struct way way, const struct procam_frame *how, struct room *room, const struct cell *cell,
                      int begin, int end, struct ramp *ramps) {
    const struct places places = begin < GAIN ? how->values : how->shared;
    const size_t first = cell->first, start = (size_t)places.start[first / STEP];
    struct field fields[PLANES];
    for (int plane = begin; plane < end; plane++)
        if (has(way, how, plane)) fields[plane] = field_of(how, room, cell, plane, start);
    if ((size_t)places.start[first / STEP + FRAME_BLOCK / STEP - 1] == start)
        enter_some(1, way, how, &places, first, fields, begin, end, ramps);
    else enter_some(0, way, how, &places, first, fields, begin, end, ramps);
}

INLINE vf between(const struct ramp *ramp, int k, vf down) { return vfma(down, ramp->step[k], ramp->at[k]); }

/* What a mode keeps of one vector. */
INLINE vf kept(struct way way, const struct procam_frame *how, const struct ramp *ramps, int k, vf down, vf content) {
    const vf light = between(ramps + LIGHT, k, down);
    const vf wanted = has(way, how, GAIN) ? vfms(content, between(ramps + GAIN, k, down), light) : vsub(content, light);
    if (way.mode == SUM_CONTENT) return wanted;
    const vf least = between(ramps + LEAST, k, down), one = vset(1.0f), none = vset(0.0f);
    vf most = vset(how->top);
    if (has(way, how, MOST)) most = vmin(most, between(ramps + MOST, k, down));
    if (way.mode == COUNT_LEAST) return vsel(vlt(least, wanted), none, one);
    if (way.mode == COUNT_MOST) return vsel(vlt(wanted, most), none, one);
    const vf sent = vmin(vmax(wanted, least), most);
    return way.mode == SUM_EXCESS ? vsub(sent, wanted) : sent;
}

/* One row of a block, from its content to what is kept. */
INLINE void one_row(struct way way, const struct procam_frame *how, const struct ramp *ramps, vf down, vf *values,
                    struct tally *tally) {
    const vf none = vset(0.0f);
    UNROLL for (int k = 0; k < VECTORS; k++) {
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

/* The same where `brief` has been, which turned limits of light to send into limits of content. */
INLINE void brief_row(struct way way, const struct ramp *ramps, vf down, const vf *content, struct tally *tally) {
    UNROLL for (int k = 0; k < VECTORS; k++) {
        vf total = vmax(content[k], between(ramps + LEAST, k, down));
        if (way.limits) total = vmin(total, between(ramps + MOST, k, down));
        tally->sum[k] = vadd(tally->sum[k], total);
        tally->down[k] = vfma(down, total, tally->down[k]);
    }
}

/* Light to send, clip(content - light, least, most), is clip(content, light + least, light + most) less
   the light, whose sums its ramps tell: makes ramps of those limits, and a tally of less light. */
INLINE void brief(struct way way, const struct cell *cell, struct ramp *ramps, struct tally *tally) {
    const struct ramp *light = ramps + LIGHT;
    const vf count = vset(-cell->count), down = vset(-cell->down), squares = vset(-cell->squares);
    UNROLL for (int k = 0; k < VECTORS; k++) {
        tally->sum[k] = vfma(down, light->step[k], vmul(count, light->at[k]));
        tally->down[k] = vfma(squares, light->step[k], vmul(down, light->at[k]));
        for (int plane = LEAST; plane <= (way.limits ? MOST : LEAST); plane++) {
            ramps[plane].at[k] = vadd(ramps[plane].at[k], light->at[k]);
            ramps[plane].step[k] = vadd(ramps[plane].step[k], light->step[k]);
        }
    }
}

/* Whether sums are made so: light below 0 could lift what is sent above `top`. */
INLINE int is_brief(struct way way, const struct procam_frame *how, const struct ramp *light) {
    vf least = vset(0.0f);
    if (way.mode != SUM_LIGHT || way.kind == F32 || way.lit < EVERYWHERE || way.gains || !how->brief) return 0;
    for (int k = 0; k < VECTORS; k++) least = vmin(least, vmin(light->at[k], vadd(light->at[k], light->step[k])));
    return !vany(vlt(least, vset(0.0f)));
}

/* The rows of a whole block; content is read a row ahead of its use. */
INLINE struct tally whole_rows(struct way way, int briefly, const struct procam_frame *how, const struct cell *cell,
                               const struct ramp *ramps, struct tally tally) {
    const size_t width = bytes_of(way.kind), pitch = 3 * how->size * width, end = cell->end;
    const size_t start = cell->row * pitch + cell->first * width, column = cell->first % TILE_WIDTH;
    const unsigned char *from = (const unsigned char *)how->image + start;
    unsigned char *to = way.mode == APPLY ? (unsigned char *)how->out + start : NULL;
    vf next[VECTORS], values[VECTORS];
    load_block(way.kind, how, from, next);
    for (size_t y = cell->row; y < end; y++, from += pitch) {
        const float *tile = how->threshold + y % TILE_ROWS * TILE_WIDTH + column;
        for (size_t ahead = 0; y + AHEAD < how->size && ahead < FRAME_BLOCK * width; ahead += 64)
            fetch(from + AHEAD * pitch + ahead);
        UNROLL for (int k = 0; k < VECTORS; k++) values[k] = next[k];
        if (y + 1 < end) load_block(way.kind, how, from + pitch, next);
        if (briefly) brief_row(way, ramps, vset(how->down[y]), values, &tally);
        else one_row(way, how, ramps, vset(how->down[y]), values, &tally);
        if (way.mode != APPLY) continue;
        store_block(way.kind, how, from, tile, values, to);
        to += pitch;
    }
    return tally;
}

/* The rows of the block at the picture's right edge. */
INLINE struct tally edge_rows(struct way way, const struct procam_frame *how, const struct cell *cell,
                              const struct ramp *ramps, struct tally tally) {
    const size_t width = bytes_of(way.kind), pitch = 3 * how->size * width, bytes = cell->left * width;
    unsigned char in[FRAME_BLOCK * 4] = {0}, out[FRAME_BLOCK * 4];
    for (size_t y = cell->row; y < cell->end; y++) {
        const size_t start = y * pitch + cell->first * width;
        const float *tile = how->threshold + y % TILE_ROWS * TILE_WIDTH + cell->first % TILE_WIDTH;
        vf values[VECTORS];
        memcpy(in, (const unsigned char *)how->image + start, bytes);
        load_block(way.kind, how, in, values);
        one_row(way, how, ramps, vset(how->down[y]), values, &tally);
        if (way.mode != APPLY) continue;
        store_block(way.kind, how, in, tile, values, out);
        memcpy((unsigned char *)how->out + start, out, bytes);
    }
    return tally;
}

/* A cell's share to both edges of its band. */
INLINE void add_up(struct room *room, const struct cell *cell, const struct tally *tally) {
    const size_t first = cell->block * FRAME_BLOCK, bytes = (FRAME_BLOCK - cell->left) * sizeof(float);
    const vf share = vset(cell->share), from = vset(cell->from);
    struct edge *edges[] = {room->edges + room->upper, room->edges + !room->upper};
    float *to[2];
    for (int e = 0; e < 2; e++) {
        to[e] = (cell->lit == IN_PART ? edges[e]->weighed : edges[e]->plain) + first;
        edges[e]->lit[cell->block] |= (uint8_t)(1 << cell->lit);
    }
    for (int k = 0; k < VECTORS; k++) {
        const vf lower = vfma(share, tally->down[k], vmul(from, tally->sum[k]));
        float *above = to[0] + (size_t)k * LANES, *below = to[1] + (size_t)k * LANES;
        vstore(above, vadd(vload(above), vsub(tally->sum[k], lower)));
        vstore(below, vadd(vload(below), lower));
    }
    for (int e = 0; e < 2 && bytes; e++) memset(to[e] + cell->left, 0, bytes);
}

INLINE void one_cell(struct way way, const struct procam_frame *how, struct room *room, const struct cell *cell) {
    struct ramp ramps[PLANES];
    struct tally tally;
    uint8_t planes = 0;
    UNROLL for (int k = 0; k < VECTORS; k++) tally.sum[k] = tally.down[k] = vset(0.0f);
    for (int plane = 0; plane < PLANES; plane++) planes |= (uint8_t)(has(way, how, plane) << plane);
    const int found = room->row[cell->block] == cell->above && !(planes & ~room->planes[cell->block]);
    if (!found) start_row(way, how, room, cell);
    enter_all(way, how, room, cell, LIGHT, GAIN, ramps);
    if (has(way, how, GAIN) || has(way, how, AREA)) enter_all(way, how, room, cell, GAIN, PLANES, ramps);
    if (cell->left < FRAME_BLOCK) tally = edge_rows(way, how, cell, ramps, tally);
    else if (is_brief(way, how, ramps + LIGHT)) {
        brief(way, cell, ramps, &tally);
        tally = whole_rows(way, 1, how, cell, ramps, tally);
    } else tally = whole_rows(way, 0, how, cell, ramps, tally);
    if (way.lit == NOWHERE) return;
    room->row[cell->block] = cell->below;
    room->planes[cell->block] = planes;
    add_up(room, cell, &tally);
}

typedef void cells_way(const struct procam_frame *how, struct room *room, const struct cell *first, size_t count);
#define CELL(name, ...) \
    static __attribute__((noinline)) void name(const struct procam_frame *given, struct room *room, \
                                               const struct cell *first, size_t count) { \
        const struct procam_frame how = *given; /* which nothing that is stored can change */ \
        struct cell cell = *first; \
        for (; count; count--, cell.block++, cell.first += FRAME_BLOCK) \
            one_cell((struct way){__VA_ARGS__}, &how, room, &cell); \
    }
#define LIT_CELLS(name, kind, mode) \
    CELL(name##_in_part, kind, mode, IN_PART, MAYBE, MAYBE) \
    CELL(name##_everywhere, kind, mode, EVERYWHERE, NEVER, NEVER) \
    CELL(name##_held, kind, mode, HELD, SURELY, NEVER) \
    CELL(name##_gained, kind, mode, HELD, MAYBE, SURELY)
#define CELLS(kind) \
    LIT_CELLS(sum_##kind, kind, SUM_LIGHT) \
    LIT_CELLS(apply_##kind, kind, APPLY) \
    LIT_CELLS(other_##kind, kind, room->mode) \
    CELL(mix_##kind, kind, APPLY, NOWHERE, NEVER, NEVER)
CELLS(U8)
CELLS(U16)
CELLS(F16)
CELLS(F32)

/* By enum lit, and GAINED; cells that are not lit have a way where the picture is mixed with what came. */
INLINE cells_way *const *ways_of(int kind, int mode) {
#define WAYS_OF(name, nowhere) {nowhere, name##_in_part, name##_everywhere, name##_held, name##_gained}
#define TASKS_OF(kind) \
    [kind] = {WAYS_OF(sum_##kind, NULL), WAYS_OF(apply_##kind, mix_##kind), WAYS_OF(other_##kind, NULL)}
    static cells_way *const ways[4][3][WAYS] = {TASKS_OF(U8), TASKS_OF(U16), TASKS_OF(F16), TASKS_OF(F32)};
    return ways[kind][mode == SUM_LIGHT ? 0 : mode == APPLY ? 1 : 2];
}
