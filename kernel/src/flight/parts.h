/* What the equations of motion ask of the submodels: one simulation asks them itself, the lanes by
 * laned_parts.h. */
#ifndef AEROMATCH_PARTS_H
#define AEROMATCH_PARTS_H

#include "flight.h"

#if LANES == 1

#include "control_drive.h"
#include "engine.h"
#include "fuel.h"
#include "gear.h"
#include "weather.h"

#define deflection applied
#define wind_of weather_wind
#define mass_of(sim, x, u) mass_now(sim, x)
#define engine_loads engine_forces
#define gear_loads gear_forces

#else

#include "laned_parts.h"

#endif

#endif
