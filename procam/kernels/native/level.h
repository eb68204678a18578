/* All kernels for one instruction set: the includer has set LEVEL and switched the set on. */
#include "vector.h"
#include "integers.h"

#include "../areas/areas.h"
#include "../frame/bounce.h"
#include "../bundle/bundle.h"
#include "../frame/values.h"
#include "../frame/cell.h"
#include "../frame/frame.h"
#include "../bundle/rays.h"
#include "../search/search.h"
#include "../warp/warp.h"
