/* Landing gear on the runway. */
#ifndef AEROMATCH_GEAR_H
#define AEROMATCH_GEAR_H

#include "simulation.h"

/* Check the parameters of runway, steering and contacts. */
int gear_check(am_sim *sim);

/* Struts and steering at rest at the height and attitude of the start. */
void gear_start(am_sim *sim);

/* Force [N] and moment about the c.g. [N m] in body axes; rates of the states of all contacts. */
void gear_forces(am_sim *sim, const double *x, const double *u, double F[3], double M[3],
                 double *dx);

void gear_outputs(am_sim *sim, double *y);

#endif
