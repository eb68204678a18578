/* The inner loop of a frame: one cell, a block of 64 values by the picture's rows between two node rows.

       node row  o---------o---------o      Fields are known at the nodes (o). They are interpolated
                 |.........|.........|      along the lower node row when a cell is entered (the cell
                 |.........|.........|      below reuses that), and then down the cell for each row of
       node row  o---------o---------o      the picture (.).

   Values stay interleaved: red, green, blue. Sums of a cell are split between the upper and the lower
   edge of its band, in proportion to the rows' distance from them (frame.h).

   Type, mode and limits are constants to the compiler: each combination (`struct variant`) is a
   function of its own, made by the CELL macros at the end of this file. */

enum { FRAME_STRIP = 1536 }; /* values: 512 pixels */
enum { STRIP_BLOCKS = FRAME_STRIP / FRAME_BLOCK, STEP = 16 };
enum plane { LIGHT, LEAST, MOST, GAIN, AREA, PLANES };
enum { AHEAD = 8, NODES_AHEAD = 2 }; /* rows of the picture and of nodes to prefetch */
enum { GAINED = LIMITED + 1, VARIANTS };    /* variant of cells with a gain, lit everywhere */

struct edge { /* of a band, in one strip: the sums assigned to it */
    float plain[FRAME_STRIP], weighed[FRAME_STRIP]; /* the latter times the area of each pixel */
    uint8_t lit[STRIP_BLOCKS];                      /* bits: which of the two are in use */
} __attribute__((aligned(64)));

struct workspace { /* of one strip */
    float below[PLANES][FRAME_STRIP]; /* fields along node row `row` of each block, of `planes` (bits) */
    struct edge edges[2];             /* of a band, the upper one is number `upper` */
    size_t upper, row[STRIP_BLOCKS];
    uint8_t planes[STRIP_BLOCKS];
    int mode;
} __attribute__((aligned(64)));

struct cell {
    size_t first, left, block, row, end; /* value, values, number in the strip, rows of the picture */
    size_t above, below;                 /* node rows */
    float from, share;                   /* of its band: where the interval begins, how much of it it covers */
    enum lit lit;
    float count, down, squares; /* sums over the rows: 1, position down the cell, its square */
};

struct variant { /* constants of a cell's function; the mode of rarer tasks is a variable */
    int kind, mode;
    enum lit lit;
    enum { NEVER, MAYBE, SURELY } limits, gains; /* whether there are upper limits, a gain */
};

struct ramp { /* a field in a block, between two node rows */
    vf at[VECTORS], step[VECTORS];
};

struct tally { /* sums of a cell: of the values, and of the values times their position down the cell */
    vf sum[VECTORS], down[VECTORS];
};

struct columns { /* of one vector, among the nodes of a row */
    size_t start;
    vi left, right;
    vf across;
};

INLINE struct columns columns_from(const struct positions *positions, size_t i) {
    const vi pair = vload_i(positions->pair + i);
    return (struct columns){(size_t)positions->start[i / STEP], pair, vshift(pair, 8), vload(positions->across + i)};
}

INLINE vf along_window(const struct columns *columns, struct window window) {
    const vf left = vpick(window, columns->left), right = vpick(window, columns->right);
    return vfma(columns->across, vsub(right, left), left);
}

INLINE vf along_row(const struct columns *columns, const float *row) {
    return along_window(columns, window_at(row + columns->start));
}

INLINE const float *node_row(const struct procam_frame *setup, int plane, size_t row) {
    const float *const planes[] = {setup->light, setup->least, setup->most, setup->gain, setup->area};
    return planes[plane] + row * (size_t)setup->nodes * (plane < GAIN ? 3 : 1);
}

INLINE int has(struct variant variant, const struct procam_frame *setup, int plane) {
    return variant.lit == NOWHERE ? 0
           : plane == MOST ? variant.limits == SURELY || (variant.limits && setup->most)
           : plane == GAIN ? variant.gains == SURELY || (variant.gains && setup->gain)
           : plane == AREA ? variant.lit == IN_PART
                           : 1;
}

/* Interpolates the planes of a variant along the node row above a cell, unless the cell above did. */
INLINE void start_row(struct variant variant, const struct procam_frame *setup, struct workspace *work, const struct cell *cell) {
    for (int plane = 0; plane < PLANES; plane++) {
        if (!has(variant, setup, plane)) continue;
        const struct positions *positions = plane < GAIN ? &setup->values : &setup->shared;
        for (size_t k = 0; k < FRAME_BLOCK; k += LANES) {
            const struct columns columns = columns_from(positions, cell->first + k);
            vstore(work->below[plane] + cell->block * FRAME_BLOCK + k,
                   along_row(&columns, node_row(setup, plane, cell->above)));
        }
    }
}

struct field { /* in a cell; loaded before any store, which the compiler must assume to alias */
    const float *below, *next; /* node rows; the second is to be prefetched */
    float *kept;
    struct window window; /* of `below` */
};

INLINE struct field field_of(const struct procam_frame *setup, struct workspace *work, const struct cell *cell, int plane,
                             size_t start) {
    const size_t last = (size_t)setup->nodes - 1, next = cell->below + NODES_AHEAD;
    const float *below = node_row(setup, plane, cell->below);
    return (struct field){below, node_row(setup, plane, next < last ? next : last),
                          work->below[plane] + cell->block * FRAME_BLOCK, window_at(below + start)};
}

INLINE void enter(int same, const struct columns *columns, const struct field *field, int k, struct ramp *ramp) {
    float *kept = field->kept + k * LANES;
    const vf above = vload(kept), below = same ? along_window(columns, field->window) : along_row(columns, field->below);
    ramp->at[k] = above;
    ramp->step[k] = vsub(below, above);
    vstore(kept, below);
    prefetch(field->next + columns->start);
}

/* Fields at the same positions; `same`: one window of nodes holds the whole block. */
INLINE void enter_some(int same, struct variant variant, const struct procam_frame *setup, const struct positions *positions,
                       size_t first, const struct field *fields, int begin, int end, struct ramp *ramps) {
    UNROLL for (int k = 0; k < VECTORS; k++) {
        const struct columns columns = columns_from(positions, first + (size_t)k * LANES);
        for (int plane = begin; plane < end; plane++)
            if (has(variant, setup, plane)) enter(same, &columns, fields + plane, k, ramps + plane);
    }
}

/* Fields `begin` to `end`, at the same positions. */
INLINE void enter_all(struct variant variant, const struct procam_frame *setup, struct workspace *work, const struct cell *cell,
                      int begin, int end, struct ramp *ramps) {
    const struct positions positions = begin < GAIN ? setup->values : setup->shared;
    const size_t first = cell->first, start = (size_t)positions.start[first / STEP];
    struct field fields[PLANES];
    for (int plane = begin; plane < end; plane++)
        if (has(variant, setup, plane)) fields[plane] = field_of(setup, work, cell, plane, start);
    if ((size_t)positions.start[first / STEP + FRAME_BLOCK / STEP - 1] == start)
        enter_some(1, variant, setup, &positions, first, fields, begin, end, ramps);
    else enter_some(0, variant, setup, &positions, first, fields, begin, end, ramps);
}

INLINE vf between(const struct ramp *ramp, int k, vf down) { return vfma(down, ramp->step[k], ramp->at[k]); }

/* The value of a mode for one vector of content. */
INLINE vf kept(struct variant variant, const struct procam_frame *setup, const struct ramp *ramps, int k, vf down, vf content) {
    const vf light = between(ramps + LIGHT, k, down);
    const vf wanted = has(variant, setup, GAIN) ? vfms(content, between(ramps + GAIN, k, down), light) : vsub(content, light);
    if (variant.mode == SUM_CONTENT) return wanted;
    const vf least = between(ramps + LEAST, k, down), one = vset(1.0f), none = vset(0.0f);
    vf most = vset(setup->top);
    if (has(variant, setup, MOST)) most = vmin(most, between(ramps + MOST, k, down));
    if (variant.mode == COUNT_LEAST) return vsel(vlt(least, wanted), none, one);
    if (variant.mode == COUNT_MOST) return vsel(vlt(wanted, most), none, one);
    const vf sent = vmin(vmax(wanted, least), most);
    return variant.mode == SUM_EXCESS ? vsub(sent, wanted) : sent;
}

/* One row of a block, from its content to the values of the mode. */
INLINE void one_row(struct variant variant, const struct procam_frame *setup, const struct ramp *ramps, vf down, vf *values,
                    struct tally *tally) {
    const vf none = vset(0.0f);
    UNROLL for (int k = 0; k < VECTORS; k++) {
        vf counted = values[k] = variant.lit == NOWHERE ? none : kept(variant, setup, ramps, k, down, values[k]);
        if (variant.lit == IN_PART) {
            const vf area = between(ramps + AREA, k, down);
            values[k] = vsel(vlt(none, area), values[k], none);
            counted = vmul(area, values[k]);
        }
        tally->sum[k] = vadd(tally->sum[k], counted);
        tally->down[k] = vfma(down, counted, tally->down[k]);
    }
}

/* The same after `fold_limits`, which turned limits of light to send into limits of content. */
INLINE void folded_row(struct variant variant, const struct ramp *ramps, vf down, const vf *content, struct tally *tally) {
    UNROLL for (int k = 0; k < VECTORS; k++) {
        vf total = vmax(content[k], between(ramps + LEAST, k, down));
        if (variant.limits) total = vmin(total, between(ramps + MOST, k, down));
        tally->sum[k] = vadd(tally->sum[k], total);
        tally->down[k] = vfma(down, total, tally->down[k]);
    }
}

/* Light to send, clip(content - light, least, most), is clip(content, light + least, light + most) less
   the light, whose sum has a closed form: changes the ramps to those limits, starts the tally at minus
   the light. Saves a subtraction per value. */
INLINE void fold_limits(struct variant variant, const struct cell *cell, struct ramp *ramps, struct tally *tally) {
    const struct ramp *light = ramps + LIGHT;
    const vf count = vset(-cell->count), down = vset(-cell->down), squares = vset(-cell->squares);
    UNROLL for (int k = 0; k < VECTORS; k++) {
        tally->sum[k] = vfma(down, light->step[k], vmul(count, light->at[k]));
        tally->down[k] = vfma(squares, light->step[k], vmul(down, light->at[k]));
        for (int plane = LEAST; plane <= (variant.limits ? MOST : LEAST); plane++) {
            ramps[plane].at[k] = vadd(ramps[plane].at[k], light->at[k]);
            ramps[plane].step[k] = vadd(ramps[plane].step[k], light->step[k]);
        }
    }
}

/* Whether limits may be folded: negative light could raise the light to send above `top`. */
INLINE int can_fold_limits(struct variant variant, const struct procam_frame *setup, const struct ramp *light) {
    vf least = vset(0.0f);
    if (variant.mode != SUM_LIGHT || variant.kind == F32 || variant.lit < EVERYWHERE || variant.gains || !setup->fold_limits) return 0;
    for (int k = 0; k < VECTORS; k++) least = vmin(least, vmin(light->at[k], vadd(light->at[k], light->step[k])));
    return !vany(vlt(least, vset(0.0f)));
}

/* The rows of a whole block; content is loaded one row ahead of its use. */
INLINE struct tally whole_rows(struct variant variant, int folded, const struct procam_frame *setup, const struct cell *cell,
                               const struct ramp *ramps, struct tally tally) {
    const size_t width = bytes_of(variant.kind), pitch = 3 * setup->size * width, end = cell->end;
    const size_t start = cell->row * pitch + cell->first * width, column = cell->first % TILE_WIDTH;
    const unsigned char *from = (const unsigned char *)setup->image + start;
    unsigned char *to = variant.mode == APPLY ? (unsigned char *)setup->out + start : NULL;
    vf next[VECTORS], values[VECTORS];
    load_block(variant.kind, setup, from, next);
    for (size_t y = cell->row; y < end; y++, from += pitch) {
        const float *tile = setup->threshold + y % TILE_ROWS * TILE_WIDTH + column;
        for (size_t ahead = 0; y + AHEAD < setup->size && ahead < FRAME_BLOCK * width; ahead += 64)
            prefetch(from + AHEAD * pitch + ahead);
        UNROLL for (int k = 0; k < VECTORS; k++) values[k] = next[k];
        if (y + 1 < end) load_block(variant.kind, setup, from + pitch, next);
        if (folded) folded_row(variant, ramps, vset(setup->down[y]), values, &tally);
        else one_row(variant, setup, ramps, vset(setup->down[y]), values, &tally);
        if (variant.mode != APPLY) continue;
        store_block(variant.kind, setup, from, tile, values, to);
        to += pitch;
    }
    return tally;
}

/* The rows of the block at the picture's right edge. */
INLINE struct tally edge_rows(struct variant variant, const struct procam_frame *setup, const struct cell *cell,
                              const struct ramp *ramps, struct tally tally) {
    const size_t width = bytes_of(variant.kind), pitch = 3 * setup->size * width, bytes = cell->left * width;
    unsigned char in[FRAME_BLOCK * 4] = {0}, out[FRAME_BLOCK * 4];
    for (size_t y = cell->row; y < cell->end; y++) {
        const size_t start = y * pitch + cell->first * width;
        const float *tile = setup->threshold + y % TILE_ROWS * TILE_WIDTH + cell->first % TILE_WIDTH;
        vf values[VECTORS];
        memcpy(in, (const unsigned char *)setup->image + start, bytes);
        load_block(variant.kind, setup, in, values);
        one_row(variant, setup, ramps, vset(setup->down[y]), values, &tally);
        if (variant.mode != APPLY) continue;
        store_block(variant.kind, setup, in, tile, values, out);
        memcpy((unsigned char *)setup->out + start, out, bytes);
    }
    return tally;
}

/* Splits a cell's sums between both edges of its band. */
INLINE void add_to_edges(struct workspace *work, const struct cell *cell, const struct tally *tally) {
    const size_t first = cell->block * FRAME_BLOCK, bytes = (FRAME_BLOCK - cell->left) * sizeof(float);
    const vf share = vset(cell->share), from = vset(cell->from);
    struct edge *edges[] = {work->edges + work->upper, work->edges + !work->upper};
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

INLINE void one_cell(struct variant variant, const struct procam_frame *setup, struct workspace *work, const struct cell *cell) {
    struct ramp ramps[PLANES];
    struct tally tally;
    uint8_t planes = 0;
    UNROLL for (int k = 0; k < VECTORS; k++) tally.sum[k] = tally.down[k] = vset(0.0f);
    for (int plane = 0; plane < PLANES; plane++) planes |= (uint8_t)(has(variant, setup, plane) << plane);
    const int found = work->row[cell->block] == cell->above && !(planes & ~work->planes[cell->block]);
    if (!found) start_row(variant, setup, work, cell);
    enter_all(variant, setup, work, cell, LIGHT, GAIN, ramps);
    if (has(variant, setup, GAIN) || has(variant, setup, AREA)) enter_all(variant, setup, work, cell, GAIN, PLANES, ramps);
    if (cell->left < FRAME_BLOCK) tally = edge_rows(variant, setup, cell, ramps, tally);
    else if (can_fold_limits(variant, setup, ramps + LIGHT)) {
        fold_limits(variant, cell, ramps, &tally);
        tally = whole_rows(variant, 1, setup, cell, ramps, tally);
    } else tally = whole_rows(variant, 0, setup, cell, ramps, tally);
    if (variant.lit == NOWHERE) return;
    work->row[cell->block] = cell->below;
    work->planes[cell->block] = planes;
    add_to_edges(work, cell, &tally);
}

typedef void cells_variant(const struct procam_frame *setup, struct workspace *work, const struct cell *first, size_t count);
#define CELL(name, ...) \
    static __attribute__((noinline)) void name(const struct procam_frame *given, struct workspace *work, \
                                               const struct cell *first, size_t count) { \
        const struct procam_frame setup = *given; /* a copy, which no store can alias */ \
        struct cell cell = *first; \
        for (; count; count--, cell.block++, cell.first += FRAME_BLOCK) \
            one_cell((struct variant){__VA_ARGS__}, &setup, work, &cell); \
    }
#define LIT_CELLS(name, kind, mode) \
    CELL(name##_in_part, kind, mode, IN_PART, MAYBE, MAYBE) \
    CELL(name##_everywhere, kind, mode, EVERYWHERE, NEVER, NEVER) \
    CELL(name##_limited, kind, mode, LIMITED, SURELY, NEVER) \
    CELL(name##_gained, kind, mode, LIMITED, MAYBE, SURELY)
#define CELLS(kind) \
    LIT_CELLS(sum_##kind, kind, SUM_LIGHT) \
    LIT_CELLS(apply_##kind, kind, APPLY) \
    LIT_CELLS(other_##kind, kind, work->mode) \
    CELL(mix_##kind, kind, APPLY, NOWHERE, NEVER, NEVER)
CELLS(U8)
CELLS(U16)
CELLS(F16)
CELLS(F32)

/* Indexed by enum lit and GAINED; unlit cells need a function only where strength is below 1. */
INLINE cells_variant *const *variants_of(int kind, int mode) {
#define VARIANTS_OF(name, nowhere) {nowhere, name##_in_part, name##_everywhere, name##_limited, name##_gained}
#define TASKS_OF(kind) \
    [kind] = {VARIANTS_OF(sum_##kind, NULL), VARIANTS_OF(apply_##kind, mix_##kind), VARIANTS_OF(other_##kind, NULL)}
    static cells_variant *const variants[4][3][VARIANTS] = {TASKS_OF(U8), TASKS_OF(U16), TASKS_OF(F16), TASKS_OF(F32)};
    return variants[kind][mode == SUM_LIGHT ? 0 : mode == APPLY ? 1 : 2];
}
