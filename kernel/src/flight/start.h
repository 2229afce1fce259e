/* The state at the start. */
#ifndef AEROMATCH_START_H
#define AEROMATCH_START_H

#include "simulation.h"

/* State from init.* with the given flow angles and pitch attitude [rad]; the submodels start
 * in equilibrium. */
void start_state(am_sim *sim, double alpha, double beta, double theta);

/* Separation points of the wing halves at their steady value for the flow and the body rates. */
void start_separation(am_sim *sim);

/* Pitch attitude of a climb by init.gamma over ground. [rad] */
double start_pitch(const am_sim *sim, double alpha, double beta);

#endif
