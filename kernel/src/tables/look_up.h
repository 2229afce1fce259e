/* Values of the tables of a stage. */
#ifndef AEROMATCH_LOOK_UP_H
#define AEROMATCH_LOOK_UP_H

#include "flight.h"

/* From sim->var to sim->slot, changes of nodes included. */
void look_up(flight_t *sim, int stage);

#endif
