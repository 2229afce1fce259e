/* Outputs of the control circuits. */
#ifndef AEROMATCH_CONTROL_OUTPUTS_H
#define AEROMATCH_CONTROL_OUTPUTS_H

#include "simulation.h"

/* Travel, rate, forces and their parts of all circuits. */
void control_outputs(am_sim *sim, double *y);

#endif
