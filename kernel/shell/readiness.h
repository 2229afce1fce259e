/* An instance brought to where it can be read. */
#ifndef AEROMATCH_READINESS_H
#define AEROMATCH_READINESS_H

#include "instance.h"

/* Initialise under the present inputs and parameters, at f->start. */
int initialize_instance(fmu *f);

/* Refuse <what> before initialization mode; in it, initialise unless that has been done. */
int demand_initialized(fmu *f, const char *what);

/* Outputs of the present state, inputs and parameters in f->y. */
int refresh_outputs(fmu *f);

#endif
