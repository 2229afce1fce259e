/* Equations of motion. */
#ifndef AEROMATCH_SIXDOF_H
#define AEROMATCH_SIXDOF_H

#include "flight.h"

/* Air, attitude, motion relative to the air, mass and the variables of the tables from the
 * state. */
void set_flight_condition(flight_t *sim, const real *x, const real *u);

/* Keep what the derivative of x has found as an anchor: the later slopes of a step find place, air,
 * flow angles and power factors from it, to rounding. */
void keep_anchor(flight_t *sim, const real *x);

/* Rate dx[am_state_count] of the state x under the inputs u; what it found stands in now. */
void derivative(flight_t *sim, const real *x, const real *u, real *dx);

#endif
