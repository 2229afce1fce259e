/* What the equations of motion ask of the submodels: one simulation asks them itself, the lanes by
 * laned_parts.h. */
#ifndef AEROMATCH_PARTS_H
#define AEROMATCH_PARTS_H

#include "flight.h"

#include "control_drive.h"
#include "engine.h"
#include "fuel.h"
#include "gear.h"

#if LANES == 1

#include "weather.h"

#define wind_of weather_wind

#else

static void wind_of(flight_t *f, const real *u, real wind[3]);

#endif

#endif
