/* One piston engine: manifold, power, fuel, flame; engine.c calls it. */
#ifndef AEROMATCH_PISTON_H
#define AEROMATCH_PISTON_H

#include "flight.h"

int piston_check(am_sim *sim, uint32_t engine);
/* what the tables depend on; those of the propeller are set */
void piston_variables(flight_t *sim, uint32_t engine, const real *x, const real *u);
/* Torque at the crankshaft [N m]; sets the fuel flow [kg s-1] and the rates of the states. */
real piston_torque(flight_t *sim, uint32_t engine, const real *x, const real *u, real *fuel_flow,
                   real *dx);
void piston_outputs(const flight_t *sim, uint32_t engine, real *y);

/* flame on where there is fuel, manifold at the pressure of the air */
void piston_start(am_sim *sim, uint32_t engine);
/* manifold pressure to its steady value at the present tables */
void piston_settle(am_sim *sim, uint32_t engine);
/* puts the flame out where the steady speed does not sustain it; true when that changed it */
bool piston_stalls(am_sim *sim, uint32_t engine);

#endif
