/* One frame of a dome master: sums of its direct light over the dome, or the light to send.

   Fields are given on a coarse grid of nodes. The rows of the picture between two node rows are an
   interval, some intervals (1, 2 or 4) a band, and a block of 64 values in an interval a cell (cell.h):

       edge ===================  node row     |  interval  |
            [cell][cell][cell]                |            |  band
            ------------------   node row                  |
            [cell][cell][cell]                             |
       edge ===================  node row

   A cell's sums go to the two edges of its band. Directions and solid angles are linear enough over a
   band that they are multiplied in once per edge, not once per row; only where a band is partly lit are
   solid angles multiplied in pixel by pixel. Tasks are strips of 512 pixels by FRAME_CHUNK intervals. */

enum { FRAME_CHUNK = 64 }; /* intervals of a task */
enum { AXES = 3 };

/* Splits LANES interleaved pixels into their colours. */
INLINE void split_colours(const float *from, vf *colours) {
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

struct rows { /* fields along an edge of bands */
    struct positions positions;
    const float *weight, *edge_spread, *axes[AXES];
    size_t nodes;
};

INLINE struct rows rows_of(const struct procam_frame *setup, size_t number) {
    const size_t nodes = (size_t)setup->nodes;
    const float *direction = setup->direction + number * AXES * nodes;
    return (struct rows){setup->pixels, setup->weight + number * nodes, setup->edge_spread + number * 3 * nodes,
                         {direction, direction + nodes, direction + 2 * nodes}, nodes};
}

/* Adds the sums at an edge to those of each colour and term, LANES pixels at a time. */
INLINE void gather_pixels(int terms, int mode, const struct rows *rows, const struct edge *edge, size_t at,
                          size_t pixel, vf (*sums)[FRAME_TERMS]) {
    const int lit = edge->lit[at / FRAME_BLOCK] | edge->lit[(at + 3 * LANES - 1) / FRAME_BLOCK];
    if (!lit) return;
    const struct columns columns = columns_from(&rows->positions, pixel);
    const vf weight = along_row(&columns, rows->weight), none = vset(0.0f);
    prefetch(rows->weight + rows->nodes + columns.start); /* of the next edge */
    for (int axis = 0; axis < AXES; axis++) prefetch(rows->axes[axis] + AXES * rows->nodes + columns.start);
    vf plain[3], weighed[3] = {none, none, none}, term[FRAME_TERMS];
    split_colours(edge->plain + at, plain);
    if (lit & 1 << IN_PART) split_colours(edge->weighed + at, weighed);
    for (int axis = 0; axis < AXES && axis < terms - 1; axis++) term[1 + axis] = along_row(&columns, rows->axes[axis]);
    if (terms > 4) {
        const vf x = term[1], y = term[2], z = term[3];
        term[4] = vmul(x, y), term[5] = vmul(y, z), term[6] = vmul(x, z);
        term[7] = vfms(x, x, vmul(y, y)), term[8] = vmul(z, z);
    }
    UNROLL for (int c = 0; c < 3; c++) {
        vf v = vfma(weight, plain[c], weighed[c]);
        if (mode == SUM_EXCESS) v = vmul(v, along_row(&columns, rows->edge_spread + (size_t)c * rows->nodes));
        sums[c][0] = vadd(sums[c][0], v);
        UNROLL for (int k = 1; k < terms; k++) sums[c][k] = vfma(v, term[k], sums[c][k]);
    }
}

INLINE void gather_edge(int terms, int mode, const struct procam_frame *setup, const struct edge *edge, size_t number,
                        size_t first, double (*to)[FRAME_TERMS][LANES]) {
    const struct rows rows = rows_of(setup, number);
    vf sums[3][FRAME_TERMS];
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < terms; k++) sums[c][k] = vset(0.0f);
    for (size_t at = 0; at < FRAME_STRIP; at += 3 * LANES)
        gather_pixels(terms, mode, &rows, edge, at, (first + at) / 3, sums);
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < terms; k++) {
            float lanes[LANES];
            vstore(lanes, sums[c][k]);
            for (int lane = 0; lane < LANES; lane++) to[c][k][lane] += (double)lanes[lane];
        }
}

/* Adds up and clears a band's upper edge; the lower one becomes the upper one of the next band. */
INLINE void gather(int mode, const struct procam_frame *setup, struct workspace *work, size_t number, size_t first,
                   double (*to)[FRAME_TERMS][LANES]) {
    struct edge *edge = work->edges + work->upper;
    if (setup->terms == 1) gather_edge(1, mode, setup, edge, number, first, to);
    else if (setup->terms == 4) gather_edge(4, mode, setup, edge, number, first, to);
    else gather_edge(FRAME_TERMS, mode, setup, edge, number, first, to);
    for (size_t block = 0; block < STRIP_BLOCKS; block++) {
        const size_t at = block * FRAME_BLOCK, bytes = FRAME_BLOCK * sizeof(float);
        if (edge->lit[block]) memset(edge->plain + at, 0, bytes);
        if (edge->lit[block] & 1 << IN_PART) memset(edge->weighed + at, 0, bytes);
        edge->lit[block] = 0;
    }
    work->upper = !work->upper;
}

/* The interval between two node rows, and the rows of the picture in it. */
INLINE struct cell interval_of(const struct procam_frame *setup, size_t interval) {
    const size_t last = (size_t)setup->nodes - 1, band = (size_t)setup->band;
    struct cell cell = {.row = (size_t)setup->rows[interval], .end = (size_t)setup->rows[interval + 1]};
    cell.above = interval ? interval - 1 : 0, cell.below = interval < last ? interval : last;
    cell.share = 1.0f / (float)setup->band, cell.from = (float)(interval % band) * cell.share;
    for (size_t y = cell.row; y < cell.end; y++) {
        const float down = setup->down[y];
        cell.count += 1, cell.down += down, cell.squares += down * down;
    }
    return cell;
}

INLINE void clear_rows(const struct procam_frame *setup, const struct cell *cell, size_t values) {
    const size_t width = bytes_of(setup->kind), pitch = 3 * setup->size * width;
    unsigned char *to = (unsigned char *)setup->out + cell->row * pitch + cell->first * width;
    for (size_t y = cell->row; y < cell->end; y++, to += pitch) clear(to, values * width);
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
    const int writes = work->mode == APPLY, mixes = writes && setup->strength < 1;
    const uint8_t *lit = setup->lit + interval * wide + begin;
    struct cell cell = interval_of(setup, interval);
    prefetch(lit + 2 * wide);
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
    double sums[3][FRAME_TERMS][LANES] = {0};
    cells_variant *const *variants = variants_of(setup->kind, mode);
    const size_t intervals = (size_t)setup->nodes + 1, band = (size_t)setup->band, begin = chunk * FRAME_CHUNK;
    const size_t end = begin + FRAME_CHUNK < intervals ? begin + FRAME_CHUNK : intervals;
    memset(&work, 0, sizeof work);
    work.mode = mode;
    for (size_t interval = begin; interval < end; interval++) {
        one_interval(variants, setup, &work, strip, interval);
        const size_t number = interval / band, first = strip * FRAME_STRIP;
        if ((interval + 1) % band == 0 || interval == end - 1) gather(mode, setup, &work, number, first, sums);
        if (interval == end - 1) gather(mode, setup, &work, number + 1, first, sums);
    }
    for (int c = 0; c < 3; c++)
        for (int term = 0; term < FRAME_TERMS; term++)
            for (int lane = 0; lane < LANES; lane++) to[c * FRAME_TERMS + term] += sums[c][term][lane];
    vfence();
}

static void frame(const struct frame *job, size_t first, size_t count) {
    for (size_t task = first; task < first + count; task++)
        one_task(job->mode, job->setup, task % job->strips, task / job->strips, job->sums + task * 3 * FRAME_TERMS);
}
