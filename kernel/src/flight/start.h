/* The state at the start. */
#ifndef AEROMATCH_START_H
#define AEROMATCH_START_H

#include "simulation.h"

/* State from init.* with the given flow angles and pitch attitude [rad]; the submodels start
 * in equilibrium. */
void start_state(am_sim *sim, double alpha, double beta, double theta);

/* Pitch attitude of a climb by init.gamma over ground. [rad] */
double start_pitch(const am_sim *sim, double alpha, double beta);

#endif
