/* Reading and setting what a simulation holds. */
#ifndef AEROMATCH_ACCESS_H
#define AEROMATCH_ACCESS_H

#include "simulation.h"

/* Make u[am_count(AM_INPUT)], which is finite, the present inputs. */
void store_inputs(am_sim *sim, const double *u);

#endif
