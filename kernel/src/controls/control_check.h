/* Parameters of the control circuits. */
#ifndef AEROMATCH_CONTROL_CHECK_H
#define AEROMATCH_CONTROL_CHECK_H

#include "simulation.h"

/* Check the parameters of all circuits. */
int control_check(am_sim *sim);

#endif
