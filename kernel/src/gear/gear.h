/* Landing gear on the runway. */
#ifndef AEROMATCH_GEAR_H
#define AEROMATCH_GEAR_H

#include "flight.h"

enum { DRY, WET, ICY }; /* values of runway.condition */

/* Struts and steering at rest at the height and attitude of the start. */
void gear_start(am_sim *sim);

/* Force [N] and moment about the c.g. [N m] in body axes; rates of the states of all contacts. */
void gear_forces(flight_t *sim, const real *x, const real *u, real F[3], real M[3], real *dx);

/* True when nothing can touch the ground at any attitude and every strut and tyre is back at its
 * free length; then only the steering moves, and there is no force. */
mask_t gear_clear(const flight_t *sim, const real *x);
void gear_off_ground(flight_t *sim, const real *x, const real *u, real *dx);

void gear_outputs(const flight_t *sim, real *y);

#endif
