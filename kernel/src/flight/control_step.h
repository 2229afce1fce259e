/* The control circuits through a step of the flight. */
#ifndef AEROMATCH_CONTROL_STEP_H
#define AEROMATCH_CONTROL_STEP_H

#include "flight.h"

/* Circuits at rest under the loads of the start. */
void control_start(am_sim *sim);

/* Circuits from t to t + h [s] under inputs linear from u0 to u1. */
void control_advance(flight_t *sim, double t, double h, const real *u0, const real *u1);

#endif
