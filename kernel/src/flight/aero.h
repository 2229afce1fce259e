/* Aerodynamic coefficients, force and moment. */
#ifndef AEROMATCH_AERO_H
#define AEROMATCH_AERO_H

#include "flight.h"

/* Set coefficients, force [N], aerodynamic moment about the reference point [N m] and, but in the
 * later slopes of a step, the flow rates [rad s-1] in now.  per_mass: of the aircraft [kg-1];
 * applied: the other forces but gravity (thrust, gear) [N]; free_fall: acceleration of the
 * air-relative velocity without any force but gravity [m s-2]; both in body axes. */
void aero_forces(flight_t *sim, real per_mass, const real applied[3], const real free_fall[3]);

#endif
