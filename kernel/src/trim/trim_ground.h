/* Trim on the ground. */
#ifndef AEROMATCH_TRIM_GROUND_H
#define AEROMATCH_TRIM_GROUND_H

#include "simulation.h"

/* Height and attitude so that the legs carry the aircraft, at rest or rolling with init.V. */
int trim_on_ground(am_sim *sim);

#endif
