/* Outputs of the control circuits. */
#ifndef AEROMATCH_CONTROL_OUTPUTS_H
#define AEROMATCH_CONTROL_OUTPUTS_H

#include "flight.h"

/* Travel, rate, forces and their parts of all circuits. */
void control_outputs(flight_t *sim, real *y);

#endif
