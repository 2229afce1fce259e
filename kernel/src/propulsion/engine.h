/* All engines: their thrust, rotors and fuel. */
#ifndef AEROMATCH_ENGINE_H
#define AEROMATCH_ENGINE_H

#include "flight.h"

/* Check the parameters under the present drive (mode.engine). */
int engine_check(am_sim *sim);

/* Whether the memory, which may come from outside, is one that a simulation can have. */
bool engine_memory_valid(const am_sim *sim);

/* Steady state under the present inputs; lever delays from t to t + h [s]. */
void engine_start(am_sim *sim, double t);
void engine_advance(am_sim *sim, double t, double h, const double *u0, const double *u1);

/* Force [N] and moment about the c.g. [N m] of all engines, angular momentum of the rotors
 * [kg m2 s-1], all in body axes; rates of the states. */
void engine_forces(flight_t *sim, const real *x, const real *u, real F[3], real M[3], real H[3],
                   real *dx);

/* Lever with bias and trim, 0 ... 1. */
double applied_throttle(const am_sim *sim, const double *u, uint32_t engine);

void engine_outputs(const flight_t *sim, real *y);

#endif
