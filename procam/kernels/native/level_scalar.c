/* The kernels in plain C, for any processor. */
#include "kernels.h"

#define LEVEL 1
#include "level.h"
const struct level procam_scalar = {search, areas, bundle, residuals, rays, frame, scattered, warp};
