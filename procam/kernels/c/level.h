/* All kernels for one instruction set: the includer has set LEVEL and switched the set on. */
#include "vector.h"

#include "areas.h"
#include "bounce.h"
#include "bundle.h"
#include "fold.h"
#include "frame_values.h"
#include "even.h"
#include "frame.h"
#include "phase.h"
#include "rays.h"
#include "search.h"
#include "warp.h"
