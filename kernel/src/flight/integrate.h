/* Steps in time. */
#ifndef AEROMATCH_INTEGRATE_H
#define AEROMATCH_INTEGRATE_H

#include "simulation.h"

/* Refuse inputs that are not finite: names the first. */
int check_inputs(am_sim *sim, const double *u);

/* The discrete part of the submodels from t to t + h; u0 and u1 are the inputs at both ends.  One
 * that jumps at t clears sim->fresh, so that the first slope is found anew. */
void advance_memory(am_sim *sim, double t, double h, const double *u0, const double *u1);

/* Count a step in the outer cells of each axis. */
void count_outside(am_sim *sim);

#endif
