/* The memory of a simulation. */
#ifndef AEROMATCH_ALLOCATE_H
#define AEROMATCH_ALLOCATE_H

#include "simulation.h"

/* Bytes of a simulation of the model: am_sim and the arrays behind it. */
size_t sim_size(const am_model *model);

#endif
