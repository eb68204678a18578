/* One frame of a projector from a dome master of direct light. For each pixel: sample the master at
   its position, subtract black, multiply by the pixel's share of the blend, unmix the colours, look up
   the drive, dither.

   A frame is processed in tiles of 64 columns and 32 rows, in two strips of 32 x 32 pixels. The part of
   the master that a strip is sampled from is decoded first, as each of its pixels is needed about four
   times; it stays in the nearest caches. A strip that covers too much of the master has its pixels decoded
   one by one. */
enum { TILE = 64, ROWS = 32, STRIP = 32 };
enum { CHUNK = 64, CHUNK_ROWS = CHUNK / STRIP }; /* pixels processed together */
enum { CHUNKS = ROWS / CHUNK_ROWS, IN_CHUNK = CHUNK / BLOCK, IN_STRIP = STRIP * ROWS / BLOCK, IN_TILE = TILE * ROWS / BLOCK };
enum { PLACE_X, PLACE_Y, BLACK, SHARE = BLACK + 3 }; /* fields of a block */
enum { DECODED = 64 * 192 }; /* values of a master that are decoded for a strip at most */
enum { STEPS = 32, LOWEST = 16 }; /* of the table of drives: knots per octave of light, octaves */

struct samples {
    int32_t at[CHUNK];      /* index of the upper left of four pixels of the part */
    float weight[4][CHUNK]; /* upper left, upper right, lower left, lower right */
    float light[3][CHUNK];
};

struct part { /* of the master, decoded */
    size_t left, top, high;   /* first column and row, rows; none if it is too large */
    size_t stride;            /* values per row */
    float last[2];            /* column and row of the last pixel that has others to its right and below */
    float light[DECODED + 64] __attribute__((aligned(64)));
};

INLINE vf vfield(const struct warp_block *block, int field, size_t i) {
    return vfloat(vload_u16(block->number[field] + i)) * block->step[field] + block->base[field];
}

/* Weight of a pixel at a distance of `away` pixels: a tent. */
INLINE vf vtent(vf away) { return vmax(1.0f - vabs(away), vset(0.0f)); }

/* Samples of a chunk: four pixels of the master and their weights. The pixels are always inside the
   part; their weights are 0 where the position is not. */
INLINE void find_samples(const struct procam_warp *d, const struct part *from, const struct warp_block *blocks,
                         struct samples *to) {
    const vf left_most = vset((float)from->left), top_most = vset((float)from->top);
    const vf right = vset(from->last[0]), low = vset(from->last[1]);
    const int32_t stride = (int32_t)from->stride, first = (int32_t)(from->top * from->stride + 3 * from->left);
    for (size_t i = 0; i < CHUNK; i += LANES) {
        const struct warp_block *block = blocks + i / BLOCK;
        const vf x = vfield(block, PLACE_X, i % BLOCK), y = vfield(block, PLACE_Y, i % BLOCK);
        const vi column = vtruncate(vmin(vmax(x, left_most), right));
        const vi row = vtruncate(vmin(vmax(y, top_most), low));
        const vf dx = x - vfloat(column), dy = y - vfloat(row);
        const vf left = vtent(dx), upper = vtent(dy) * d->unit;
        const vf beside = vtent(dx - 1.0f), lower = vtent(dy - 1.0f) * d->unit;
        vstore_i(to->at + i, row * stride + column * 3 - first);
        vstore(to->weight[0] + i, upper * left);
        vstore(to->weight[1] + i, upper * beside);
        vstore(to->weight[2] + i, lower * left);
        vstore(to->weight[3] + i, lower * beside);
    }
}

/* Some values of the master from number `at` on; may write up to the next multiple of 64. */
INLINE void decode_values(int kind, const struct procam_warp *d, size_t at, size_t count, float *to) {
    const size_t total = 3 * d->master_columns * d->master_rows;
    const uint8_t *codes = (const uint8_t *)d->master + at;
    for (size_t k = 0; k < count; k += 64) {
        const size_t left = total - at - k;
        if (kind == U8 && (count < 64 || left < 64))
            for (size_t i = k; i < count && i < k + 64; i++) to[i] = d->decode[codes[i]];
        else if (kind == U8) vlook_up(d->decode, d->decode_bytes, codes + k, to + k);
        else
            for (size_t i = 0; i < 64 && k + i < count; i += LANES)
                vstore(to + k + i, i + LANES <= left ? vload_kind(kind, d->master, at + k + i)
                                                     : vload_part(kind, d->master, at + k + i, left - i));
    }
}

struct range { /* of columns or rows */
    size_t first, last;
};

INLINE float clamped(float value, float most) { return value > 0 ? value < most ? value : most : 0; }

/* Of the pixels that a strip is sampled from; rounding may need one more. */
INLINE struct range range_of(const struct warp_block *blocks, int field, size_t last) {
    float least = INFINITY, most = -INFINITY;
    for (int k = 0; k < IN_STRIP; k++) { /* steps are not negative */
        const float low = blocks[k].base[field], high = low + 65535 * blocks[k].step[field];
        least = low < least ? low : least, most = high > most ? high : most;
    }
    const size_t first = (size_t)clamped(least - 1, (float)(last - 1)), end = (size_t)clamped(most + 2, (float)last);
    return (struct range){first, end > first ? end : first + 1};
}

struct area { /* of the master */
    struct range x, y;
};

INLINE struct area area_of(const struct procam_warp *d, const struct warp_block *blocks) {
    return (struct area){range_of(blocks, PLACE_X, d->master_columns - 1), range_of(blocks, PLACE_Y, d->master_rows - 1)};
}

INLINE size_t rows_of_area(const struct area *area) { return area->y.last + 1 - area->y.first; }

/* Values of a row, rounded up to those that are decoded together. */
INLINE size_t stride_of(const struct area *area) { return (3 * (area->x.last + 1 - area->x.first) + 63) / 64 * 64; }

INLINE int fits(const struct area *area) { return rows_of_area(area) * stride_of(area) <= DECODED; }

INLINE void decode_part(int kind, const struct procam_warp *d, const struct area *area, struct part *to) {
    const size_t pitch = 3 * d->master_columns, wide = 3 * (area->x.last + 1 - area->x.first);
    to->left = area->x.first, to->top = area->y.first, to->high = rows_of_area(area), to->stride = stride_of(area);
    to->last[0] = (float)(area->x.last - 1), to->last[1] = (float)(area->y.last - 1);
    if (!fits(area)) to->left = to->top = to->high = 0, to->stride = pitch;
    for (size_t row = 0; row < to->high; row++)
        decode_values(kind, d, (to->top + row) * pitch + 3 * to->left, wide, to->light + row * to->stride);
}

/* Decodes two pixels in each of two rows for each sample of a chunk, and makes those the part. */
INLINE void decode_pixels(int kind, const struct procam_warp *d, struct samples *samples, struct part *to) {
    for (size_t i = 0; i < CHUNK; i++) {
        const size_t at = (size_t)samples->at[i];
        decode_values(kind, d, at, 6, to->light + 12 * i), decode_values(kind, d, at + to->stride, 6, to->light + 12 * i + 6);
        samples->at[i] = (int32_t)(12 * i);
    }
}

typedef float quad __attribute__((vector_size(16)));
typedef float quad_at __attribute__((vector_size(16), aligned(4)));

/* Four pixels at a time; the fourth number of each is no colour. */
INLINE void fetch_light(const float *light, size_t stride, struct samples *samples) {
    for (size_t i = 0; i < CHUNK; i += 4) {
        quad found[4];
        UNROLL for (size_t k = 0; k < 4; k++) {
            const float *upper = light + samples->at[i + k], *lower = upper + stride;
            found[k] = *(const quad_at *)upper * samples->weight[0][i + k] + *(const quad_at *)(upper + 3) * samples->weight[1][i + k] +
                       *(const quad_at *)lower * samples->weight[2][i + k] + *(const quad_at *)(lower + 3) * samples->weight[3][i + k];
        }
        for (int c = 0; c < 3; c++) {
            const quad colour = {found[0][c], found[1][c], found[2][c], found[3][c]};
            memcpy(samples->light[c] + i, &colour, sizeof colour);
        }
    }
}

/* Light to send, 0..1; NaN becomes 0. */
INLINE void unmixed(const struct procam_warp *d, const struct warp_block *block,
                    const struct samples *samples, size_t i, vf *sent) {
    vf wanted[3];
    for (int c = 0; c < 3; c++) {
        vf light = vload(samples->light[c] + i);
        light += light - light; /* infinity becomes NaN */
        wanted[c] = (light - vfield(block, BLACK + c, i % BLOCK)) * vfield(block, SHARE + c, i % BLOCK);
    }
    for (int c = 0; c < 3; c++) {
        const float *row = d->unmix + 3 * c;
        const vf sum = row[0] * wanted[0] + (row[1] * wanted[1] + row[2] * wanted[2]);
        sent[c] = vmin(vmax(sum, vset(0.0f)), vset(1.0f));
    }
}

/* Drive from a table over the logarithm of the light, linear between its knots. */
INLINE vf drive_of(const uint32_t *knots, vf sent) {
    const float least = 0x1p-16f;
    const vi bits = (vi)(sent * (1.0f - least) + least);
    const vi knot = vlookup(knots, (bits >> 18) - (127 - LOWEST) * STEPS);
    const vf part = vfloat(bits & 0x3ffff) * 0x1p-18f;
    return vfloat(knot >> 16 & 0xffff) * part + vfloat(knot & 0xffff);
}

struct results { /* before they are written: a tile of bytes, or a chunk of other types */
    uint8_t bytes[ROWS][3 * TILE + 64] __attribute__((aligned(64)));
    int32_t drive[3][CHUNK];
    float sent[3][CHUNK];
};

INLINE void finish(int out_kind, const struct procam_warp *d, const float *thresholds, size_t i,
                   const vf *sent, struct results *to, uint8_t *bytes) {
    vi code[3];
    for (int c = 0; c < 3; c++) {
        if (out_kind == F32) {
            vstore(to->sent[c] + i, sent[c]);
            continue;
        }
        const vf drive = drive_of(d->drives + (size_t)c * KNOTS, sent[c]);
        if (out_kind == U16)
            vstore_i(to->drive[c] + i, vtruncate(drive + 0.5f));
        else
            code[c] = vtruncate(vmin(drive * 0x1p-8f + vload(thresholds), vset(255.0f)));
    }
    if (out_kind != U8) return;
    const vi pixels = code[0] | code[1] << 8 | code[2] << 16;
    for (int k = 0; k < LANES; k++) { /* four bytes, of which the next pixel overwrites the last */
        const int32_t pixel = pixels[k];
        memcpy(bytes + 3 * k, &pixel, sizeof pixel);
    }
}

struct tile { /* first column and row, number of columns and rows */
    size_t left, top, wide, high;
};

INLINE void write_chunk(int out_kind, const struct procam_warp *d, const struct tile *tile,
                        size_t x, size_t y, const struct results *from) {
    for (size_t i = 0; i < CHUNK; i++) {
        const size_t row = y + i / STRIP, column = x + i % STRIP;
        if (row >= tile->high || column >= tile->wide) continue;
        const size_t at = 3 * ((tile->top + row) * d->columns + tile->left + column);
        for (size_t c = 0; c < 3; c++)
            if (out_kind == U16)
                ((uint16_t *)d->out)[at + c] = (uint16_t)from->drive[c][i];
            else
                ((float *)d->out)[at + c] = from->sent[c][i];
    }
}

INLINE void write_bytes(const struct procam_warp *d, const struct tile *tile, const struct results *from) {
    uint8_t *out = (uint8_t *)d->out + 3 * (tile->top * d->columns + tile->left);
    for (size_t y = 0; y < tile->high; y++)
        vcopy(out + 3 * y * d->columns, from->bytes[y], 3 * tile->wide);
}

/* Prefetches a share of the blocks of the strip after the next, and of the master for the next. */
INLINE void prefetch_strip(int kind, const struct procam_warp *d, const struct area *next, const struct warp_block *later,
                           size_t share) {
    const size_t width = bytes_of(kind), pitch = 3 * d->master_columns * width, rows = rows_of_area(next);
    const size_t bytes = stride_of(next) * width;
    const char *from = (const char *)d->master + next->y.first * pitch + 3 * next->x.first * width;
    for (size_t k = 0; k < IN_CHUNK * sizeof *later; k += 64)
        __builtin_prefetch((const char *)(later + share * IN_CHUNK) + k, 0, 2);
    if (!fits(next)) return;
    for (size_t row = share * rows / CHUNKS; row < (share + 1) * rows / CHUNKS; row++)
        for (size_t at = 0; at < bytes; at += 64) __builtin_prefetch(from + row * pitch + at, 0, 2);
}

INLINE void warp_strip(int kind, int out_kind, const struct procam_warp *d, const struct tile *tile, size_t x,
                       const struct warp_block *blocks, const struct warp_block *end, struct results *to) {
    struct samples samples;
    struct part part;
    const struct area area = area_of(d, blocks);
    const int more = blocks + 3 * IN_STRIP <= end;
    const struct area next = area_of(d, more ? blocks + IN_STRIP : blocks);
    const struct warp_block *later = more ? blocks + 2 * IN_STRIP : blocks;
    decode_part(kind, d, &area, &part);
    for (size_t y = 0; y < ROWS && y < tile->high; y += CHUNK_ROWS, blocks += IN_CHUNK) {
        prefetch_strip(kind, d, &next, later, y / CHUNK_ROWS);
        find_samples(d, &part, blocks, &samples);
        if (!part.high) decode_pixels(kind, d, &samples, &part);
        fetch_light(part.light, part.high ? part.stride : 6, &samples);
        for (size_t i = 0; i < CHUNK; i += LANES) {
            const size_t row = y + i / STRIP, column = x + i % STRIP;
            const float *thresholds = d->thresholds + (tile->top + row) % TILE * TILE + column;
            vf sent[3];
            unmixed(d, blocks + i / BLOCK, &samples, i, sent);
            finish(out_kind, d, thresholds, i, sent, to, to->bytes[row] + 3 * column);
        }
        if (out_kind != U8) write_chunk(out_kind, d, tile, x, y, to);
    }
}

INLINE void warp_tile(int kind, int out_kind, const struct procam_warp *d, const struct tile *tile,
                      const struct warp_block *blocks, const struct warp_block *end) {
    struct results results;
    for (size_t x = 0; x < TILE && x < tile->wide; x += STRIP, blocks += IN_STRIP)
        warp_strip(kind, out_kind, d, tile, x, blocks, end, &results);
    if (out_kind == U8) write_bytes(d, tile, &results);
}

/* Whole bands of rows. */
INLINE void warp_rows(int kind, int out_kind, const struct procam_warp *d, size_t first,
                      size_t count) {
    const size_t across = (d->columns + TILE - 1) / TILE, bands = (d->rows + ROWS - 1) / ROWS;
    const struct warp_block *end = d->blocks + bands * across * IN_TILE;
    for (size_t y = first; y < first + count; y += ROWS)
        for (size_t k = 0; k < across; k++) {
            const size_t wide = d->columns - k * TILE, high = d->rows - y;
            const struct tile tile = {k * TILE, y, wide < TILE ? wide : TILE,
                                      high < ROWS ? high : ROWS};
            warp_tile(kind, out_kind, d, &tile, d->blocks + (y / ROWS * across + k) * IN_TILE, end);
        }
    vfence();
}

INLINE void warp_kind(int kind, const struct procam_warp *d, size_t first, size_t count) {
    if (d->out_kind == U8)
        warp_rows(kind, U8, d, first, count);
    else if (d->out_kind == U16)
        warp_rows(kind, U16, d, first, count);
    else
        warp_rows(kind, F32, d, first, count);
}

static void warp(const struct procam_warp *job, size_t first, size_t count) {
    if (job->kind == U8)
        warp_kind(U8, job, first, count);
    else if (job->kind == U16)
        warp_kind(U16, job, first, count);
    else if (job->kind == F16)
        warp_kind(F16, job, first, count);
    else
        warp_kind(F32, job, first, count);
}
