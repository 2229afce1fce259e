/* Validity envelope: region of the present state, and the axis by which it left a better one. */
#ifndef AEROMATCH_ENVELOPE_H
#define AEROMATCH_ENVELOPE_H

#include "flight.h"

/* Outputs of the envelope, where the model has one. */
void envelope_outputs(const flight_t *sim, real *y);

#endif
