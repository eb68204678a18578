/* The kernels for AVX2, FMA and F16C. */
#include "kernels.h"

#if HAVE_X86
#include <float.h>
#include <immintrin.h>
#include <math.h>
#include <string.h>
#define LANES 8
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2,fma,f16c"))), apply_to = function)
#else
#pragma GCC target("avx2,fma,f16c")
#endif
#include "level.h"
const struct level procam_avx2 = {search, bundle, residuals, rays, frame, scattered, warp};
#ifdef __clang__
#pragma clang attribute pop
#endif
#endif
