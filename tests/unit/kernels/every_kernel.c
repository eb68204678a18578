/* Runs every kernel at every level over odd sizes, in buffers of exactly the size needed, so that
   the address and undefined-behaviour sanitizers see each byte it must not touch. With an argument, at the
   level of that number alone, and the results are written to stdout, for a comparison with those of another. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kernels.h"

int procam_levels(void);
void procam_search(int, int, int, size_t, const void *const *, const struct procam_search *,
                   float *const *);
void procam_bundle(int, int, size_t, const struct procam_bundle *, int, size_t, double *, double *);
void procam_residuals(int, int, size_t, const struct procam_bundle *, double *);
void procam_rays(int, int, size_t, const double *, const double *, int, const double *, double,
                 double *);
void procam_warp(int, int, size_t, const struct procam_warp *);
void procam_frame(int, int, int, size_t, size_t, const struct procam_frame *, double *);
void procam_scattered(int, int, int, int, const float *, const float *, const float *, const double *,
                   const double *, float *);

enum { FRAMES = 12 };
static int written;

/* Writes results: a letter for their type (of Python's struct, or s for floats of a search), their number, themselves. */
static void keep(char type, size_t width, const void *found, size_t count) {
    if (!written) return;
    fwrite(&type, 1, 1, stdout), fwrite(&count, sizeof count, 1, stdout), fwrite(found, width, count, stdout);
}

static unsigned seed = 1; /* of a generator as quick as the buffers are many */

static void *room(size_t bytes) {
    unsigned char *found = NULL;
    if (posix_memalign((void **)&found, 64, bytes ? bytes : 1)) abort();
    for (size_t i = 0; i < bytes; i++) found[i] = (unsigned char)((seed = 1664525 * seed + 1013904223) >> 26);
    return found;
}

/* Values of a picture: of floats small ones and some NaN and infinite, of integers any. */
static void *picture(int kind, size_t values) {
    const size_t width[] = {1, 2, 4, 2};
    const uint32_t odd[2][4] = {{0x7fc00000, 0x7f800000, 0xff800000, 0x7fa00001}, {0x7e00, 0x7c00, 0xfc00, 0x7d01}};
    unsigned char *found = room(values * width[kind]);
    for (size_t i = 5; kind > 1 && i < values; i += 61) memcpy(found + i * width[kind], &odd[kind - 2][i % 4], width[kind]);
    for (size_t i = 0; kind < 2 && i < values * width[kind]; i++)
        found[i] = (unsigned char)((seed = 1664525 * seed + 1013904223) >> 24);
    return found;
}

/* The bytes (4, 256) of a table of 256. */
static uint8_t *bytes_of_table(const float *table) {
    uint8_t *found = room(1024);
    for (int i = 0; i < 1024; i++) found[i] = ((const uint8_t *)table)[i % 256 * 4 + i / 256];
    return found;
}

static void search(int level, int threads, int kind, size_t n, void *const *frames) {
    for (int count = 3; count <= FRAMES; count++) {
        const int candidates = 1 + count, later = count - 3;
        float *weights = room(9 * sizeof(float)), *out[RESULTS];
        float *terms = room(sizeof(float) * TERMS * (size_t)count);
        float *rotations = room(sizeof(float) * 2 * (size_t)(candidates * later));
        for (int i = 0; i < 9; i++) weights[i] = (float)(i % 5) - 2;
        for (int i = 0; i < count * TERMS; i++) terms[i] = 0.01f * (float)(1 + i % 11);
        for (int i = 0; i < count; i++) terms[i * TERMS + SAME] = (float)(i % 2);
        for (int i = 0; i < 2 * candidates * later; i++) rotations[i] = 0.1f * (float)(i % 9);
        for (int i = 0; i < RESULTS; i++) out[i] = room(n * sizeof(float));
        const struct procam_search setup = {count, 3,  candidates, count % 3, count % 2, 64.0f,
                                          16.0f, weights, terms, rotations};
        procam_search(level, threads, kind, n, (const void *const *)frames, &setup, out);
        for (int i = 0; i < RESULTS; i++) keep('s', 4, out[i], n), free(out[i]);
        free(weights), free(terms), free(rotations);
    }
}

/* Numbers between -1 and 1; NaN among them. */
static double *some(size_t count) {
    double *found = room(count * sizeof(double));
    for (size_t i = 0; i < count; i++)
        found[i] = rand() % 50 ? (double)(rand() % 2001 - 1000) / 1000 : NAN;
    return found;
}

static void rays(int level, int threads, size_t n) {
    const double lens[] = {100, 100, 0, 0, 0.02, -0.008, 0.001, 0};
    double *pixels = some(2 * n), *table = room(5 * sizeof(double)), *found = room(24 * n);
    for (size_t i = 0; i < 2 * n; i++) pixels[i] *= 400;
    for (int i = 0; i < 5; i++) table[i] = 0.7 * i;
    procam_rays(level, threads, n, pixels, lens, 5, table, 4 / 2.8, found);
    keep('d', 8, found, 3 * n);
    free(pixels), free(table), free(found);
}

static void bundle(int level, int threads, size_t n, int harmonics, int kinds) {
    double placed[DEVICE_NUMBERS] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.1, 0.2, 0.3, 90, 90, 5, 5, 0.01};
    const int used = 1 + harmonics + 6 + (kinds & 4 ? (kinds & 1 ? 10 : 11) : 0) + 6 +
                     (kinds & 2 ? 8 : 9) + 1;
    const size_t columns = (size_t)(used + 3) / 4 * 4, tile = 128, k = (size_t)harmonics;
    double *parts[] = {some(3 * n), some(2 * n), some(n), some(3 * n), some(n * k), some(3 * n * k)};
    double *coefficients = some(k), *found = room((size_t)(used * used) * 8), *residuals = room(16 * n);
    double *sums = room((n + tile - 1) / tile * columns * columns * PARTIAL * 8);
    const struct procam_bundle setup = {
        harmonics,    kinds & 1, kinds >> 1 & 1, kinds >> 2, 5.0,      placed,   placed,
        coefficients,    parts[0],  parts[1],       parts[2],   parts[3], parts[4], parts[5]};
    procam_bundle(level, threads, n, &setup, used, tile, sums, found);
    procam_residuals(level, threads, n, &setup, residuals);
    keep('d', 8, found, (size_t)(used * used)), keep('d', 8, residuals, 2 * n);
    for (int i = 0; i < 6; i++) free(parts[i]);
    free(coefficients), free(found), free(residuals), free(sums);
}

/* Places all round the master and far from it. */
static void warp(int level, int kind, int out_kind, size_t rows, size_t columns, size_t edge) {
    const size_t count = (rows + 31) / 32 * ((columns + 63) / 64) * 128, width[] = {1, 2, 4, 2};
    struct warp_block *blocks = room(count * sizeof *blocks);
    for (size_t k = 0; k < count; k++)
        for (int f = 0; f < FIELDS; f++) {
            blocks[k].base[f] = f > 1 ? 0.1f : k % 7 ? -2.0f : (f ? -1e9f : 1e9f);
            blocks[k].step[f] = f > 1 ? 0.01f : (float)(edge + 4) / 16191; /* most of a room */
        }
    void *master = picture(kind, 3 * edge * edge);
    void *out = room(3 * rows * columns * width[out_kind]);
    float *light = room(256 * sizeof(float)), *thresholds = room(64 * 64 * sizeof(float));
    uint32_t *drives = room(3 * KNOTS * sizeof(uint32_t));
    for (int i = 0; i < 256; i++) light[i] = (float)i / 256;
    for (int i = 0; i < 64 * 64; i++) thresholds[i] = 0.5f;
    for (int i = 0; i < 3 * KNOTS; i++) drives[i] = 100u << 16 | (uint32_t)(i % KNOTS * 100);
    uint8_t *decode_bytes = bytes_of_table(light);
    const struct procam_warp job = {kind,   out_kind, rows,         columns, edge,   edge,       1.0f, master,
                                    blocks, light,    decode_bytes, light + 60, drives, thresholds, out};
    procam_warp(level, 1 + (int)(rows % 2), rows, &job);
    keep("BHf"[out_kind], width[out_kind], out, 3 * rows * columns);
    free(blocks), free(master), free(out), free(light), free(decode_bytes), free(thresholds), free(drives);
}

static float *numbers(size_t count, float value) {
    float *array = room(count * sizeof(float));
    for (size_t i = 0; i < count; i++) array[i] = value + 0.001f * (float)(i % 7);
    return array;
}

/* A picture of `edge` over fields of `nodes`, lit but for a corner; rooms end where they are read to. */
static void frame(int level, int kind, int mode, size_t edge, int nodes, int terms) {
    const size_t width[] = {1, 2, 4, 2}, values = (3 * edge + 191) / 192 * 192, n = (size_t)nodes;
    const size_t strips = (3 * edge + 1535) / 1536, chunks = (n + 64) / 64, spare = 64;
    const size_t fields = 3 * n * n + spare, edges = n / 2 + 2;
    seed = 1; /* how many buffers there were so far depends on the level */
    struct procam_frame setup = {.size = edge, .kind = kind, .nodes = nodes, .terms = terms, .band = 2};
    setup.strength = mode % 2 ? 0.5f : 1.0f, setup.top = 1;
    setup.image = picture(kind, 3 * edge * edge), setup.out = room(3 * edge * edge * width[kind]);
    struct positions *positions[] = {&setup.values, &setup.shared};
    const size_t lanes[] = {16, 8, 4}, vector = lanes[level], vectors = values / vector;
    int32_t *start[2], *left[2], *rows = room((n + 2) * sizeof(int32_t));
    float *across[2], *down = room(edge * sizeof(float));
    for (int k = 0; k < 2; k++) {
        start[k] = room(vectors * sizeof(int32_t)), left[k] = room(values * sizeof(int32_t));
        across[k] = room(values * sizeof(float));
        for (size_t i = 0; i < values; i++) {
            const size_t pixel = i / 3 < edge ? i / 3 : edge - 1;
            const double place = ((double)pixel + 0.5) * nodes / (double)edge - 0.5;
            const int first = (int)floor(place) < 0 ? 0 : (int)floor(place), node = first < nodes - 1 ? first : nodes - 2;
            left[k][i] = k ? node : 3 * node + (int)(i % 3);
            across[k][i] = (float)(place - node), down[pixel] = across[k][i];
            if (i % vector == 0 || left[k][i] < start[k][i / vector]) start[k][i / vector] = left[k][i];
        }
        for (size_t i = 0; i < values; i++) left[k][i] -= start[k][i / vector];
        *positions[k] = (struct positions){start[k], left[k], across[k]};
    }
    for (size_t y = edge, interval = n + 1;; y--) {
        const int first = y ? (int)floor(((double)y - 0.5) * nodes / (double)edge - 0.5) + 1 : -1;
        while ((int)interval > first && interval <= n + 1) rows[interval--] = (int32_t)y;
        if (!y) break;
    }
    const size_t blocks = (n + 1) * ((3 * edge + 63) / 64);
    uint8_t *lit = room(blocks);
    for (size_t i = 0; i < blocks; i++) lit[i] = (uint8_t)(i % (mode == 4 ? 3 : 4));
    float *light = numbers(fields, 0.1f), *lo = numbers(fields, 0), *hi = numbers(fields, 0.5f);
    float *gain = numbers(n * n + spare, 1), *area = numbers(n * n + spare, 0);
    float *weight = numbers(edges * n + spare, 1), *paint = numbers(3 * edges * n + spare, 1);
    float *direction = numbers(3 * edges * n + spare, 0.5f), *pieces = numbers(4 * PIECES, 0.1f);
    float *threshold = numbers(64 * 192, 0.5f), *decode = numbers(256, 0.1f);
    for (int i = 0; i < 256; i++) decode[i] += (float)i / 256;
    for (int i = PIECES; i < 2 * PIECES; i++) pieces[i] = 200; /* 200 times the root of the light, and little more */
    uint8_t *decode_bytes = bytes_of_table(decode);
    setup.light = light, setup.least = lo, setup.most = mode == 4 ? NULL : hi, setup.gain = mode == 2 || mode == 4 ? gain : NULL;
    setup.area = area, setup.weight = weight, setup.edge_spread = paint, setup.direction = direction;
    setup.lit = lit, setup.down = setup.along = down, setup.rows = rows;
    setup.decode = decode, setup.decode_bytes = decode_bytes, setup.encode = pieces, setup.threshold = threshold;
    double *sums = room(strips * chunks * 27 * sizeof(double));
    memset(sums, 0, strips * chunks * 27 * sizeof(double));
    procam_frame(level, 2, mode, strips, chunks, &setup, sums);
    keep('d', 8, sums, strips * chunks * 27);
    if (mode > 4) keep("BHfe"[kind], width[kind], setup.out, 3 * edge * edge);
    double *poly = some(27);
    for (int k = 0; k < 27; k++) poly[k] = 0.01 * k;
    procam_scattered(level, 2, nodes, terms, lo, NULL, hi, poly, mode % 2 ? poly : NULL, light);
    keep('f', 4, light, 3 * n * n);
    for (int k = 0; k < 2; k++) free(start[k]), free(left[k]), free(across[k]);
    void *all[] = {(void *)setup.image, setup.out, rows, down, lit, light, lo, hi, gain, area, weight, paint, direction, pieces,
                   decode, decode_bytes, threshold, sums, poly};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) free(all[k]);
}

int main(int count, char **arguments) {
    const int only = count > 1 ? atoi(arguments[1]) : -1;
    written = only >= 0;
    const size_t sizes[] = {0, 1, 7, 8, 15, 16, 17, 31, 127, 128, 129, 2049, 32768, 32771};
    const size_t width[] = {1, 2, 4};
    for (int level = 0; level < 3; level++) {
        if (written ? level != only : !(procam_levels() >> level & 1)) continue;
        for (int kind = 0; kind < 3; kind++)
            for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
                const int threads = 1 + (int)(i % 2);
                void *frames[FRAMES];
                for (int k = 0; k < FRAMES; k++) frames[k] = room(sizes[i] * width[kind]);
                search(level, threads, kind, sizes[i] < 3000 ? sizes[i] : 2047, frames);
                for (int k = 0; k < FRAMES; k++) free(frames[k]);
            }
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            rays(level, 1 + (int)(i % 2), sizes[i]);
            for (int kinds = 0; kinds < 8 && sizes[i] < 3000; kinds++) {
                bundle(level, 1 + kinds % 2, sizes[i], 0, kinds);
                bundle(level, 1 + kinds % 2, sizes[i], 5 + kinds, kinds);
            }
        }
        bundle(level, 1, 70, MOST_COLUMNS - 34, 4);
        const size_t rows[] = {1, 32, 45, 96}, columns[] = {1, 64, 65, 200}, edges[] = {2, 3, 61};
        for (int kinds = 0; kinds < 12; kinds++)
            for (int i = 0; i < 12; i++)
                warp(level, kinds % 4, kinds / 4, rows[i % 4], columns[(i + i / 4) % 4],
                     edges[i / 4]);
        const size_t pictures[] = {5, 64, 97, 130, 300};
        for (int i = 0; i < 5; i++) {
            for (int kinds = 0; kinds < 28; kinds++)
                frame(level, kinds % 4, kinds / 4, pictures[i], 5 + i * (1 + i) * 3, (int[]){1, 4, 9}[i % 3]);
        }
        if (!written) printf("level %d clean\n", level);
    }
    return 0;
}
