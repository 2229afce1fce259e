/* Four simulations side by side, for x86-64 with AVX2; without fused multiply-add, which would
 * round once where others round twice. */
#if defined(__x86_64__) && !defined(AM_PLAIN)

#define LANES 4

#include "access.h"
#include "elementary.h"
#include "error.h"
#include "lanes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)
#include "laned_units.h"
#pragma clang attribute pop

#endif
