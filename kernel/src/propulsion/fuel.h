/* Fuel on board and the mass properties of the moment. */
#ifndef AEROMATCH_FUEL_H
#define AEROMATCH_FUEL_H

#include "simulation.h"

/* Check the parameters and keep the moments of the fuel at the start. */
int fuel_check(am_sim *sim);

void fuel_start(am_sim *sim);

/* Mass [kg], c.g. [m], inertia tensor [kg m2] and its inverse in now, with the fuel of state x. */
void mass_now(am_sim *sim, const double *x);

bool fuel_left(const am_sim *sim, const double *x);

/* Set the rate of the fuel on board from the flow to the engines [kg s-1]. */
void burn_fuel(const am_sim *sim, const double *x, double flow, double *dx);

void fuel_outputs(am_sim *sim, double *y);

#endif
