/* What the levels (one per instruction set) offer and the dispatcher calls. */
#ifndef PROCAM_KERNELS_H
#define PROCAM_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#define PROCAM_INTERFACE 2 /* raised with every change of a signature; loader.py holds the same */
#define MOST_FRAMES 64     /* of a phase */
#define MOST_SEARCH 32     /* of a search */
#define RESULTS 6          /* planes of a search */

enum kind { U8, U16, F32 }; /* element type of the pictures */

struct fold {
    int kind, pairs;
    const int *bits;               /* of each pair */
    const void *const *pictures;   /* pattern, inverse of each pair */
    uint16_t *code;
    void *least, *most; /* either may be NULL */
};

struct phase {
    int kind, count;
    const void *const *frames;
    const float *weights; /* (3, count): offset, cosine, sine */
    float *phase, *amplitude, *offset; /* offset may be NULL */
};

enum term { FREQUENCY, SHIFT, FIRST, SECOND, SLOPE, SECOND_SLOPE, SAME, COSINE, SINE, TERMS };

struct procam_search {
    int frames, base, candidates, steps, harmonics;
    float period, limit;  /* of the base [px]; the longest move of x in a step [px] */
    const float *weights; /* (3, base) */
    const float *terms;   /* (frames, TERMS): see enum term and search.py */
    const float *turns;   /* (candidates, frames - base, 2): cosine, sine */
};

struct search {
    int kind;
    const void *const *frames;
    const struct procam_search *how;
    float *const *results; /* position, variance, amplitude, offset, residual, margin */
};

/* Each works on `count` pixels from pixel `first` on. */
struct level {
    void (*fold)(const struct fold *job, size_t first, size_t count);
    void (*phase)(const struct phase *job, size_t first, size_t count);
    void (*search)(const struct search *job, size_t first, size_t count);
};

extern const struct level procam_avx512, procam_avx2, procam_scalar;

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#define HAVE_X86 1
#else
#define HAVE_X86 0
#endif

#endif
