/* Outputs at the present state and inputs. */
#ifndef AEROMATCH_OUTPUTS_H
#define AEROMATCH_OUTPUTS_H

#include "flight.h"

/* The derivative of the present state and inputs in now and in the first slope, unless it stands
 * there. */
int refresh(am_sim *sim);

/* All outputs y[am_count(AM_OUTPUT)] from what the derivative of the present state has found. */
void write_outputs(flight_t *sim, real *y);

#endif
