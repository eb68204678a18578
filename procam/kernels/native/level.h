/* All kernels for one instruction set. The including file defines LANES and enables the set; every
   kernel is compiled once per level from the same source. */
#include "vector.h"

#include "../frame/scattered.h"
#include "../bundle/bundle.h"
#include "../frame/values.h"
#include "../frame/cell.h"
#include "../frame/frame.h"
#include "../bundle/rays.h"
#include "../search/search.h"
#include "../warp/warp.h"
