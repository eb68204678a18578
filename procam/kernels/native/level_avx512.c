/* The kernels for AVX-512 (F, BW, DQ, VL, VBMI). */
#include "kernels.h"

#if HAVE_X86
#include <float.h>
#include <immintrin.h>
#include <math.h>
#include <string.h>
#define LANES 16
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx2,fma,f16c"))), apply_to = function)
#else
#pragma GCC target("avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi,avx2,fma,f16c,prefer-vector-width=512")
#endif
#include "level.h"
const struct level procam_avx512 = {search, bundle, residuals, rays, frame, scattered, warp};
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
