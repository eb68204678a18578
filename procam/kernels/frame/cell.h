/* The inner loop of a frame: one cell, a block of 64 values by the picture's rows between two node rows.

       node row  o---------o---------o      Fields are known at the nodes (o). They are interpolated
                 |.........|.........|      along the lower node row when a cell is entered (the cell
                 |.........|.........|      below reuses that), and then down the cell for each row of
       node row  o---------o---------o      the picture (.).

   Values stay interleaved: red, green, blue. A vector of values goes down some rows of a block before the next
   one does, so that its fields and sums stay in registers. 8-bit codes of these rows are decoded before and
   encoded after that, 64 at a time: short chains of operations keep the processor busier than a long one. Rows
   to be written are gathered, as whole lines can be written past the cache. Sums are kept for each band, of the
   values and of the values times their position down the band.

   Type, mode and limits are constants to the compiler: each combination (`struct variant`) is a
   function of its own, made by the CELL macros at the end of this file. */

enum { FRAME_STRIP = 1536 }; /* values: 512 pixels */
enum { STRIP_BLOCKS = FRAME_STRIP / FRAME_BLOCK };
enum { PART_ROWS = 8, AHEAD = 8 }; /* rows of a block at once; from a row that is read to one that is fetched */
enum { LINE_FLOATS = 16 };         /* of a line of the cache */
enum plane { LIGHT, LEAST, MOST, GAIN, AREA, PLANES };
enum { GAINED = LIMITED + 1, VARIANTS };    /* variant of cells with a gain, lit everywhere */

struct band { /* of one strip: sums of values, and of values times the area of each pixel */
    float sum[2][FRAME_STRIP], down[2][FRAME_STRIP]; /* the latter times the position down the band */
    uint8_t lit[STRIP_BLOCKS];                       /* bits (enum lit): which have been added */
} __attribute__((aligned(64)));

struct workspace { /* of one strip */
    float fields[2][PLANES][FRAME_STRIP]; /* along node rows: below an interval, in turn with above it */
    size_t entered[STRIP_BLOCKS];         /* 1 + the last interval whose lower fields a block has */
    uint8_t planes[STRIP_BLOCKS];         /* bits: which fields */
    struct band bands[2];                 /* in turn; number `band` is that of the interval */
    size_t band;
    int mode;
} __attribute__((aligned(64)));

struct cell {
    size_t first, left, block, row, end; /* value, values, number in the strip, rows of the picture */
    size_t interval;
    size_t above, below;                 /* node rows */
    enum lit lit;
};

struct variant { /* constants of a cell's function; the mode of rarer tasks is a variable */
    int kind, mode;
    enum lit lit;
    enum { NEVER, MAYBE, SURELY } limits, gains; /* whether there are upper limits, a gain */
};

struct columns { /* of one vector of values, among the nodes of a row */
    size_t start;
    vi left;
    vf across;
};

struct ramp { /* a field in one vector, down a cell */
    vf at, step;
};

typedef unsigned char line[4 * FRAME_BLOCK]; /* a row of a block, of any type */
struct group { /* rows of a block that are done together */
    size_t y, rows;              /* of the picture */
    const unsigned char *stored; /* content; at the picture's right edge a copy, with zeros after it */
    size_t pitch;                /* bytes from row to row of it */
    line *lines;                 /* of 8 bits: floats, decoded and then to send; of others: as they will be stored */
};

INLINE const float *node_row(const struct procam_frame *setup, int plane, size_t row) {
    const float *const planes[] = {setup->light, setup->least, setup->most, setup->gain, setup->area};
    return planes[plane] + row * (size_t)setup->nodes * (plane < GAIN ? 3 : 1);
}

INLINE struct columns columns_at(const struct positions *positions, size_t i) {
    return (struct columns){(size_t)positions->start[i / LANES], vload_i(positions->left + i), vload(positions->across + i)};
}

/* A field along a row of nodes `step` apart. */
INLINE vf along(const struct columns *columns, const float *row, size_t step) {
    const vf left = vpick(row + columns->start, columns->left), right = vpick(row + columns->start + step, columns->left);
    return columns->across * (right - left) + left;
}

INLINE int has(struct variant variant, const struct procam_frame *setup, int plane) {
    return variant.lit == NOWHERE ? 0
           : plane == MOST ? variant.limits == SURELY || (variant.limits && setup->most)
           : plane == GAIN ? variant.gains == SURELY || (variant.gains && setup->gain)
           : plane == AREA ? variant.lit == IN_PART
                           : 1;
}

/* Interpolates the fields of a variant along one node row. */
INLINE void enter_row(struct variant variant, const struct procam_frame *setup, const struct cell *cell, size_t row,
                      float (*fields)[FRAME_STRIP]) {
    UNROLL for (size_t k = 0; k < FRAME_BLOCK; k += LANES) {
        const struct columns values = columns_at(&setup->values, cell->first + k);
        for (int plane = LIGHT; plane < GAIN; plane++)
            if (has(variant, setup, plane))
                vstore(fields[plane] + cell->block * FRAME_BLOCK + k, along(&values, node_row(setup, plane, row), 3));
        if (!has(variant, setup, GAIN) && !has(variant, setup, AREA)) continue;
        const struct columns shared = columns_at(&setup->shared, cell->first + k);
        for (int plane = GAIN; plane < PLANES; plane++)
            if (has(variant, setup, plane))
                vstore(fields[plane] + cell->block * FRAME_BLOCK + k, along(&shared, node_row(setup, plane, row), 1));
    }
}

/* Fetches what the cell below will enter. */
INLINE void fetch_row(struct variant variant, const struct procam_frame *setup, const struct cell *cell, size_t row) {
    const int32_t *start = setup->values.start + cell->first / LANES;
    for (int plane = LIGHT; plane < GAIN; plane++)
        for (int k = 0; has(variant, setup, plane) && k < VECTORS; k += LINE_FLOATS / LANES)
            __builtin_prefetch(node_row(setup, plane, row) + start[k], 0, 1);
}

/* Interpolates the fields along the node row below a cell, and above it unless the cell there did. */
INLINE void enter(struct variant variant, const struct procam_frame *setup, struct workspace *work, const struct cell *cell) {
    uint8_t planes = 0;
    for (int plane = 0; plane < PLANES; plane++) planes |= (uint8_t)(has(variant, setup, plane) << plane);
    const int known = cell->interval && work->entered[cell->block] == cell->interval && !(planes & ~work->planes[cell->block]);
    if (!known) enter_row(variant, setup, cell, cell->above, work->fields[!(cell->interval % 2)]);
    enter_row(variant, setup, cell, cell->below, work->fields[cell->interval % 2]);
    fetch_row(variant, setup, cell, cell->below + 1);
    work->entered[cell->block] = cell->interval + 1;
    work->planes[cell->block] = planes;
}

INLINE struct ramp ramp_of(const struct workspace *work, const struct cell *cell, int plane, int k) {
    const size_t at = cell->block * FRAME_BLOCK + (size_t)(k * LANES);
    const vf above = vload(work->fields[!(cell->interval % 2)][plane] + at);
    return (struct ramp){above, vload(work->fields[cell->interval % 2][plane] + at) - above};
}

INLINE vf at_row(struct ramp ramp, float down) { return ramp.step * down + ramp.at; }

/* The value of a mode for one vector of content, `down` the cell. Where a number is NaN, vmin and vmax give
   their second argument. */
INLINE vf sent(struct variant variant, const struct procam_frame *setup, const struct ramp *ramps, float down, vf content) {
    if (variant.lit == NOWHERE) return vset(0.0f);
    if (has(variant, setup, GAIN)) content *= at_row(ramps[GAIN], down);
    const vf wanted = content - at_row(ramps[LIGHT], down), one = vset(1.0f), none = vset(0.0f);
    if (variant.mode == SUM_CONTENT) return wanted;
    const vf least = at_row(ramps[LEAST], down);
    vf most = vset(setup->top);
    if (has(variant, setup, MOST)) most = vmin(most, at_row(ramps[MOST], down));
    if (variant.mode == COUNT_LEAST) return vsel(least < wanted, none, one);
    if (variant.mode == COUNT_MOST) return vsel(wanted < most, none, one);
    const vf clipped = vmin(vmax(wanted, least), most);
    return variant.mode == SUM_EXCESS ? clipped - wanted : clipped;
}

/* One vector of values, down a group. */
INLINE void go_down(struct variant variant, const struct procam_frame *setup, const struct workspace *work, struct band *band,
                    const struct cell *cell, const struct group *group, int k) {
    const size_t at = (size_t)(k * LANES), place = cell->block * FRAME_BLOCK + at, width = bytes_of(variant.kind);
    float *sums = band->sum[variant.lit == IN_PART] + place, *downs = band->down[variant.lit == IN_PART] + place;
    struct ramp ramps[PLANES] = {0};
    for (int plane = 0; plane < PLANES; plane++)
        if (has(variant, setup, plane)) ramps[plane] = ramp_of(work, cell, plane, k);
    vf sum = vload(sums), lower = vload(downs);
    UNROLL for (size_t r = 0; r < group->rows; r++) {
        const float down = setup->down[group->y + r], share = setup->along[group->y + r];
        const vf stored = variant.kind == U8 ? vload((float *)group->lines[r] + at)
                                             : load_value(variant.kind, group->stored + r * group->pitch, at);
        const vf content = variant.kind == U16 ? stored * (1 / 65535.0f) : stored;
        vf value = sent(variant, setup, ramps, down, content), counted = value;
        if (variant.lit == IN_PART) {
            const vf area = at_row(ramps[AREA], down);
            value = vsel(area > 0.0f, value, vset(0.0f));
            counted = area * value;
        }
        sum += counted, lower += share * counted;
        if (variant.mode < APPLY) continue;
        if (variant.kind == U8) vstore((float *)group->lines[r] + at, value);
        else store_light(variant.kind, setup, value, variant.mode == MIX, stored, group->lines[r] + at * width);
    }
    vstore(sums, sum), vstore(downs, lower);
}

/* Writes the light of a group. */
INLINE void write_group(struct variant variant, const struct procam_frame *setup, const struct cell *cell, const struct group *group) {
    const size_t width = bytes_of(variant.kind), pitch = 3 * setup->size * width;
    unsigned char *to = (unsigned char *)setup->out + group->y * pitch + cell->first * width;
    unsigned char codes[FRAME_BLOCK] __attribute__((aligned(64)));
    for (size_t r = 0; r < group->rows; r++, to += pitch) {
        const size_t tile = (group->y + r) % TILE_ROWS * TILE_WIDTH + cell->first % TILE_WIDTH;
        const unsigned char *original = variant.mode == MIX ? group->stored + r * group->pitch : NULL;
        if (variant.kind == U8) encode_block(setup, (float *)group->lines[r], original, setup->threshold + tile, codes);
        vcopy(to, variant.kind == U8 ? codes : group->lines[r], cell->left * width);
    }
}

/* Reads rows of a block from y on. Processors fetch along rows by themselves, but not the rows to come. */
INLINE struct group read_group(struct variant variant, const struct procam_frame *setup, const struct cell *cell, size_t y,
                               line *edge, line *lines) {
    const size_t rows = cell->end - y < PART_ROWS ? cell->end - y : PART_ROWS;
    const size_t width = bytes_of(variant.kind), pitch = 3 * setup->size * width;
    const unsigned char *from = (const unsigned char *)setup->image + y * pitch + cell->first * width;
    struct group group = {y, rows, from, pitch, lines};
    if (cell->left < FRAME_BLOCK) {
        const size_t bytes = cell->left * width;
        for (size_t r = 0; r < rows; r++)
            memcpy(edge[r], from + r * pitch, bytes), memset(edge[r] + bytes, 0, sizeof edge[r] - bytes);
        group.stored = edge[0], group.pitch = sizeof edge[0];
    }
    for (size_t r = 0; r < rows; r++) {
        for (size_t at = 0; at < FRAME_BLOCK * width; at += 64) __builtin_prefetch(from + (r + AHEAD) * pitch + at, 0, 1);
        if (variant.kind == U8) vlook_up(setup->decode, setup->decode_bytes, group.stored + r * group.pitch, (float *)lines[r]);
    }
    return group;
}

INLINE void one_cell(struct variant variant, const struct procam_frame *setup, struct workspace *work, struct band *band,
                     const struct cell *cell) {
    line edge[PART_ROWS] __attribute__((aligned(64))), lines[PART_ROWS] __attribute__((aligned(64)));
    if (variant.lit != NOWHERE) enter(variant, setup, work, cell);
    for (size_t y = cell->row; y < cell->end; y += PART_ROWS) {
        const struct group group = read_group(variant, setup, cell, y, edge, lines);
        for (int k = 0; k < VECTORS; k++) go_down(variant, setup, work, band, cell, &group, k);
        if (variant.mode >= APPLY) write_group(variant, setup, cell, &group);
    }
    band->lit[cell->block] |= (uint8_t)(1 << cell->lit);
    const size_t end = cell->block * FRAME_BLOCK + cell->left, bytes = (FRAME_BLOCK - cell->left) * sizeof(float);
    for (int k = 0; k < 2 && bytes; k++) memset(band->sum[k] + end, 0, bytes), memset(band->down[k] + end, 0, bytes);
}

typedef void cells_variant(const struct procam_frame *setup, struct workspace *work, const struct cell *first, size_t count);
#define CELL(name, ...) \
    static __attribute__((noinline)) void name(const struct procam_frame *given, struct workspace *work, \
                                               const struct cell *first, size_t count) { \
        const struct procam_frame setup = *given; /* a copy, which no store can alias */ \
        struct band *const band = work->bands + work->band; \
        struct cell cell = *first; \
        for (; count; count--, cell.block++, cell.first += FRAME_BLOCK) \
            one_cell((struct variant){__VA_ARGS__}, &setup, work, band, &cell); \
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
    CELL(other_##kind##_nowhere, kind, MIX, NOWHERE, NEVER, NEVER)
CELLS(U8)
CELLS(U16)
CELLS(F16)
CELLS(F32)

/* Indexed by enum lit and GAINED; unlit cells need a function only to be mixed. */
INLINE cells_variant *const *variants_of(int kind, int mode) {
#define VARIANTS_OF(name, nowhere) {nowhere, name##_in_part, name##_everywhere, name##_limited, name##_gained}
#define TASKS_OF(kind) \
    [kind] = {VARIANTS_OF(sum_##kind, NULL), VARIANTS_OF(apply_##kind, NULL), VARIANTS_OF(other_##kind, other_##kind##_nowhere)}
    static cells_variant *const variants[4][3][VARIANTS] = {TASKS_OF(U8), TASKS_OF(U16), TASKS_OF(F16), TASKS_OF(F32)};
    return variants[kind][mode == SUM_LIGHT ? 0 : mode == APPLY ? 1 : 2];
}
