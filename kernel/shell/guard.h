/* Refusals, and calls that a phase does not allow. */
#ifndef AEROMATCH_GUARD_H
#define AEROMATCH_GUARD_H

#include "instance.h"

/* FMU_OK when `allowed`, else the refusal: <what> is not allowed while the instance is <phase>. */
int demand(const fmu *f, int allowed, const char *what);

#endif
