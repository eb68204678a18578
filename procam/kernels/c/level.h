/* All kernels for one instruction set: the includer has set LEVEL and switched the set on. */
#include "vector.h"
#include "whole.h"

#include "areas.h"
#include "bounce.h"
#include "bundle.h"
#include "frame_values.h"
#include "frame_cell.h"
#include "frame.h"
#include "rays.h"
#include "search.h"
#include "warp.h"
