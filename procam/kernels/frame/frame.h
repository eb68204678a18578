/* One frame of a dome master: sums of its direct light over the dome, or the light to send.

   Fields are given on a coarse grid of nodes. The rows of the picture between two node rows are an
   interval, some intervals (1, 2 or 4) a band, and a block of 64 values in an interval a cell (cell.h):

       edge ===================  node row     |  interval  |
            [cell][cell][cell]                |            |  band
            ------------------   node row                  |
            [cell][cell][cell]                             |
       edge ===================  node row

   Sums of a band are split between its edges, in proportion to their distance from them. Directions and
   solid angles are linear enough over a band that they are multiplied in once per edge, not once per row;
   only where a band is partly lit are solid angles multiplied in pixel by pixel. Tasks are strips of 512
   pixels by FRAME_CHUNK intervals. */

enum { FRAME_CHUNK = 64 }; /* intervals of a task */
enum { AXES = 3 };

struct rows { /* fields along an edge of bands */
    const float *weight, *edge_spread, *axes[AXES];
};

INLINE struct rows rows_of(const struct procam_frame *setup, size_t number) {
    const size_t nodes = (size_t)setup->nodes;
    const float *direction = setup->direction + number * AXES * nodes;
    return (struct rows){setup->weight + number * nodes, setup->edge_spread + number * 3 * nodes,
                         {direction, direction + nodes, direction + 2 * nodes}};
}

/* Sums of one vector between an edge and the next ones, in proportion to the distance from those. */
INLINE vf shared_with(const struct band *above, const struct band *below, int weighed, size_t at) {
    return vload(above->down[weighed] + at) + (vload(below->sum[weighed] + at) - vload(below->down[weighed] + at));
}

/* Fills in the products of directions x, y, z: term[1] to term[3]. */
INLINE void raise(int terms, vf *term) {
    const vf x = term[1], y = term[2], z = term[3];
    if (terms <= 4) return;
    term[4] = x * y, term[5] = y * z, term[6] = x * z, term[7] = x * x - y * y, term[8] = z * z;
}

/* Adds those of a vector of values at an edge, from value i of the picture's rows on, to those of each term. */
INLINE void gather_values(int terms, int mode, const struct procam_frame *setup, const struct rows *rows,
                          const struct band *above, const struct band *below, size_t at, size_t i, vf *sums) {
    const int lit = above->lit[at / FRAME_BLOCK] | below->lit[at / FRAME_BLOCK];
    if (!lit) return;
    const struct columns columns = columns_at(&setup->shared, i), spread = columns_at(&setup->values, i);
    vf term[FRAME_TERMS], v = along(&columns, rows->weight, 1) * shared_with(above, below, 0, at);
    if (lit & 1 << IN_PART) v += shared_with(above, below, 1, at);
    if (mode == SUM_EXCESS) v *= along(&spread, rows->edge_spread, 3);
    for (int axis = 0; axis < AXES && axis < terms - 1; axis++) term[1 + axis] = along(&columns, rows->axes[axis], 1);
    raise(terms, term);
    sums[0] += v;
    UNROLL for (int k = 1; k < terms; k++) sums[k] += v * term[k];
}

/* Vectors of the same colours in turn, every third, are added up together. */
INLINE void gather_edge(int terms, int mode, const struct procam_frame *setup, const struct band *above,
                        const struct band *below, size_t number, size_t first, double (*to)[FRAME_TERMS][LANES]) {
    const struct rows rows = rows_of(setup, number);
    for (size_t third = 0; third < 3; third++) {
        vf sums[FRAME_TERMS];
        for (int k = 0; k < terms; k++) sums[k] = vset(0.0f);
        for (size_t at = third * LANES; at < FRAME_STRIP; at += 3 * LANES)
            gather_values(terms, mode, setup, &rows, above, below, at, first + at, sums);
        for (int k = 0; k < terms; k++)
            for (size_t lane = 0; lane < LANES; lane++) to[third][k][lane] += (double)sums[k][lane];
    }
}

INLINE void clear_band(struct band *band) {
    for (size_t block = 0; block < STRIP_BLOCKS; block++) {
        for (size_t at = block * FRAME_BLOCK; band->lit[block] && at < (block + 1) * FRAME_BLOCK; at += LANES)
            for (int k = 0; k < 2; k++) vstore(band->sum[k] + at, vset(0.0f)), vstore(band->down[k] + at, vset(0.0f));
        band->lit[block] = 0;
    }
}

/* Fields need not be cleared: they are entered before they are read. */
INLINE void begin_strip(struct workspace *work, int mode) {
    memset(work->entered, 0, sizeof work->entered);
    memset(work->planes, 0, sizeof work->planes);
    for (int k = 0; k < 2; k++) {
        memset(work->bands[k].lit, 1, STRIP_BLOCKS); /* as if all had been added */
        clear_band(work->bands + k);
    }
    work->band = 0, work->mode = mode;
}

/* Adds up the edge between the last band and this one, and begins the next band. */
INLINE void gather(int mode, const struct procam_frame *setup, struct workspace *work, size_t number, size_t first,
                   double (*to)[FRAME_TERMS][LANES]) {
    struct band *above = work->bands + !work->band, *below = work->bands + work->band;
    if (setup->terms == 1) gather_edge(1, mode, setup, above, below, number, first, to);
    else if (setup->terms == 4) gather_edge(4, mode, setup, above, below, number, first, to);
    else gather_edge(FRAME_TERMS, mode, setup, above, below, number, first, to);
    clear_band(above);
    work->band = !work->band;
}

/* The interval between two node rows, and the rows of the picture in it. */
INLINE struct cell interval_of(const struct procam_frame *setup, size_t interval) {
    const size_t last = (size_t)setup->nodes - 1;
    struct cell cell = {.interval = interval, .row = (size_t)setup->rows[interval], .end = (size_t)setup->rows[interval + 1]};
    cell.above = interval ? interval - 1 : 0, cell.below = interval < last ? interval : last;
    return cell;
}

INLINE void clear_rows(const struct procam_frame *setup, const struct cell *cell, size_t values) {
    static const unsigned char none[4 * FRAME_BLOCK] __attribute__((aligned(64))) = {0};
    const size_t width = bytes_of(setup->kind), pitch = 3 * setup->size * width, bytes = values * width;
    unsigned char *to = (unsigned char *)setup->out + cell->row * pitch + cell->first * width;
    for (size_t y = cell->row; y < cell->end; y++, to += pitch)
        for (size_t at = 0; at < bytes; at += sizeof none) vcopy(to + at, none, bytes - at < sizeof none ? bytes - at : sizeof none);
}

/* Number of blocks from here on of the same kind; `left` values remain, an incomplete block is alone. */
INLINE size_t run_of(const uint8_t *lit, size_t most, size_t left) {
    size_t count = 1;
    while (count < most && lit[count] == *lit && left >= (count + 1) * FRAME_BLOCK) count++;
    return count;
}

INLINE void one_interval(cells_variant *const *variants, const struct procam_frame *setup, struct workspace *work, size_t strip,
                         size_t interval) {
    const size_t total = 3 * setup->size, wide = (total + FRAME_BLOCK - 1) / FRAME_BLOCK;
    const size_t begin = strip * STRIP_BLOCKS, most = wide - begin < STRIP_BLOCKS ? wide - begin : STRIP_BLOCKS;
    const int writes = work->mode >= APPLY, mixes = work->mode == MIX;
    const uint8_t *lit = setup->lit + interval * wide + begin;
    struct cell cell = interval_of(setup, interval);
    __builtin_prefetch(lit + 2 * wide);
    if (cell.row == cell.end) return;
    for (size_t block = 0, count; block < most; block += count) {
        const size_t left = total - (begin + block) * FRAME_BLOCK;
        count = run_of(lit + block, most - block, left);
        cell.block = block, cell.first = (begin + block) * FRAME_BLOCK, cell.lit = lit[block];
        cell.left = left < FRAME_BLOCK ? left : FRAME_BLOCK;
        const size_t variant = setup->gain && cell.lit > IN_PART ? GAINED : (size_t)cell.lit;
        if (cell.lit != NOWHERE || mixes) variants[variant](setup, work, &cell, count);
        else if (writes) clear_rows(setup, &cell, left < count * FRAME_BLOCK ? left : count * FRAME_BLOCK);
    }
}

INLINE void one_task(int mode, const struct procam_frame *setup, size_t strip, size_t chunk, double *to) {
    struct workspace work;
    double sums[3][FRAME_TERMS][LANES] = {0}; /* value i of a row is lane i % LANES of third i / LANES % 3 */
    cells_variant *const *variants = variants_of(setup->kind, mode);
    const size_t intervals = (size_t)setup->nodes + 1, band = (size_t)setup->band, begin = chunk * FRAME_CHUNK;
    const size_t end = begin + FRAME_CHUNK < intervals ? begin + FRAME_CHUNK : intervals;
    begin_strip(&work, mode);
    for (size_t interval = begin; interval < end; interval++) {
        one_interval(variants, setup, &work, strip, interval);
        const size_t number = interval / band, first = strip * FRAME_STRIP;
        if ((interval + 1) % band == 0 || interval == end - 1) gather(mode, setup, &work, number, first, sums);
        if (interval == end - 1) gather(mode, setup, &work, number + 1, first, sums);
    }
    for (size_t third = 0; third < 3; third++)
        for (size_t term = 0; term < FRAME_TERMS; term++)
            for (size_t lane = 0; lane < LANES; lane++)
                to[(third * LANES + lane) % 3 * FRAME_TERMS + term] += sums[third][term][lane];
    vfence();
}

static void frame(const struct frame *job, size_t first, size_t count) {
    for (size_t task = first; task < first + count; task++)
        one_task(job->mode, job->setup, task % job->strips, task / job->strips, job->sums + task * 3 * FRAME_TERMS);
}
