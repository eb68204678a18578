/* The jobs of the kernels, and the table of functions that each level (instruction set) provides.

   The structs `procam_*` are filled by Python (ctypes) and have the same fields there. */
#ifndef PROCAM_KERNELS_H
#define PROCAM_KERNELS_H

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the kernels need a little-endian processor; NumPy runs without them"
#endif

#include <stddef.h>
#include <stdint.h>

#define PROCAM_INTERFACE 17 /* increase with every change of a signature or struct, here and in loader.py */
#define MOST_SEARCH 32     /* frames of a search */
#define RESULTS 6          /* planes of a search */
enum { PIECES = 16 }; /* of a curve: see vector.h */

enum kind { U8, U16, F32, F16 }; /* element type of the pictures */

enum term { FREQUENCY, SHIFT, FIRST, SECOND, SLOPE, SECOND_SLOPE, SAME, COSINE, SINE, TERMS };

struct procam_search {
    int frames, base, candidates, steps, harmonics;
    float period, limit;  /* of the base [px]; the longest move of x in a step [px] */
    const float *weights; /* (3, base) */
    const float *terms;   /* (frames, TERMS): see enum term and search/api.py */
    const float *rotations; /* (candidates, frames - base, 2): cosine, sine */
};

struct search {
    int kind;
    const void *const *frames;
    const struct procam_search *setup;
    float *const *results; /* position, variance, amplitude, offset, residual, margin */
};

enum { DEVICE_NUMBERS = 23 };                     /* rotation (3, 3), translation, lens (9), pupil (2) */
enum { MOST_COLUMNS = 128, PARTIAL = 8 }; /* parameters of a bundle at most; partial sums of each product */

struct procam_bundle { /* the observations of one projector by one camera on a round screen */
    int harmonics, fisheye_camera, fisheye_projector, lens_free;
    double radius;
    const double *camera, *projector;       /* (DEVICE_NUMBERS) */
    const double *coefficients;                    /* (harmonics) */
    const double *rays, *observed, *weight;     /* (count, 3), (count, 2), (count) */
    const double *start, *values, *slopes;  /* of the shape: (count, 3), (count, harmonics), (count, harmonics, 3) */
};

struct bundle {
    const struct procam_bundle *setup;
    int used, columns; /* columns in use; the same rounded up to a multiple of 4 */
    size_t tile;       /* observations that share sums */
    double *sums;      /* (tiles, columns, columns, PARTIAL); of residuals: (count, 2) */
};

struct rays {
    const double *pixels; /* (count, 2) */
    const double *lens;   /* focal x, y, centre x, y, k1..k4 */
    const double *table;  /* (knots) angles at equal steps of the radius from 0 on */
    int knots;
    double per_radius; /* knots - 1 over the last radius */
    double *rays;      /* (count, 3) */
};

enum { FRAME_TERMS = 9 }; /* terms of the polynomial of scattered light */
enum mode { SUM_LIGHT, SUM_CONTENT, SUM_EXCESS, COUNT_LEAST, COUNT_MOST, APPLY, MIX };
/* Of a block in an interval: unlit; partly lit, summed pixel by pixel; lit all over its band; the same
   with upper limits below `top` somewhere. */
enum lit { NOWHERE, IN_PART, EVERYWHERE, LIMITED };

struct positions { /* along a row, among the nodes: see Grid.positions */
    const int32_t *start, *left; /* first node of a vector; of each of its elements: left node, from there */
    const float *across;         /* of each: weight of the right node */
};

struct procam_frame { /* a picture (size, size, 3) and the model of the dome, see frame/model.py */
    size_t size;
    int kind, nodes, terms, band; /* intervals of a band; divides FRAME_CHUNK */
    float strength, top;
    float encode_shift; /* see vector.h: vcurve */
    const void *image;
    void *out;
    const float *light, *least, *most;        /* (nodes, nodes, 3); `most` may be NULL */
    const float *gain, *area;                 /* (nodes, nodes); gain may be NULL */
    const float *weight, *edge_spread, *direction; /* at edges of bands (edges, nodes), (edges, nodes, 3),
                                                      (edges, 3, nodes) */
    const uint8_t *lit;                       /* (nodes + 1, blocks) */
    struct positions values, shared; /* of values, in fields of three colours and of one */
    const float *down, *along;  /* of rows: weight of the lower node row; position in the band */
    const int32_t *rows;        /* (nodes + 2): first row of each interval */
    const float *decode, *encode, *threshold; /* (256); pieces, see vector.h; (TILE_ROWS, TILE_WIDTH) */
    const uint8_t *decode_bytes;  /* (4, 256) of `decode` */
};

struct frame {
    const struct procam_frame *setup;
    int mode;
    size_t strips;
    double *sums; /* (tasks, 3, FRAME_TERMS) */
};

struct scattered {
    int nodes, terms;
    const float *spread, *ambient, *direction; /* (nodes, nodes, 3) twice, (3, nodes, nodes) */
    const double *coefficients, *offset;            /* (3, FRAME_TERMS); offset may be NULL */
    float *light;
};

enum { FIELDS = 8, BLOCK = 16 };  /* of a block of the warp: fields per pixel, pixels */
enum { KNOTS = 513 };             /* knots of a table of drives */

struct warp_block {               /* each number is base + step * number */
    float base[FIELDS], step[FIELDS];
    uint16_t number[FIELDS][BLOCK]; /* position x, y in the master [px], black (3), share (3) */
};

struct procam_warp {
    int kind, out_kind;
    size_t rows, columns, master_rows, master_columns; /* of the frame, of the master */
    float unit;                      /* light of the value 1 in the master */
    const void *master;              /* (rows, columns, 3) */
    const struct warp_block *blocks; /* (bands of 32 rows, tiles of 64 columns, 2 strips, 32, 2) */
    const float *decode;             /* of 8-bit masters (256) */
    const uint8_t *decode_bytes;     /* (4, 256) of `decode` */
    const float *unmix;              /* (3, 3) */
    const uint32_t *drives;          /* (3, KNOTS) drive, and its rise to the next << 16 */
    const float *thresholds;         /* (64, 64) */
    void *out;
};

/* Each handles `count` pixels (rays, observations) from `first` on; scattered and warp rows,
   frame tasks. */
struct level {
    void (*search)(const struct search *job, size_t first, size_t count);
    void (*bundle)(const struct bundle *job, size_t first, size_t count);
    void (*residuals)(const struct bundle *job, size_t first, size_t count);
    void (*rays)(const struct rays *job, size_t first, size_t count);
    void (*frame)(const struct frame *job, size_t first, size_t count);
    void (*scattered)(const struct scattered *job, size_t first, size_t count);
    void (*warp)(const struct procam_warp *job, size_t first, size_t count);
};

extern const struct level procam_avx512, procam_avx2, procam_base;

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#define HAVE_X86 1
#else
#define HAVE_X86 0
#endif

#endif
