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

static inline void one_wind_of(am_sim *sim, const double *u, double wind[3]) {
    double *work = work_of(sim, G_WEATHER, 0);
    if (air_moves(sim)) weather_wind(sim, u, wind);
    else plain_wind(par_of(sim, G_WEATHER, 0), u, &sim->now, work + W_WIND, work + W_GUST, wind);
}

#else

static void HOOK(wind_of)(flight_t *f, const real *u, real wind[3]);

#endif

#endif
