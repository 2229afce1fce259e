/* Outputs at the present state and inputs. */
#ifndef AEROMATCH_OUTPUTS_H
#define AEROMATCH_OUTPUTS_H

#include "simulation.h"

/* The derivative of the present state and inputs in now and in the first slope, unless it stands
 * there. */
int refresh(am_sim *sim);

#endif
