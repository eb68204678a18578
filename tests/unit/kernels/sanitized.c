/* Runs every kernel at every level over odd sizes, in buffers of exactly the size needed, so that
   the address and undefined-behaviour sanitizers see each byte it must not touch. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "kernels.h"

int procam_levels(void);
void procam_fold(int, int, int, size_t, int, const int *, const void *const *, uint16_t *, void *,
                 void *);
void procam_phase(int, int, int, size_t, int, const void *const *, const float *, float *, float *,
                  float *);
void procam_search(int, int, int, size_t, const void *const *, const struct procam_search *,
                   float *const *);
void procam_areas(int, int, size_t, size_t, const double *const *, double *);
void procam_bundle(int, int, size_t, const struct procam_bundle *, int, size_t, double *, double *);
void procam_misses(int, int, size_t, const struct procam_bundle *, double *);
void procam_rays(int, int, size_t, const double *, const double *, int, const double *, double,
                 double *);

enum { FRAMES = 12 };

static void *room(size_t bytes) {
    unsigned char *found = NULL;
    if (posix_memalign((void **)&found, 64, bytes ? bytes : 1)) abort();
    for (size_t i = 0; i < bytes; i++) found[i] = (unsigned char)(rand() & 63);
    return found;
}

static void fold(int level, int threads, int kind, size_t n, size_t width) {
    void *bright = room(n * width), *dark = room(n * width);
    void *least = room(n * width), *most = room(n * width), *code = room(n * 2);
    const void *const pictures[] = {bright, dark, dark, bright, dark, dark};
    const int bits[] = {15, 0, 1};
    procam_fold(level, threads, kind, n, 1, bits, pictures, code, least, most);
    procam_fold(level, threads, kind, n, 1, bits, pictures, code, NULL, most);
    procam_fold(level, threads, kind, n, 2, bits, pictures, code, least, NULL);
    procam_fold(level, threads, kind, n, 3, bits, pictures, code, NULL, NULL);
    free(bright), free(dark), free(least), free(most), free(code);
}

static void phase(int level, int threads, int kind, size_t n, void *const *frames) {
    for (int count = 3; count <= FRAMES; count += 3) {
        float *weights = room(sizeof(float) * 3 * (size_t)count), *out[3];
        for (int i = 0; i < 3 * count; i++) weights[i] = (float)(i % 7) - 3;
        for (int i = 0; i < 3; i++) out[i] = room(n * sizeof(float));
        procam_phase(level, threads, kind, n, count, (const void *const *)frames, weights, out[0],
                     out[1], out[2]);
        procam_phase(level, threads, kind, n, count, (const void *const *)frames, weights, out[0],
                     out[1], NULL);
        for (int i = 0; i < 3; i++) free(out[i]);
        free(weights);
    }
}

static void search(int level, int threads, int kind, size_t n, void *const *frames) {
    for (int count = 3; count <= FRAMES; count++) {
        const int candidates = 1 + count, later = count - 3;
        float *weights = room(9 * sizeof(float)), *out[RESULTS];
        float *terms = room(sizeof(float) * TERMS * (size_t)count);
        float *turns = room(sizeof(float) * 2 * (size_t)(candidates * later));
        for (int i = 0; i < 9; i++) weights[i] = (float)(i % 5) - 2;
        for (int i = 0; i < count * TERMS; i++) terms[i] = 0.01f * (float)(1 + i % 11);
        for (int i = 0; i < count; i++) terms[i * TERMS + SAME] = (float)(i % 2);
        for (int i = 0; i < 2 * candidates * later; i++) turns[i] = 0.1f * (float)(i % 9);
        for (int i = 0; i < RESULTS; i++) out[i] = room(n * sizeof(float));
        const struct procam_search how = {count, 3,  candidates, count % 3, count % 2, 64.0f,
                                          16.0f, weights, terms, turns};
        procam_search(level, threads, kind, n, (const void *const *)frames, &how, out);
        for (int i = 0; i < RESULTS; i++) free(out[i]);
        free(weights), free(terms), free(turns);
    }
}

/* Corners over the whole sphere, so that both the series and the arctangent are taken. */
static void areas(int level, int threads, size_t rows, size_t columns) {
    double **corners = room((rows + 1) * sizeof(double *)), *found = room(rows * columns * 8);
    for (size_t r = 0; r <= rows; r++) {
        corners[r] = room(3 * (columns + 1) * sizeof(double));
        for (size_t i = 0; i < 3 * (columns + 1); i++)
            corners[r][i] = rand() % 9 ? (double)(rand() % 2001 - 1000) / 1000 : NAN;
    }
    procam_areas(level, threads, rows, columns, (const double *const *)corners, found);
    for (size_t r = 0; r <= rows; r++) free(corners[r]);
    free(corners), free(found);
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
    free(pixels), free(table), free(found);
}

static void bundle(int level, int threads, size_t n, int waves, int kinds) {
    double placed[PLACED] = {1, 0, 0, 0, 1, 0, 0, 0, 1, 0.1, 0.2, 0.3, 90, 90, 5, 5, 0.01};
    const int used = 1 + waves + 6 + (kinds & 4 ? (kinds & 1 ? 10 : 11) : 0) + 6 +
                     (kinds & 2 ? 8 : 9) + 1;
    const size_t columns = (size_t)(used + 3) / 4 * 4, tile = 128, k = (size_t)waves;
    double *parts[] = {some(3 * n), some(2 * n), some(n), some(3 * n), some(n * k), some(3 * n * k)};
    double *bumps = some(k), *found = room((size_t)(used * used) * 8), *misses = room(16 * n);
    double *sums = room((n + tile - 1) / tile * columns * columns * PARTIAL * 8);
    const struct procam_bundle how = {
        waves,    kinds & 1, kinds >> 1 & 1, kinds >> 2, 5.0,      placed,   placed,
        bumps,    parts[0],  parts[1],       parts[2],   parts[3], parts[4], parts[5]};
    procam_bundle(level, threads, n, &how, used, tile, sums, found);
    procam_misses(level, threads, n, &how, misses);
    for (int i = 0; i < 6; i++) free(parts[i]);
    free(bumps), free(found), free(misses), free(sums);
}

int main(void) {
    const size_t sizes[] = {0, 1, 7, 8, 15, 16, 17, 31, 127, 128, 129, 2049, 32768, 32771};
    const size_t width[] = {1, 2, 4};
    for (int level = 0; level < 3; level++) {
        if (!(procam_levels() >> level & 1)) continue;
        for (int kind = 0; kind < 3; kind++)
            for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
                const int threads = 1 + (int)(i % 2);
                void *frames[FRAMES];
                for (int k = 0; k < FRAMES; k++) frames[k] = room(sizes[i] * width[kind]);
                fold(level, threads, kind, sizes[i], width[kind]);
                phase(level, threads, kind, sizes[i], frames);
                search(level, threads, kind, sizes[i] < 3000 ? sizes[i] : 2047, frames);
                for (int k = 0; k < FRAMES; k++) free(frames[k]);
            }
        for (size_t rows = 0; rows < 40; rows += 13)
            for (size_t columns = 0; columns < 600; columns += 1 + columns / 2)
                areas(level, 1 + (int)(columns % 2), rows, columns);
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            rays(level, 1 + (int)(i % 2), sizes[i]);
            for (int kinds = 0; kinds < 8 && sizes[i] < 3000; kinds++) {
                bundle(level, 1 + kinds % 2, sizes[i], 0, kinds);
                bundle(level, 1 + kinds % 2, sizes[i], 5 + kinds, kinds);
            }
        }
        bundle(level, 1, 70, MOST_COLUMNS - 34, 4);
        printf("level %d clean\n", level);
    }
    return 0;
}
