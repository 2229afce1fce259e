/* Calls of an estimation, chosen by bytes. */
#ifndef AEROMATCH_DRIVE_PATH_H
#define AEROMATCH_DRIVE_PATH_H

#include "drive_choices.h"

/* Calls of the functions of kernel.h that need no model: paths, sums, elimination. */
void call_estimation(bytes_t *bytes);

#endif
