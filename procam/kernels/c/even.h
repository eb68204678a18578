/* A dome that is the same everywhere: per colour, what is sent depends on the content's code alone.

   Pictures of 8 bits, 64 pixels at a time, each colour on its own. */

enum { EVEN = 64, GROUP = 8 }; /* pixels; those that share a weight */

INLINE uint64_t inside(const int32_t *lit, size_t at) { /* one bit per pixel of a block */
    const size_t first = (size_t)lit[0], end = (size_t)lit[1];
    if (first >= end || at >= end || at + EVEN <= first) return 0;
    uint64_t bits = ~(uint64_t)0;
    if (first > at) bits &= bits << (first - at);
    if (end < at + EVEN) bits &= ~(uint64_t)0 >> (at + EVEN - end);
    return bits;
}

#if LEVEL == 512
struct turn { /* byte orders between three colours together and one by one */
    __m512i one[3], two[3];
};

INLINE struct turn apart_order(void) {
    struct turn turn;
    for (int c = 0; c < 3; c++) {
        uint8_t first[EVEN], second[EVEN];
        for (int i = 0; i < EVEN; i++) {
            const int place = 3 * i + c; /* of 192 */
            first[i] = (uint8_t)(place < 128 ? place : 0);
            second[i] = (uint8_t)(place < 128 ? i : 64 + place - 128);
        }
        turn.one[c] = _mm512_loadu_si512(first);
        turn.two[c] = _mm512_loadu_si512(second);
    }
    return turn;
}

INLINE struct turn together_order(void) {
    struct turn turn;
    for (int part = 0; part < 3; part++) {
        uint8_t first[EVEN], second[EVEN];
        for (int i = 0; i < EVEN; i++) {
            const int place = 64 * part + i, pixel = place / 3, c = place % 3;
            first[i] = (uint8_t)(c == 1 ? 64 + pixel : pixel);
            second[i] = (uint8_t)(c == 2 ? 64 + pixel : i);
        }
        turn.one[part] = _mm512_loadu_si512(first);
        turn.two[part] = _mm512_loadu_si512(second);
    }
    return turn;
}

INLINE __m512i turned(const struct turn *turn, int which, const __m512i *of) {
    const __m512i two = _mm512_permutex2var_epi8(of[0], turn->one[which], of[1]);
    return _mm512_permutex2var_epi8(two, turn->two[which], of[2]);
}

struct table { /* of 256 bytes */
    __m512i part[4];
};

INLINE struct table byte_table(const uint32_t *words, int shift) {
    uint8_t bytes[256];
    for (int i = 0; i < 256; i++) bytes[i] = (uint8_t)(words[i] >> shift);
    struct table table;
    for (int k = 0; k < 4; k++) table.part[k] = _mm512_loadu_si512(bytes + 64 * k);
    return table;
}

INLINE __m512i looked_up(const struct table *table, __m512i codes) {
    const __m512i low = _mm512_permutex2var_epi8(table->part[0], codes, table->part[1]);
    const __m512i high = _mm512_permutex2var_epi8(table->part[2], codes, table->part[3]);
    return _mm512_mask_blend_epi8(_mm512_movepi8_mask(codes), low, high);
}

INLINE void load_even(const uint8_t *from, size_t pixels, __m512i *parts) {
    if (pixels >= EVEN) {
        for (int k = 0; k < 3; k++) parts[k] = _mm512_loadu_si512(from + 64 * k);
        return;
    }
    uint8_t room[3 * EVEN] = {0};
    memcpy(room, from, 3 * pixels);
    for (int k = 0; k < 3; k++) parts[k] = _mm512_loadu_si512(room + 64 * k);
}

INLINE void even_apply(const struct procam_even *how, size_t first, size_t count) {
    const struct turn apart = apart_order(), together = together_order();
    struct table whole[3], rest[3];
    for (int c = 0; c < 3; c++)
        whole[c] = byte_table(how->table + 256 * c, 8), rest[c] = byte_table(how->table + 256 * c, 0);
    for (size_t y = first; y < first + count; y++) {
        const size_t start = y * 3 * how->size;
        const uint8_t *from = how->image + start;
        uint8_t *to = how->out + start;
        const __m512i over = _mm512_loadu_si512(how->threshold + y % EVEN * EVEN);
        for (size_t x = 0; x < how->size; x += EVEN) {
            const size_t left = how->size - x;
            const uint64_t lit = inside(how->lit + 2 * y, x);
            __m512i parts[3], made[3], colour[3] = {0};
            if (lit) {
                load_even(from + 3 * x, left, parts);
                for (int c = 0; c < 3; c++) {
                    const __m512i codes = turned(&apart, c, parts);
                    const __m512i base = looked_up(whole + c, codes);
                    const __mmask64 up = _mm512_cmpgt_epu8_mask(looked_up(rest + c, codes), over);
                    colour[c] = _mm512_maskz_mov_epi8(lit, base);
                    colour[c] = _mm512_mask_adds_epu8(colour[c], up & lit, base, _mm512_set1_epi8(1));
                }
            }
            for (int k = 0; k < 3; k++) made[k] = turned(&together, k, colour);
            uint8_t *place = to + 3 * x, room[3 * EVEN];
            if (left >= EVEN && (uintptr_t)place % 64 == 0)
                for (int k = 0; k < 3; k++) _mm512_stream_si512((void *)(place + 64 * k), made[k]);
            else {
                for (int k = 0; k < 3; k++) _mm512_storeu_si512(room + 64 * k, made[k]);
                memcpy(place, room, 3 * (left < EVEN ? left : EVEN));
            }
        }
    }
    _mm_sfence();
}

INLINE void even_totals(const struct procam_even *how, size_t y, const struct turn *apart,
                        const struct table (*bytes)[3], uint32_t *totals) {
    const uint8_t *from = how->image + y * 3 * how->size;
    const __m512i none = _mm512_setzero_si512();
    for (size_t x = 0; x < how->size; x += EVEN) {
        const uint64_t lit = inside(how->lit + 2 * y, x);
        __m512i parts[3];
        if (!lit) continue;
        load_even(from + 3 * x, how->size - x, parts);
        for (int c = 0; c < 3; c++) {
            const __m512i codes = turned(apart, c, parts);
            __m512i sum = none;
            for (int k = 2; k >= 0; k--) { /* the highest byte first */
                const __m512i part = _mm512_maskz_mov_epi8(lit, looked_up(&bytes[c][k], codes));
                sum = _mm512_add_epi64(_mm512_slli_epi64(sum, 8), _mm512_sad_epu8(part, none));
            }
            __m256i *to = (__m256i *)(totals + (size_t)c * how->groups + x / GROUP);
            _mm256_storeu_si256(to, _mm256_add_epi32(_mm256_loadu_si256(to), _mm512_cvtepi64_epi32(sum)));
        }
    }
}
#else
INLINE void even_apply(const struct procam_even *how, size_t first, size_t count) {
    for (size_t y = first; y < first + count; y++) {
        const size_t start = y * 3 * how->size, begin = (size_t)how->lit[2 * y];
        const size_t end = (size_t)how->lit[2 * y + 1] > begin ? (size_t)how->lit[2 * y + 1] : begin;
        const uint8_t *from = how->image + start, *over = how->threshold + y % EVEN * EVEN;
        uint8_t *to = how->out + start;
        memset(to, 0, 3 * begin);
        for (size_t x = begin; x < end; x++)
            for (size_t c = 0; c < 3; c++) {
                const uint32_t word = how->table[256 * c + from[3 * x + c]] + 255u - over[x % EVEN];
                to[3 * x + c] = (uint8_t)(word > 65535 ? 255 : word >> 8);
            }
        memset(to + 3 * end, 0, 3 * (how->size - end));
    }
}

INLINE void even_totals(const struct procam_even *how, size_t y, uint32_t *totals) {
    const uint8_t *from = how->image + y * 3 * how->size;
    for (size_t x = (size_t)how->lit[2 * y]; x < (size_t)how->lit[2 * y + 1]; x++)
        for (size_t c = 0; c < 3; c++)
            totals[c * how->groups + x / GROUP] += how->table[256 * c + from[3 * x + c]];
}
#endif

/* Sums of one band of rows, each group of pixels under its weight. */
INLINE void even_sums(const struct procam_even *how, size_t band, double *sums) {
    const size_t count = 3 * how->groups;
    uint32_t *totals = how->totals + band * count;
    memset(totals, 0, count * sizeof *totals);
#if LEVEL == 512
    const struct turn apart = apart_order();
    struct table bytes[3][3];
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < 3; k++) bytes[c][k] = byte_table(how->table + 256 * c, 8 * k);
#endif
    for (size_t y = (size_t)how->rows[band]; y < (size_t)how->rows[band + 1]; y++)
#if LEVEL == 512
        even_totals(how, y, &apart, bytes, totals);
#else
        even_totals(how, y, totals);
#endif
    for (size_t c = 0; c < 3; c++) {
        double sum = 0;
        for (size_t g = 0; g < how->groups; g++)
            sum += (double)how->weight[band * how->groups + g] * totals[c * how->groups + g];
        sums[3 * band + c] = sum;
    }
}

static void even(const struct even *job, size_t first, size_t count) {
    if (!job->sums) even_apply(job->how, first, count);
    else
        for (size_t band = first; band < first + count; band++) even_sums(job->how, band, job->sums);
}
