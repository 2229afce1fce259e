/* What all kinds of trim make small, and their refusals. */
#ifndef AEROMATCH_TRIM_RESIDUAL_H
#define AEROMATCH_TRIM_RESIDUAL_H

#include "simulation.h"

/* Largest acceleration of a trimmed flight, rotations at half the span [m s-2]: 0.001 ft/s2, as in
 * the trim of JSBSim.  flightmech/steady_flight/trim_findings.py has the same. */
#define TRIMMED 3e-4

/* Add the body rates of a turn with init.psi_dot about the vertical to the state. */
void add_turn(am_sim *sim);

/* u' v' w' [m s-2] and p' q' r' [rad s-2] at the present state, less init.u_dot ... init.r_dot. */
void accelerations(am_sim *sim, double r[6]);

/* Fail: accelerations are not finite; init.V is too small to trim. */
int trim_not_finite(am_sim *sim);
int trim_too_slow(am_sim *sim);

#endif
