/* What the levels (one per instruction set) offer and the dispatcher calls. */
#ifndef PROCAM_KERNELS_H
#define PROCAM_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#define PROCAM_INTERFACE 13 /* raised with every change of a signature; loader.py holds the same */
#define MOST_SEARCH 32     /* of a search */
#define RESULTS 6          /* planes of a search */

enum kind { U8, U16, F32, F16 }; /* element type of the pictures */

enum term { FREQUENCY, SHIFT, FIRST, SECOND, SLOPE, SECOND_SLOPE, SAME, COSINE, SINE, TERMS };

struct procam_search {
    int frames, base, candidates, steps, harmonics;
    float period, limit;  /* of the base [px]; the longest move of x in a step [px] */
    const float *weights; /* (3, base) */
    const float *terms;   /* (frames, TERMS): see enum term and search/api.py */
    const float *turns;   /* (candidates, frames - base, 2): cosine, sine */
};

struct search {
    int kind;
    const void *const *frames;
    const struct procam_search *how;
    float *const *results; /* position, variance, amplitude, offset, residual, margin */
};

struct areas {
    size_t columns;               /* of cells */
    const double *const *corners; /* rows of columns + 1 unit directions (x, y, z), one row more than of cells */
    double *areas;                /* (rows, columns) */
};

enum { PLACED = 23 };                     /* numbers of a device: turn (3, 3), shift, lens (9), pupil (2) */
enum { MOST_COLUMNS = 128, PARTIAL = 8 }; /* of a bundle's rows; sums that each product is kept in */

struct procam_bundle { /* what a camera sees of a projector on a round screen */
    int waves, fisheye_camera, fisheye_projector, lens_free;
    double radius;
    const double *camera, *projector;       /* (PLACED) */
    const double *bumps;                    /* (waves) */
    const double *rays, *seen, *weight;     /* (count, 3), (count, 2), (count) */
    const double *start, *values, *slopes;  /* relief: (count, 3), (count, waves), (count, waves, 3) */
};

struct bundle {
    const struct procam_bundle *how;
    int used, columns; /* of the rows; the same made up to a multiple of 4 */
    size_t tile;       /* observations that share sums */
    double *sums;      /* (tiles, columns, columns, PARTIAL); of misses: (count, 2) */
};

struct rays {
    const double *pixels; /* (count, 2) */
    const double *lens;   /* focal x, y, centre x, y, k1..k4 */
    const double *table;  /* (knots) angles at even steps of the radius from 0 on */
    int knots;
    double per_radius; /* knots - 1 over the last radius */
    double *rays;      /* (count, 3) */
};

enum { FRAME_TERMS = 9 }; /* of the polynomial of bounced light */
enum mode { SUM_LIGHT, SUM_CONTENT, SUM_EXCESS, COUNT_LEAST, COUNT_MOST, APPLY };
/* Of a block in an interval: not lit; summed pixel by pixel; all of its band is lit; the same, and upper
   limits are below `top` somewhere. */
enum lit { NOWHERE, IN_PART, EVERYWHERE, HELD };

struct places { /* where numbers of a row lie among the nodes: see Grid.places */
    const int32_t *start, *pair; /* of 16; of each: nodes left and right (<< 8) from there */
    const float *across;         /* of each: share of the right one */
};

struct procam_frame { /* a picture (size, size, 3) and the model of its dome */
    size_t size;
    int kind, nodes, terms, band; /* intervals of a band; divides FRAME_CHUNK */
    int brief; /* light may be summed as `brief` in cell.h does */
    float strength, top;
    const void *image;
    void *out;
    const float *light, *least, *most;        /* (nodes, nodes, 3); `most` may be NULL */
    const float *gain, *area;                 /* (nodes, nodes); gain may be NULL */
    const float *weight, *paint, *direction;  /* at edges of bands (edges, nodes), (edges, 3, nodes) twice */
    const uint8_t *lit;                       /* (nodes + 1, blocks) */
    struct places values, shared, pixels; /* of values: of fields of three colours, and of one; of pixels */
    const float *down;          /* of rows: share of the second node */
    const int32_t *rows;        /* (nodes + 2): first row of each interval */
    const float *decode, *encode, *threshold; /* (256), (3, SEGMENTS), (TILE_ROWS, TILE_WIDTH) */
    const uint8_t *decode_bytes;              /* (4, 256): bytes of decode */
};

struct frame {
    const struct procam_frame *how;
    int mode;
    size_t strips;
    double *sums; /* (tasks, 3, FRAME_TERMS) */
};

struct bounce {
    int nodes, terms;
    const float *spread, *ambient, *direction; /* (nodes, nodes, 3) twice, (3, nodes, nodes) */
    const double *numbers, *offset;            /* (3, FRAME_TERMS); offset may be NULL */
    float *light;
};

enum { FIELDS = 8, BLOCK = 16 };  /* of a warp's blocks: numbers of a pixel, pixels */
enum { KNOTS = 513 };             /* of a table of drives */

struct warp_block {               /* each number is base + step * number */
    float base[FIELDS], step[FIELDS];
    uint16_t number[FIELDS][BLOCK]; /* place x, y in the master [px], black (3), share (3) */
};

struct procam_warp {
    int kind, out_kind;
    size_t rows, columns, master_rows, master_columns; /* of the frame, of the master */
    float unit;                      /* light of a master's 1 */
    const void *master;              /* (rows, columns, 3) */
    const struct warp_block *blocks; /* (bands of 32 rows, tiles of 64 columns, 2 strips, 32, 2) */
    const float *decode, *curve;     /* of 8-bit masters: (256) light; (3, 32) parabolas of it */
    const float *unmix;              /* (3, 3) */
    const uint32_t *drives;          /* (3, KNOTS) drive, and its rise to the next << 16 */
    const float *thresholds;         /* (64, 64) */
    void *out;
};

/* Each works on `count` pixels (rays, observations) from pixel `first` on; areas and warp on rows,
   frames on strips of intervals, bounces on rows. */
struct level {
    void (*search)(const struct search *job, size_t first, size_t count);
    void (*areas)(const struct areas *job, size_t first, size_t count);
    void (*bundle)(const struct bundle *job, size_t first, size_t count);
    void (*misses)(const struct bundle *job, size_t first, size_t count);
    void (*rays)(const struct rays *job, size_t first, size_t count);
    void (*frame)(const struct frame *job, size_t first, size_t count);
    void (*bounce)(const struct bounce *job, size_t first, size_t count);
    void (*warp)(const struct procam_warp *job, size_t first, size_t count);
};

extern const struct level procam_avx512, procam_avx2, procam_scalar;

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#define HAVE_X86 1
#else
#define HAVE_X86 0
#endif

#endif
