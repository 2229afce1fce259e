/* What the processor decides: see versions.c. */
#ifndef AEROMATCH_VERSIONS_H
#define AEROMATCH_VERSIONS_H

#include "model.h"

/* The fastest loops over tables that this processor has; results have the same bits in each. */
versions_t best_versions(void);

#endif
