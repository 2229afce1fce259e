/* Steps in time. */
#ifndef AEROMATCH_INTEGRATE_H
#define AEROMATCH_INTEGRATE_H

#include "simulation.h"

/* Refuse inputs that are not finite: names the first. */
int check_inputs(am_sim *sim, const double *u);

#endif
