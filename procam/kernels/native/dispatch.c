/* The functions that Python calls.

   Each fills a job, splits its pixels (rows, observations) into tiles and runs the kernel of the level
   asked for on them, on several threads. Results do not depend on the number of threads. */
#include "kernels.h"

#ifdef _OPENMP
#include <omp.h>
#endif
#ifndef _WIN32
#include <pthread.h>
#endif

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { SEARCH_TILE = 1 << 11 }; /* pixels; multiples of a vector */
enum { NODES_TILE = 16 };                              /* rows of nodes */
enum { RAYS_TILE = 1 << 12 };                          /* rays, observations */
enum { WARP_TILE = 32 };                                /* rows: a band of warp.h */

typedef void task(const struct level *level, const void *job, size_t first, size_t count);

/* OpenMP's threads do not survive a fork; the child runs on one thread. */
static int forked;
static void mark_forked(void) { forked = 1; }

static const struct level *level_at(int number) {
#if HAVE_X86
    if (number == 0) return &procam_avx512;
    if (number == 1) return &procam_avx2;
#endif
    return &procam_base;
}

static int worker_count(int threads, size_t tiles) {
    int workers = 1;
#ifdef _OPENMP
    workers = threads > 0 ? threads : omp_get_max_threads();
#endif
    if (forked) return 1;
    return (size_t)workers < tiles ? workers : (int)(tiles ? tiles : 1);
}

static void run_tiles(task *run, int level, int threads, const void *job, size_t pixels, size_t tile) {
    const struct level *set = level_at(level);
    const size_t tiles = (pixels + tile - 1) / tile;
    const int workers = worker_count(threads, tiles);
    if (workers == 1) {
        for (size_t t = 0; t < tiles; t++)
            run(set, job, t * tile, pixels - t * tile < tile ? pixels - t * tile : tile);
        return;
    }
#pragma omp parallel for schedule(dynamic) num_threads(workers)
    for (size_t t = 0; t < tiles; t++)
        run(set, job, t * tile, pixels - t * tile < tile ? pixels - t * tile : tile);
}

static void run_search(const struct level *level, const void *job, size_t first, size_t count) {
    level->search(job, first, count);
}

static void run_bundle(const struct level *level, const void *job, size_t first, size_t count) {
    level->bundle(job, first, count);
}

static void run_residuals(const struct level *level, const void *job, size_t first, size_t count) {
    level->residuals(job, first, count);
}

static void run_rays(const struct level *level, const void *job, size_t first, size_t count) {
    level->rays(job, first, count);
}

static void run_frame(const struct level *level, const void *job, size_t first, size_t count) {
    level->frame(job, first, count);
}

static void run_scattered(const struct level *level, const void *job, size_t first, size_t count) {
    level->scattered(job, first, count);
}

static void run_warp(const struct level *level, const void *job, size_t first, size_t count) {
    level->warp(job, first, count);
}

EXPORT int procam_interface(void) {
#ifndef _WIN32
    static int registered;
    if (!registered) registered = !pthread_atfork(NULL, NULL, mark_forked);
#endif
    return PROCAM_INTERFACE;
}

/* One bit per level that this processor supports: 1 AVX-512, 2 AVX2, 4 base. */
EXPORT int procam_levels(void) {
    int levels = 4;
#if HAVE_X86
    __builtin_cpu_init();
    const int avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                     __builtin_cpu_supports("f16c");
    if (avx2) levels |= 2;
    if (avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512vbmi"))
        levels |= 1;
#endif
    return levels;
}

EXPORT void procam_search(int level, int threads, int kind, size_t pixels,
                          const void *const *frames, const struct procam_search *setup,
                          float *const *results) {
    const struct search job = {kind, frames, setup, results};
    run_tiles(run_search, level, threads, &job, pixels, SEARCH_TILE);
}

/* Products (used, used) of the rows of `count` observations; `sums` (tiles, columns, columns, PARTIAL)
   holds those of each tile. */
EXPORT void procam_bundle(int level, int threads, size_t count, const struct procam_bundle *setup,
                          int used, size_t tile, double *sums, double *products) {
    const int columns = (used + 3) / 4 * 4;
    const struct bundle job = {setup, used, columns, tile, sums};
    const size_t size = (size_t)(columns * columns) * PARTIAL;
    run_tiles(run_bundle, level, threads, &job, count, tile);
    for (int r = 0; r < used; r++)
        for (int c = 0; c <= r; c++) {
            double sum = 0.0;
            for (size_t t = 0; t * tile < count; t++)
                for (int i = 0; i < PARTIAL; i++)
                    sum += sums[t * size + (size_t)(r * columns + c) * PARTIAL + (size_t)i];
            products[r * used + c] = products[c * used + r] = sum;
        }
}

EXPORT void procam_residuals(int level, int threads, size_t count, const struct procam_bundle *setup,
                          double *residuals) {
    const struct bundle job = {setup, 0, 0, 0, residuals};
    run_tiles(run_residuals, level, threads, &job, count, RAYS_TILE);
}

EXPORT void procam_rays(int level, int threads, size_t count, const double *pixels,
                        const double *lens, int knots, const double *table, double per_radius,
                        double *rays) {
    const struct rays job = {pixels, lens, table, knots, per_radius, rays};
    run_tiles(run_rays, level, threads, &job, count, RAYS_TILE);
}

/* `sums` (strips of the picture, chunks of intervals, 3, FRAME_TERMS), zeros at first; one
   set per task. */
EXPORT void procam_frame(int level, int threads, int mode, size_t strips, size_t chunks,
                         const struct procam_frame *setup, double *sums) {
    const struct frame job = {setup, mode, strips, sums};
    run_tiles(run_frame, level, threads, &job, strips * chunks, 1);
}

EXPORT void procam_scattered(int level, int threads, int nodes, int terms, const float *spread,
                          const float *ambient, const float *direction, const double *coefficients,
                          const double *offset, float *light) {
    const struct scattered job = {nodes, terms, spread, ambient, direction, coefficients, offset, light};
    run_tiles(run_scattered, level, threads, &job, (size_t)nodes, NODES_TILE);
}

EXPORT void procam_warp(int level, int threads, size_t rows, const struct procam_warp *job) {
    run_tiles(run_warp, level, threads, job, rows, WARP_TILE);
}
