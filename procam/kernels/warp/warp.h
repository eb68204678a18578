/* One frame of a projector from a dome master of direct light. For each pixel: sample the master at
   its position, subtract black, multiply by the pixel's share of the blend, unmix the colours, look up
   the drive, dither.

   A frame is processed in tiles of 64 columns and 32 rows, in two strips: the part of the master that
   a square of 32 x 32 pixels covers fits the L1 cache and its page table at any rotation. */
enum { TILE = 64, ROWS = 32, STRIP = 32 };
enum { CHUNK = 64, CHUNK_ROWS = CHUNK / STRIP }; /* pixels processed together */
enum { IN_CHUNK = CHUNK / BLOCK, IN_STRIP = STRIP * ROWS / BLOCK, IN_TILE = TILE * ROWS / BLOCK };
enum { PLACE_X, PLACE_Y, BLACK, SHARE = BLACK + 3 }; /* fields of a block */
enum { STEPS = 32, LOWEST = 16 }; /* of the table of drives: knots per octave of light, octaves */

struct samples {
    int32_t at[CHUNK];       /* index of the upper left of the four pixels of the master */
    float weight[4][CHUNK];  /* upper left, upper right, lower left, lower right */
    int32_t pixel[4][CHUNK]; /* 8-bit: colours of the four, in the low 24 bits */
    float light[3][CHUNK];   /* for other types */
};

INLINE vf vfield(const struct warp_block *block, int field, size_t i) {
    return vfloat(vload_u16(block->number[field] + i)) * block->step[field] + block->base[field];
}

/* Weight of a pixel at a distance of `away` pixels: a tent. */
INLINE vf vtent(vf away) { return vmax(1.0f - vabs(away), vset(0.0f)); }

/* Samples of a chunk: four pixels of the master and their weights. The pixels are always inside the
   master; their weights are 0 where the position is not. */
INLINE void find_samples(const struct procam_warp *d, const struct warp_block *blocks,
                       struct samples *to) {
    const vf zero = vset(0.0f);
    const vf right = vset((float)(d->master_columns - 2)), low = vset((float)(d->master_rows - 2));
    const int32_t columns = (int32_t)d->master_columns;
    for (size_t i = 0; i < CHUNK; i += LANES) {
        const struct warp_block *block = blocks + i / BLOCK;
        const vf x = vfield(block, PLACE_X, i % BLOCK), y = vfield(block, PLACE_Y, i % BLOCK);
        const vi column = vtruncate(vmin(vmax(x, zero), right));
        const vi row = vtruncate(vmin(vmax(y, zero), low));
        const vf dx = x - vfloat(column), dy = y - vfloat(row);
        const vf left = vtent(dx), upper = vtent(dy) * d->unit;
        const vf beside = vtent(dx - 1.0f), lower = vtent(dy - 1.0f) * d->unit;
        vstore_i(to->at + i, (row * columns + column) * 3);
        vstore(to->weight[0] + i, upper * left);
        vstore(to->weight[1] + i, upper * beside);
        vstore(to->weight[2] + i, lower * left);
        vstore(to->weight[3] + i, lower * beside);
    }
}

/* An 8-bit pixel and the byte after it. */
INLINE int32_t pixel_at(const uint8_t *at) {
    int32_t pixel;
    memcpy(&pixel, at, sizeof pixel);
    return pixel;
}

/* Reads nothing beyond the master: no byte follows its last pixel, which is read with the one before. */
INLINE void fetch_pixels(const struct procam_warp *d, struct samples *samples) {
    const uint8_t *master = d->master;
    const size_t stride = 3 * d->master_columns, last = stride * (d->master_rows - 1) - 6;
    for (size_t i = 0; i < CHUNK; i++) {
        const uint8_t *at = master + samples->at[i];
        samples->pixel[0][i] = pixel_at(at), samples->pixel[1][i] = pixel_at(at + 3);
        samples->pixel[2][i] = pixel_at(at + stride);
        const int ends = (size_t)samples->at[i] == last;
        samples->pixel[3][i] = pixel_at(at + stride + 3 - ends) >> 8 * ends;
    }
}

typedef float quad __attribute__((vector_size(16)));
typedef int32_t int_quad __attribute__((vector_size(16)));

/* Four 16-bit numbers. */
INLINE int_quad quad_u16(const uint16_t *p) {
#if LANES > 4
    return (int_quad)_mm_cvtepu16_epi32(_mm_loadl_epi64((const __m128i *)p));
#else
    return vload_u16(p);
#endif
}

INLINE quad quad_at(int kind, const void *master, size_t at) {
    quad found;
    if (kind == F32) {
        memcpy(&found, (const float *)master + at, sizeof found);
        return found;
    }
    const int_quad bits = quad_u16((const uint16_t *)master + at);
    if (kind == U16) return __builtin_convertvector(bits, quad);
    const int_quad size = (bits & 0x7fff) << 13, sign = (bits & 0x8000) << 16;
    const int_quad unknown = (size >= 0x7c00 << 13) & 0x7fc00000; /* infinity counts as NaN */
    return (quad)((int_quad)((quad)size * 0x1p112f) | sign | unknown);
}

/* Light of other types: two overlapping reads per row hold the six values of a pair. */
INLINE void fetch_light(int kind, const struct procam_warp *d, struct samples *samples) {
    const size_t stride = 3 * d->master_columns;
    for (size_t i = 0; i < CHUNK; i++) {
        const size_t at = (size_t)samples->at[i];
        const quad left = quad_at(kind, d->master, at) * samples->weight[0][i] +
                          quad_at(kind, d->master, at + stride) * samples->weight[2][i];
        const quad right = quad_at(kind, d->master, at + 2) * samples->weight[1][i] +
                           quad_at(kind, d->master, at + stride + 2) * samples->weight[3][i];
        for (int c = 0; c < 3; c++) samples->light[c][i] = left[c] + right[c + 1];
    }
}

INLINE vf light_of_pixels(const struct procam_warp *d, const struct samples *samples, size_t i, int c) {
    vf sum = vset(0.0f);
    for (int k = 0; k < 4; k++) {
        const vf code = vfloat(vload_i(samples->pixel[k] + i) >> 8 * c & 255);
        sum += vload(samples->weight[k] + i) * vcurve(d->decode, DECODE_DEGREE, code + d->decode_shift);
    }
    return sum;
}

/* Light to send, 0..1; NaN becomes 0. */
INLINE void unmixed(int kind, const struct procam_warp *d, const struct warp_block *block,
                    const struct samples *samples, size_t i, vf *sent) {
    vf wanted[3];
    for (int c = 0; c < 3; c++) {
        vf light = kind == U8 ? light_of_pixels(d, samples, i, c) : vload(samples->light[c] + i);
        if (kind != U8) light += light - light; /* infinity becomes NaN */
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

struct part { /* results before they are written: a tile of bytes, or a chunk of other types */
    uint8_t bytes[ROWS][3 * TILE + 64] __attribute__((aligned(64)));
    int32_t drive[3][CHUNK];
    float sent[3][CHUNK];
};

INLINE void finish(int out_kind, const struct procam_warp *d, const float *thresholds, size_t i,
                   const vf *sent, struct part *to, uint8_t *bytes) {
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
                        size_t x, size_t y, const struct part *part) {
    for (size_t i = 0; i < CHUNK; i++) {
        const size_t row = y + i / STRIP, column = x + i % STRIP;
        if (row >= tile->high || column >= tile->wide) continue;
        const size_t at = 3 * ((tile->top + row) * d->columns + tile->left + column);
        for (size_t c = 0; c < 3; c++)
            if (out_kind == U16)
                ((uint16_t *)d->out)[at + c] = (uint16_t)part->drive[c][i];
            else
                ((float *)d->out)[at + c] = part->sent[c][i];
    }
}

INLINE void write_bytes(const struct procam_warp *d, const struct tile *tile,
                        const struct part *part) {
    uint8_t *out = (uint8_t *)d->out + 3 * (tile->top * d->columns + tile->left);
    for (size_t y = 0; y < tile->high; y++)
        vcopy(out + 3 * y * d->columns, part->bytes[y], 3 * tile->wide);
}

/* Prefetches the blocks of the strip after the next, and the lines of the master for the next strip:
   for two pixels in 16, different ones in each row, so that a whole strip covers them all. */
INLINE void prefetch_strip(int kind, const struct procam_warp *d, const struct warp_block *blocks,
                       const struct warp_block *end, size_t row) {
    const size_t size = kind == U8 ? 1 : kind == F32 ? 4 : 2;
    if (blocks + 2 * IN_STRIP + IN_CHUNK > end) return;
    const char *later = (const char *)(blocks + 2 * IN_STRIP);
    for (size_t k = 0; k < IN_CHUNK * sizeof *blocks; k += 64) __builtin_prefetch(later + k, 0, 2);
    for (size_t k = 0; k < 2 * IN_CHUNK; k++) {
        const struct warp_block *b = blocks + IN_STRIP + k / 2;
        const size_t i = (k * BLOCK / 2 + 5 * (row + k / 4)) % BLOCK;
        const float x = b->base[PLACE_X] + b->step[PLACE_X] * (float)(int)b->number[PLACE_X][i];
        const float y = b->base[PLACE_Y] + b->step[PLACE_Y] * (float)(int)b->number[PLACE_Y][i];
        if (!(x >= 0 && x < (float)d->master_columns)) continue;
        if (!(y >= 0 && y < (float)d->master_rows)) continue;
        const size_t at = 3 * ((size_t)(int)y * d->master_columns + (size_t)(int)x);
        __builtin_prefetch((const char *)d->master + size * at);
    }
}

INLINE void warp_tile(int kind, int out_kind, const struct procam_warp *d, const struct tile *tile,
                      const struct warp_block *blocks, const struct warp_block *end) {
    struct samples samples;
    struct part part;
    for (size_t x = 0; x < TILE; x += STRIP)
        for (size_t y = 0; y < ROWS; y += CHUNK_ROWS, blocks += IN_CHUNK) {
            if (x >= tile->wide || y >= tile->high) continue;
            prefetch_strip(kind, d, blocks, end, y);
            find_samples(d, blocks, &samples);
            kind == U8 ? fetch_pixels(d, &samples) : fetch_light(kind, d, &samples);
            for (size_t i = 0; i < CHUNK; i += LANES) {
                const size_t row = y + i / STRIP, column = x + i % STRIP;
                const float *thresholds = d->thresholds + (tile->top + row) % TILE * TILE + column;
                vf sent[3];
                unmixed(kind, d, blocks + i / BLOCK, &samples, i, sent);
                finish(out_kind, d, thresholds, i, sent, &part, part.bytes[row] + 3 * column);
            }
            if (out_kind != U8) write_chunk(out_kind, d, tile, x, y, &part);
        }
    if (out_kind == U8) write_bytes(d, tile, &part);
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
