/* The kernels for any processor; with NEON on ARM. */
#include "kernels.h"

#if defined(__ARM_NEON) && defined(__aarch64__)
#include <arm_neon.h>
#endif
#define LANES 4
#include "level.h"
const struct level procam_base = {search, bundle, residuals, rays, frame, scattered, warp};
