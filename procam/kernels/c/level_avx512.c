/* The kernels for AVX-512 (F, BW, DQ, VL). */
#include "kernels.h"

#if HAVE_X86
#include <float.h>
#include <immintrin.h>
#include <math.h>
#include <string.h>
#define LEVEL 512
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl,avx2,fma"))), apply_to = function)
#else
#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,prefer-vector-width=512")
#endif
#include "level.h"
const struct level procam_avx512 = {fold, phase, search, areas, bundle, misses, rays};
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
