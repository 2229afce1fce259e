/* Eight simulations side by side, for x86-64 with AVX-512; without fused multiply-add, which would
 * round once where others round twice. */
#if defined(__x86_64__) && !defined(AM_PLAIN)

#define LANES 8

#include "access.h"
#include "elementary.h"
#include "error.h"
#include "lanes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define AVX512 __attribute__((target("avx512f,avx512dq,avx512vl,avx512bw")))
#pragma clang attribute push(AVX512, apply_to = function)
#include "laned_units.h"
#pragma clang attribute pop

#endif
