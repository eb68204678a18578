/* A dome that is the same everywhere: per colour, what is sent depends on the content's code alone.

   Pictures of 8 bits, 64 pixels at a time: three vectors. A colour's bytes lie at other places in each of
   them, so that colours are blended out of the three, and back, rather than shuffled. */

enum { EVEN = 64, STRETCH = 4096 };       /* pixels; those whose weights the first cache holds */
enum { PHASE_BITS = 8 };                  /* by which a number of 24 bits is shortened, up or down by turns */
enum { HIGH = 1 << 16, MIDDLE = 1 << 8 }; /* what sums of high and of middle products count */

struct sums { /* of numbers of 16 bits times weights of 15, less what both their low bytes give */
    int64_t high[3], middle[3], slope[3]; /* the last: of high bytes, times twice the rows from the middle */
};

/* What a row adds before it shortens numbers: 0..255, each once in 256 rows, evenly spread over fewer. */
INLINE uint32_t phase_of(size_t y) { return (uint32_t)(y * 159 % 256); }

struct stretch { /* of pixels */
    size_t first, end;
};

INLINE struct stretch lit_of_row(const struct procam_even *how, size_t y, struct stretch within) {
    size_t first = (size_t)how->lit[2 * y], end = (size_t)how->lit[2 * y + 1];
    if (first < within.first) first = within.first;
    if (first > within.end) first = within.end;
    if (end > within.end) end = within.end;
    return (struct stretch){first, end > first ? end : first};
}

struct row { /* of a picture, in a stretch of it */
    size_t y;
    struct stretch span, lit;
    int64_t beyond;      /* twice its rows from the band's middle */
    const int32_t *own;  /* of the band's blocks */
    const int8_t *slope;
    size_t number;       /* in the band */
};

INLINE struct row row_of(const struct procam_even *how, size_t band, size_t y, struct stretch span) {
    const size_t blocks = how->padded / EVEN, first = (size_t)how->rows[band], end = (size_t)how->rows[band + 1];
    struct row row = {.y = y, .span = span, .lit = lit_of_row(how, y, span), .number = y - first};
    row.beyond = 2 * (int64_t)y - (int64_t)(first + end - 1);
    row.own = how->own + band * blocks, row.slope = how->slope + band * blocks;
    return row;
}

#if LEVEL == 512
#define ALIGNED __attribute__((aligned(64)))
#define ALL (~(uint64_t)0)
#define TOP 0x80                 /* makes comparisons of signed bytes right */
#define THIRD 0x9249249249249249u /* every third of 64, from the first on */

struct weights { /* of a block, as the colours lie */
    int8_t coarse[3][EVEN], fine[3][EVEN];
} ALIGNED;

struct ready { /* tables, and of each colour: the pixel that a byte belongs to */
    uint8_t high[3][256], low[3][256], left[3][256]; /* of numbers to sum */
    uint8_t whole[3][256], rest[3][256], change[3][256];
    uint8_t pixel[3][EVEN];
    struct weights weights[STRETCH / EVEN];
} ALIGNED;

INLINE void byte_tables(const uint8_t *from, uint8_t turned, uint8_t (*to)[256]) {
    for (int i = 0; i < 768; i += 64)
        _mm512_store_si512(to[0] + i, _mm512_xor_si512(_mm512_loadu_si512(from + i), _mm512_set1_epi8((char)turned)));
}

INLINE void made_ready(const struct procam_even *how, struct ready *ready) {
    for (int i = 0; how->table && i < 768; i += 16) {
        const __m512i number = _mm512_loadu_si512(how->table + i);
        _mm_store_si128((void *)(ready->high[0] + i), _mm512_cvtepi32_epi8(_mm512_srli_epi32(number, 16)));
        _mm_store_si128((void *)(ready->low[0] + i), _mm512_cvtepi32_epi8(_mm512_srli_epi32(number, 8)));
        _mm_store_si128((void *)(ready->left[0] + i), _mm512_cvtepi32_epi8(number));
    }
    if (how->out) byte_tables(how->whole, 0, ready->whole), byte_tables(how->rest, TOP, ready->rest);
    if (how->change) byte_tables(how->change, 0, ready->change);
    for (int i = 0; i < 3 * EVEN; i++) ready->pixel[i % 3][i % EVEN] = (uint8_t)(i / 3);
}

INLINE void lay(const struct ready *ready, const int8_t *coarse, const int8_t *fine, struct weights *weights) {
    for (int c = 0; c < 3; c++) {
        const __m512i pixel = _mm512_load_si512(ready->pixel[c]);
        _mm512_store_si512(weights->coarse[c], _mm512_permutexvar_epi8(pixel, _mm512_loadu_si512(coarse)));
        _mm512_store_si512(weights->fine[c], _mm512_permutexvar_epi8(pixel, _mm512_loadu_si512(fine)));
    }
}

INLINE void weights_of(const struct procam_even *how, size_t band, struct stretch span, struct ready *ready) {
    const int8_t *coarse = how->coarse + band * how->padded, *fine = how->fine + band * how->padded;
    for (size_t x = span.first; x < span.end; x += EVEN)
        lay(ready, coarse + x, fine + x, ready->weights + (x - span.first) / EVEN);
}

/* Those of a row's block; `room` is for weights of its own. */
INLINE const struct weights *weights_at(const struct procam_even *how, const struct ready *ready,
                                        const struct row *row, size_t x, struct weights *room) {
    const int32_t own = row->own[x / EVEN];
    if (own < 0) return ready->weights + (x - row->span.first) / EVEN;
    const size_t at = ((size_t)own * how->tall + row->number) * EVEN;
    lay(ready, how->own_coarse + at, how->own_fine + at, room);
    return room;
}

/* Bytes 0, 3, 6.. of one vector, 1, 4, 7.. of another, 2, 5, 8.. of a third. */
INLINE __m512i blended(const __m512i *of, int first, int second, int third) {
    const __m512i two = _mm512_mask_mov_epi8(of[first], (uint64_t)THIRD << 1, of[second]);
    return _mm512_mask_mov_epi8(two, (uint64_t)THIRD << 2, of[third]);
}

INLINE struct codes colour_of(const __m512i *parts, int colour) {
    return codes_of(blended(parts, colour, (colour + 2) % 3, (colour + 1) % 3));
}

INLINE uint64_t inside(struct stretch lit, size_t at) { /* one bit per pixel of a block */
    if (lit.first >= lit.end || at >= lit.end || at + EVEN <= lit.first) return 0;
    uint64_t bits = ALL;
    if (lit.first > at) bits &= bits << (lit.first - at);
    if (lit.end < at + EVEN) bits &= ALL >> (at + EVEN - lit.end);
    return bits;
}

/* The same as a colour's bytes lie. */
INLINE uint64_t lit_bytes(const struct ready *ready, int colour, uint64_t lit) {
    const __m512i pixel = _mm512_load_si512(ready->pixel[colour]);
    return lit == ALL ? ALL : _mm512_movepi8_mask(_mm512_permutexvar_epi8(pixel, _mm512_movm_epi8(lit)));
}

/* The same place of the next row is fetched ahead: what follows in memory may be right of the lit part. */
INLINE void load_even(const struct procam_even *how, size_t start, size_t pixels, __m512i *parts) {
    const uint8_t *from = how->image + start;
    for (int k = 0; k < 3; k++) fetch(from + 3 * how->size + 64 * k);
    if (pixels >= EVEN) {
        for (int k = 0; k < 3; k++) parts[k] = _mm512_loadu_si512(from + 64 * k);
        return;
    }
    uint8_t room[3 * EVEN] = {0};
    memcpy(room, from, 3 * pixels);
    for (int k = 0; k < 3; k++) parts[k] = _mm512_loadu_si512(room + 64 * k);
}

INLINE void store_even(uint8_t *to, size_t pixels, const __m512i *parts) {
    uint8_t room[3 * EVEN];
    if (pixels >= EVEN && (uintptr_t)to % 64 == 0) {
        for (int k = 0; k < 3; k++) _mm512_stream_si512((void *)(to + 64 * k), parts[k]);
        return;
    }
    for (int k = 0; k < 3; k++) _mm512_storeu_si512(room + 64 * k, parts[k]);
    memcpy(to, room, 3 * (pixels < EVEN ? pixels : EVEN));
}

struct lanes { /* sums of a row */
    __m512i high[3], middle[3], slope[3];
};

INLINE int64_t added(__m512i lanes) {
    int32_t each[16];
    int64_t sum = 0;
    _mm512_storeu_si512(each, lanes);
    for (int k = 0; k < 16; k++) sum += each[k];
    return sum;
}

INLINE void add_lanes(const struct lanes *lanes, const struct row *row, struct sums *sums) {
    for (int c = 0; c < 3; c++) {
        sums->high[c] += added(lanes->high[c]), sums->middle[c] += added(lanes->middle[c]);
        sums->slope[c] += row->beyond * added(lanes->slope[c]);
    }
}

INLINE void count(__m512i *sum, __m512i bytes, const int8_t *weights) {
    *sum = _mm512_dpbusd_epi32(*sum, bytes, _mm512_load_si512(weights));
}

struct numbers { /* tables of a row: high and low bytes */
    uint8_t high[3][256], low[3][256];
} ALIGNED;

INLINE void numbers_of_row(const struct ready *ready, size_t y, struct numbers *numbers) {
    const __m512i full = _mm512_set1_epi8((char)(255 - phase_of(y))), one = _mm512_set1_epi8(1);
    for (int i = 0; i < 768; i += 64) {
        const __m512i low = _mm512_load_si512(ready->low[0] + i), high = _mm512_load_si512(ready->high[0] + i);
        const __mmask64 up = _mm512_cmpgt_epu8_mask(_mm512_load_si512(ready->left[0] + i), full);
        const __mmask64 over = _mm512_mask_cmpeq_epi8_mask(up, low, _mm512_set1_epi8(-1));
        _mm512_store_si512(numbers->low[0] + i, _mm512_mask_add_epi8(low, up, low, one));
        _mm512_store_si512(numbers->high[0] + i, _mm512_mask_add_epi8(high, over, high, one));
    }
}

INLINE void sum_block(const struct procam_even *how, const struct numbers *numbers, size_t start, size_t left,
                      const struct weights *weights, int8_t slope, struct lanes *lanes) {
    const __m512i slopes = _mm512_set1_epi8(slope);
    __m512i parts[3];
    load_even(how, start, left, parts);
    for (int c = 0; c < 3; c++) {
        const struct codes codes = colour_of(parts, c);
        const __m512i high = looked_up(numbers->high[c], &codes);
        count(lanes->high + c, high, weights->coarse[c]);
        count(lanes->middle + c, high, weights->fine[c]);
        count(lanes->middle + c, looked_up(numbers->low[c], &codes), weights->coarse[c]);
        lanes->slope[c] = _mm512_dpbusd_epi32(lanes->slope[c], high, slopes);
    }
}

INLINE void sum_row(const struct procam_even *how, const struct ready *ready, const struct row *row, struct sums *sums) {
    struct numbers numbers;
    struct weights room;
    struct lanes lanes = {0};
    numbers_of_row(ready, row->y, &numbers);
    for (size_t x = row->lit.first / EVEN * EVEN; x < row->lit.end; x += EVEN) {
        const size_t left = how->size - x, start = 3 * (row->y * how->size + x);
        const struct weights *weights = weights_at(how, ready, row, x, &room);
        sum_block(how, &numbers, start, left, weights, row->slope[x / EVEN], &lanes);
    }
    add_lanes(&lanes, row, sums);
}

/* `weights` are NULL where nothing is counted. */
INLINE void write_block(const struct procam_even *how, const struct ready *ready, const __m512i *over,
                        size_t start, size_t left, uint64_t lit, const struct weights *weights, struct lanes *lanes) {
    __m512i parts[3], colour[3] = {0};
    if (lit) load_even(how, start, left, parts);
    for (int c = 0; lit && c < 3; c++) {
        const struct codes codes = colour_of(parts, c);
        const uint64_t kept = lit_bytes(ready, c, lit);
        const __m512i whole = _mm512_maskz_mov_epi8(kept, looked_up(ready->whole[c], &codes));
        const __m512i rest = looked_up(ready->rest[c], &codes);
        const __mmask64 up = _mm512_movepi8_mask(_mm512_subs_epi8(over[c], rest)) & kept;
        colour[c] = _mm512_mask_add_epi8(whole, up, whole, _mm512_set1_epi8(1));
        if (weights) count(lanes->high + c, looked_up(ready->change[c], &codes), weights->coarse[c]);
    }
    for (int k = 0; k < 3; k++) parts[k] = blended(colour, k, (k + 1) % 3, (k + 2) % 3);
    store_even(how->out + start, left, parts);
}

INLINE void write_row(const struct procam_even *how, const struct ready *ready, const struct row *row, int counts,
                      struct sums *sums) {
    struct weights room;
    struct lanes lanes = {0};
    const __m512i tile = _mm512_xor_si512(_mm512_set1_epi8((char)TOP),
                                          _mm512_loadu_si512(how->threshold + row->y % EVEN * EVEN));
    __m512i over[3];
    for (int c = 0; c < 3; c++) over[c] = _mm512_permutexvar_epi8(_mm512_load_si512(ready->pixel[c]), tile);
    for (size_t x = row->span.first; x < row->span.end; x += EVEN) {
        const size_t left = how->size - x, start = 3 * (row->y * how->size + x);
        const uint64_t lit = inside(row->lit, x);
        const struct weights *weights = counts && lit ? weights_at(how, ready, row, x, &room) : NULL;
        if (lit == ALL && (uintptr_t)(how->out + start) % 64 == 0)
            write_block(how, ready, over, start, EVEN, ALL, weights, &lanes);
        else write_block(how, ready, over, start, left, lit, weights, &lanes);
    }
    if (counts) add_lanes(&lanes, row, sums);
}
#else
struct ready { /* of each colour and code: what to write, with its rest, and << 16 what to sum */
    uint32_t word[3][256];
    const int8_t *coarse, *fine; /* weights of a stretch */
};

INLINE void made_ready(const struct procam_even *how, struct ready *ready) {
    for (int i = 0; how->out && i < 768; i++)
        ready->word[i / 256][i % 256] =
            (uint32_t)how->whole[i] << 8 | how->rest[i] | (how->change ? (uint32_t)how->change[i] << 16 : 0);
}

INLINE void weights_of(const struct procam_even *how, size_t band, struct stretch span, struct ready *ready) {
    ready->coarse = how->coarse + band * how->padded + span.first;
    ready->fine = how->fine + band * how->padded + span.first;
}

struct weights { /* of a block */
    const int8_t *coarse, *fine;
};

INLINE struct weights weights_at(const struct procam_even *how, const struct ready *ready, const struct row *row, size_t x) {
    const int32_t own = row->own[x / EVEN];
    const size_t block = (x - row->span.first) / EVEN * EVEN, at = ((size_t)(own < 0 ? 0 : own) * how->tall + row->number) * EVEN;
    if (own < 0) return (struct weights){ready->coarse + block, ready->fine + block};
    return (struct weights){how->own_coarse + at, how->own_fine + at};
}

INLINE void sum_row(const struct procam_even *how, const struct ready *ready, const struct row *row, struct sums *sums) {
    const uint8_t *from = how->image + row->y * 3 * how->size;
    const uint32_t phase = phase_of(row->y);
    struct weights weights = {0};
    for (size_t x = row->lit.first; x < row->lit.end; x++) {
        if (x == row->lit.first || x % EVEN == 0) weights = weights_at(how, ready, row, x);
        const int32_t coarse = weights.coarse[x % EVEN], fine = weights.fine[x % EVEN], slope = row->slope[x / EVEN];
        for (size_t c = 0; c < 3; c++) {
            const int32_t number = (int32_t)((how->table[256 * c + from[3 * x + c]] + phase) >> PHASE_BITS);
            sums->high[c] += coarse * (number >> 8);
            sums->middle[c] += fine * (number >> 8) + coarse * (number & 255);
            sums->slope[c] += row->beyond * slope * (number >> 8);
        }
    }
}

INLINE void write_row(const struct procam_even *how, const struct ready *ready, const struct row *row, int counts,
                      struct sums *sums) {
    const struct stretch span = row->span, lit = row->lit;
    const size_t start = row->y * 3 * how->size;
    const uint8_t *from = how->image + start, *over = how->threshold + row->y % EVEN * EVEN;
    uint8_t *to = how->out + start;
    struct weights weights = {0};
    for (size_t x = lit.first; x < lit.end; x++) {
        if (counts && (x == lit.first || x % EVEN == 0)) weights = weights_at(how, ready, row, x);
        const int32_t coarse = counts ? weights.coarse[x % EVEN] : 0;
        for (size_t c = 0; c < 3; c++) {
            const uint32_t word = ready->word[c][from[3 * x + c]];
            to[3 * x + c] = (uint8_t)(((word & 65535) + 255u - over[x % EVEN]) >> 8);
            if (counts) sums->high[c] += coarse * (int32_t)(word >> 16);
        }
    }
    memset(to + 3 * span.first, 0, 3 * (lit.first - span.first));
    memset(to + 3 * lit.end, 0, 3 * (span.end - lit.end));
}
#endif

/* A band of rows: written, or summed, each column under its weight, or both. What is summed while
   writing counts by coarse weights alone. */
INLINE void even_band(const struct even *job, struct ready *ready, size_t band, int writes, int counts) {
    const struct procam_even *how = job->how;
    struct sums sums = {0};
    for (struct stretch span = {0}; span.first < how->size; span.first += STRETCH) {
        span.end = span.first + STRETCH < how->size ? span.first + STRETCH : how->size;
        if (counts) weights_of(how, band, span, ready);
        for (size_t y = (size_t)how->rows[band]; y < (size_t)how->rows[band + 1]; y++) {
            const struct row row = row_of(how, band, y, span);
            if (writes) write_row(how, ready, &row, counts, &sums);
            else sum_row(how, ready, &row, &sums);
        }
    }
    for (size_t c = 0; counts && c < 3; c++)
        job->sums[3 * band + c] = HIGH * (double)sums.high[c] + MIDDLE * (double)sums.middle[c] +
                                  MIDDLE / 2 * how->steps * (double)sums.slope[c];
}

static void even(const struct even *job, size_t first, size_t count) {
    struct ready ready;
    made_ready(job->how, &ready);
    for (size_t band = first; band < first + count; band++) {
        if (!job->how->out) even_band(job, &ready, band, 0, 1);
        else if (!job->sums) even_band(job, &ready, band, 1, 0);
        else even_band(job, &ready, band, 1, 1);
    }
    vfence();
}
