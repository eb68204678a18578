/* A dome that is the same everywhere: per colour, what is sent depends on the content's code alone.

   Pictures of 8 bits, 64 pixels at a time, each colour on its own. */

enum { EVEN = 64, GROUP = 8 }; /* pixels; those that share a weight */
enum { AFAR = 12288 };         /* bytes that are fetched ahead */
enum { PHASE_BITS = 6 };       /* by which a number of 22 bits is shortened, up or down by turns */

/* What a row adds before it shortens numbers: 0..63, each once in 64 rows, evenly spread over fewer. */
INLINE uint32_t phase_of(size_t y) { return (uint32_t)(y * 39 % 64); }

INLINE uint64_t inside(const int32_t *lit, size_t at) { /* one bit per pixel of a block */
    const size_t first = (size_t)lit[0], end = (size_t)lit[1];
    if (first >= end || at >= end || at + EVEN <= first) return 0;
    uint64_t bits = ~(uint64_t)0;
    if (first > at) bits &= bits << (first - at);
    if (end < at + EVEN) bits &= ~(uint64_t)0 >> (at + EVEN - end);
    return bits;
}

#if LEVEL == 512
#define ALIGNED __attribute__((aligned(64)))
#define ALL (~(uint64_t)0)
struct turn { /* byte orders between three colours together and one by one */
    __m512i place[3][2]; /* of each result's bytes, among the first two parts and in the third */
    __mmask64 from[3];   /* which are there */
};

/* Where bytes of three parts go: colours one by one, or together. */
INLINE void order_of(int together, struct turn *turn) {
    for (int result = 0; result < 3; result++) {
        uint8_t place[2][EVEN] ALIGNED;
        uint64_t from = 0;
        for (int i = 0; i < EVEN; i++) {
            const int at = together ? EVEN * result + i : 3 * i + result;
            const int part = together ? at % 3 : at / EVEN, byte = together ? at / 3 : at % EVEN;
            place[0][i] = (uint8_t)(part == 1 ? EVEN + byte : byte), place[1][i] = (uint8_t)byte;
            from |= (uint64_t)(part == 2) << i;
        }
        for (int k = 0; k < 2; k++) turn->place[result][k] = _mm512_load_si512(place[k]);
        turn->from[result] = from;
    }
}

struct orders {
    struct turn apart, together;
};

INLINE struct orders orders(const struct procam_even *how) {
    (void)how;
    struct orders orders;
    order_of(0, &orders.apart);
    order_of(1, &orders.together);
    return orders;
}

INLINE __m512i turned(const struct turn *turn, int which, const __m512i *of) {
    const __m512i *place = turn->place[which];
    const __m512i two = _mm512_permutex2var_epi8(of[0], place[0], of[1]);
    return _mm512_mask_permutexvar_epi8(two, turn->from[which], place[1], of[2]);
}

struct table { /* of 256 bytes */
    __m512i part[4];
};

struct words { /* of 256 words of 16 bits */
    struct table high, low;
};

INLINE struct table byte_table(const uint8_t *bytes, uint8_t turned) {
    struct table table;
    for (int k = 0; k < 4; k++)
        table.part[k] = _mm512_xor_si512(_mm512_loadu_si512(bytes + 64 * k), _mm512_set1_epi8((char)turned));
    return table;
}

INLINE struct words word_tables(const uint32_t *table, uint32_t phase) {
    const __m512i more = _mm512_set1_epi32((int)phase);
    uint8_t bytes[2][256] __attribute__((aligned(64)));
    for (int i = 0; i < 256; i += 16) {
        const __m512i word = _mm512_srli_epi32(_mm512_add_epi32(_mm512_loadu_si512(table + i), more), PHASE_BITS);
        _mm_store_si128((void *)(bytes[0] + i), _mm512_cvtepi32_epi8(_mm512_srli_epi32(word, 8)));
        _mm_store_si128((void *)(bytes[1] + i), _mm512_cvtepi32_epi8(word));
    }
    struct words words;
    for (int k = 0; k < 4; k++) {
        words.high.part[k] = _mm512_load_si512(bytes[0] + 64 * k);
        words.low.part[k] = _mm512_load_si512(bytes[1] + 64 * k);
    }
    return words;
}

INLINE __m512i looked_up(const struct table *table, __m512i codes) {
    const __m512i low = _mm512_permutex2var_epi8(table->part[0], codes, table->part[1]);
    const __m512i high = _mm512_permutex2var_epi8(table->part[2], codes, table->part[3]);
    return _mm512_mask_blend_epi8(_mm512_movepi8_mask(codes), low, high);
}

INLINE void load_even(const uint8_t *from, size_t pixels, __m512i *parts) {
    for (int k = 0; k < 3; k++) fetch(from + AFAR + 64 * k);
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

INLINE void add_even(uint64_t *totals, __m512i sums) {
    _mm512_storeu_si512(totals, _mm512_add_epi64(_mm512_loadu_si512(totals), sums));
}

INLINE __m512i sums_of(const struct table *table, __m512i codes, uint64_t lit) {
    return _mm512_sad_epu8(_mm512_maskz_mov_epi8(lit, looked_up(table, codes)), _mm512_setzero_si512());
}

INLINE void sum_block(const struct procam_even *how, const struct orders *orders, const struct words *words,
                      const uint8_t *from, size_t left, uint64_t lit, uint64_t *totals) {
    __m512i parts[3];
    load_even(from, left, parts);
    for (int c = 0; c < 3; c++) {
        const __m512i codes = turned(&orders->apart, c, parts);
        const __m512i high = _mm512_slli_epi64(sums_of(&words[c].high, codes, lit), 8);
        add_even(totals + (size_t)c * how->groups, _mm512_add_epi64(high, sums_of(&words[c].low, codes, lit)));
    }
}

INLINE void sum_row(const struct procam_even *how, const struct orders *orders, size_t y, uint64_t *totals) {
    struct words words[3];
    for (int c = 0; c < 3; c++) words[c] = word_tables(how->table + 256 * c, phase_of(y));
    for (size_t x = 0; x < how->size; x += EVEN) {
        const uint64_t lit = inside(how->lit + 2 * y, x);
        const uint8_t *from = how->image + 3 * (y * how->size + x);
        if (lit == ALL) sum_block(how, orders, words, from, EVEN, ALL, totals + x / GROUP);
        else if (lit) sum_block(how, orders, words, from, how->size - x, lit, totals + x / GROUP);
    }
}

struct written { /* tables of three colours */
    struct table whole[3], rest[3], change[3];
    __m512i over;
};

INLINE void write_block(const struct procam_even *how, const struct orders *orders, const struct written *tables,
                        size_t start, size_t left, uint64_t lit, uint64_t *totals) {
    __m512i parts[3], colour[3] = {0};
    if (lit) load_even(how->image + start, left, parts);
    for (int c = 0; lit && c < 3; c++) {
        const __m512i codes = turned(&orders->apart, c, parts);
        const __m512i base = _mm512_maskz_mov_epi8(lit, looked_up(tables->whole + c, codes));
        const __m512i rest = looked_up(tables->rest + c, codes);
        const __mmask64 up = _mm512_movepi8_mask(_mm512_subs_epi8(tables->over, rest)) & lit;
        colour[c] = _mm512_mask_adds_epu8(base, up, base, _mm512_set1_epi8(1));
        if (totals) add_even(totals + (size_t)c * how->groups, sums_of(tables->change + c, codes, lit));
    }
    for (int k = 0; k < 3; k++) parts[k] = turned(&orders->together, k, colour);
    store_even(how->out + start, left, parts);
}

INLINE void write_row(const struct procam_even *how, const struct orders *orders, size_t y, int counts,
                      uint64_t *totals) {
    const uint8_t top = 0x80; /* makes comparisons of signed bytes right */
    struct written tables;
    tables.over = _mm512_xor_si512(_mm512_set1_epi8((char)top), _mm512_loadu_si512(how->threshold + y % EVEN * EVEN));
    for (int c = 0; c < 3; c++) {
        tables.whole[c] = byte_table(how->whole + 256 * c, 0), tables.rest[c] = byte_table(how->rest + 256 * c, top);
        if (counts) tables.change[c] = byte_table(how->change + 256 * c, 0);
    }
    for (size_t x = 0; x < how->size; x += EVEN) {
        const size_t left = how->size - x, start = 3 * (y * how->size + x);
        const uint64_t lit = inside(how->lit + 2 * y, x);
        uint64_t *to = counts ? totals + x / GROUP : NULL;
        if (lit == ALL && (uintptr_t)(how->out + start) % 64 == 0)
            write_block(how, orders, &tables, start, EVEN, ALL, to);
        else write_block(how, orders, &tables, start, left, lit, to);
    }
}
#else
struct orders { /* of each colour and code: what to write, with its rest, and << 16 what to sum */
    uint32_t word[3][256];
};

INLINE struct orders orders(const struct procam_even *how) {
    struct orders orders;
    for (int i = 0; how->out && i < 768; i++)
        orders.word[i / 256][i % 256] =
            (uint32_t)how->whole[i] << 8 | how->rest[i] | (how->change ? (uint32_t)how->change[i] << 16 : 0);
    return orders;
}

struct span { /* pixels */
    size_t first, end;
};

INLINE struct span lit_of_row(const struct procam_even *how, size_t y) {
    const size_t first = (size_t)how->lit[2 * y], end = (size_t)how->lit[2 * y + 1];
    return (struct span){first, end > first ? end : first};
}

INLINE size_t end_of_group(size_t x, size_t end) { /* that pixel x is in */
    const size_t next = (x / GROUP + 1) * GROUP;
    return next < end ? next : end;
}

INLINE void sum_row(const struct procam_even *how, const struct orders *orders, size_t y, uint64_t *totals) {
    (void)orders;
    const struct span lit = lit_of_row(how, y);
    const uint8_t *from = how->image + y * 3 * how->size;
    const uint32_t phase = phase_of(y);
    for (size_t x = lit.first, end; x < lit.end; x = end) {
        uint32_t sums[3] = {0};
        end = end_of_group(x, lit.end);
        for (size_t at = x; at < end; at++)
            for (size_t c = 0; c < 3; c++) sums[c] += (how->table[256 * c + from[3 * at + c]] + phase) >> PHASE_BITS;
        for (size_t c = 0; c < 3; c++) totals[c * how->groups + x / GROUP] += sums[c];
    }
}

INLINE void write_row(const struct procam_even *how, const struct orders *orders, size_t y, int counts,
                      uint64_t *totals) {
    const struct span lit = lit_of_row(how, y);
    const size_t start = y * 3 * how->size;
    const uint8_t *from = how->image + start, *over = how->threshold + y % EVEN * EVEN;
    uint8_t *to = how->out + start;
    for (size_t x = lit.first, end; x < lit.end; x = end) {
        uint32_t sums[3] = {0};
        end = end_of_group(x, lit.end);
        for (size_t at = x; at < end; at++)
            for (size_t c = 0; c < 3; c++) {
                const uint32_t word = orders->word[c][from[3 * at + c]];
                const uint32_t code = ((word & 65535) + 255u - over[at % EVEN]) >> 8;
                to[3 * at + c] = (uint8_t)(code > 255 ? 255 : code);
                sums[c] += word >> 16;
            }
        for (size_t c = 0; counts && c < 3; c++) totals[c * how->groups + x / GROUP] += sums[c];
    }
    memset(to, 0, 3 * lit.first);
    memset(to + 3 * lit.end, 0, 3 * (how->size - lit.end));
}
#endif

/* A band of rows: written, or summed, each group of pixels under its weight, or both. */
INLINE void even_band(const struct even *job, const struct orders *orders, size_t band, int writes, int counts) {
    const struct procam_even *how = job->how;
    const size_t count = 3 * how->groups;
    uint64_t *totals = counts ? how->totals + band * count : NULL;
    if (counts) memset(totals, 0, count * sizeof *totals);
    for (size_t y = (size_t)how->rows[band]; y < (size_t)how->rows[band + 1]; y++) {
        if (writes) write_row(how, orders, y, counts, totals);
        else sum_row(how, orders, y, totals);
    }
    for (size_t c = 0; counts && c < 3; c++) {
        const float *weight = how->weight + band * how->groups;
        double sums[GROUP] = {0}; /* of a block's groups, one by one: a block has as many as a group has pixels */
        for (size_t g = 0; g < how->groups; g += GROUP)
            for (size_t k = 0; k < GROUP; k++)
                sums[k] += (double)weight[g + k] * (double)totals[c * how->groups + g + k];
        job->sums[3 * band + c] = 0;
        for (size_t k = 0; k < GROUP; k++) job->sums[3 * band + c] += sums[k];
    }
}

static void even(const struct even *job, size_t first, size_t count) {
    const struct orders order = orders(job->how);
    for (size_t band = first; band < first + count; band++) {
        if (!job->how->out) even_band(job, &order, band, 0, 1);
        else if (!job->sums) even_band(job, &order, band, 1, 0);
        else even_band(job, &order, band, 1, 1);
    }
    vfence();
}
