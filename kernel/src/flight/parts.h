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

static real deflection(const flight_t *f, const real *u, int control);
static void wind_of(flight_t *f, const real *u, real wind[3]);
static void mass_of(flight_t *f, const real *x, const real *u);
static void engine_loads(flight_t *f, const real *x, const real *u, real F[3], real M[3],
                         real H[3], real *dx);
static void gear_loads(flight_t *f, const real *x, const real *u, real F[3], real M[3], real *dx);

#endif

#endif
