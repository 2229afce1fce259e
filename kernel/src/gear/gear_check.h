/* Check of the landing gear before a run. */
#ifndef AEROMATCH_GEAR_CHECK_H
#define AEROMATCH_GEAR_CHECK_H

#include "simulation.h"

/* Check the parameters of runway, steering and contacts, and set the reach of the contacts from the
 * reference point. */
int gear_check(am_sim *sim);

#endif
