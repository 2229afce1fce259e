/* Derivative and step of one simulation once more, for x86-64 with AVX2, whose instructions have
 * three operands: fewer of them.  Without fused multiply-add, which would round once where others
 * round twice. */
#if defined(__x86_64__) && !defined(AM_PLAIN)

#define AGAIN avx2

#include "control_step.h"
#include "delay.h"
#include "elementary.h"
#include "error.h"
#include "look_up.h"
#include "weather.h"

#include <math.h>
#include <string.h>

#pragma clang attribute push(__attribute__((target("avx2"))), apply_to = function)

#include "locate.h"

#define look_up look_up_stage

#include "aero.c"
#include "air_data.c"
#include "control_drive.c"
#include "control_loads.c"
#include "earth.c"
#include "engine.c"
#include "feed.c"
#include "fuel.c"
#include "gear.c"
#include "motor.c"
#include "one_step.c"
#include "piston.c"
#include "propeller.c"
#include "shaft.c"
#include "separation.c"
#include "sixdof.c"
#include "spool.c"
#include "steering.c"
#include "terms.c"
#include "tyre.c"

#pragma clang attribute pop

#endif
