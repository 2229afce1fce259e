/* Separation point of each wing half: 1 attached, 0 separated up to the leading edge. */
#ifndef AEROMATCH_SEPARATION_H
#define AEROMATCH_SEPARATION_H

#include "flight.h"

/* The rates of the separation points need alpha-dot in every slope. */
static inline bool separates(const flight_t *sim) { return items(sim->model, G_SEPARATION) > 0; }

/* Variables of the tables from the state, then the tables of STAGE_SEPARATION. */
void separation_variables(flight_t *sim, const real *x);

/* Rates of both separation points, once the accelerations of the aircraft are known. */
void separation_rates(flight_t *sim, const real *x, real *dx);

/* Steady separation point of a wing half, side -1 left or 1 right, as the last derivative found the
 * flow; moving: delayed by the rate of alpha. */
real steady_separation(const flight_t *sim, double side, bool moving);

void separation_outputs(const flight_t *sim, real *y);

#if ORIGINAL

int separation_check(am_sim *sim);

#endif

#endif
