/* Fuel in the tanks and the mass properties of the moment. */
#ifndef AEROMATCH_FUEL_H
#define AEROMATCH_FUEL_H

#include "flight.h"

/* Check the parameters and keep the moments of the fuel at the start. */
int fuel_check(am_sim *sim);

void fuel_start(am_sim *sim);

/* Mass [kg], c.g. [m], inertia tensor [kg m2] and its inverse in now, with the fuel of state x. */
void mass_now(flight_t *sim, const real *x);

/* Whether there is fuel for an engine: on board, or in a tank that feeds it. */
mask_t fuel_left(const flight_t *sim, uint32_t engine, const real *x, const real *u);

/* Set the rate of the fuel on board from the flow to all engines [kg s-1]. */
void burn_fuel(const flight_t *sim, const real *x, real flow, real *dx);

void fuel_outputs(const flight_t *sim, real *y);

#endif
