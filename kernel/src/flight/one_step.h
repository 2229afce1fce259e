/* One internal step of a simulation. */
#ifndef AEROMATCH_ONE_STEP_H
#define AEROMATCH_ONE_STEP_H

#include "flight.h"

/* The discrete part of the submodels from t to t + h; u0 and u1 are the inputs at both ends.  One
 * that jumps at t clears sim->fresh, so that the first slope is found anew. */
void advance_memory(am_sim *sim, double t, double h, const double *u0, const double *u1);

/* Count a step of each axis that stands in an end cell, beyond its breakpoints. */
void count_outside(am_sim *sim);

/* Runge-Kutta from t to t + h, which leaves the new state in x_work; s0 ... s1 is the part of
 * u0 ... u1 that it covers.  False when the state is not finite. */
bool one_step(flight_t *sim, double t, double h, const real *u0, const real *u1, double s0,
              double s1);

#endif
