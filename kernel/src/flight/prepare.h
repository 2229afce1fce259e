/* Parameters of the core, and what follows from them. */
#ifndef AEROMATCH_PREPARE_H
#define AEROMATCH_PREPARE_H

#include "simulation.h"

/* Check all parameters and derive what depends on them; nothing to do unless one has changed. */
int prepare(am_sim *sim);

/* prepare, and AM_NOT_READY before am_initialize. */
int ready(am_sim *sim);

#endif
