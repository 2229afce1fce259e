/* A simulation as bytes, for another instance or process with the same kernel and the same
 * model. */
#ifndef AEROMATCH_IMAGE_H
#define AEROMATCH_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "kernel.h"

uint64_t image_layout(void); /* differs when the bytes of two kernels do not mean the same */
size_t image_size(const am_model *model);
void image_save(const am_sim *sim, void *image);   /* image[image_size] */
int image_restore(am_sim *sim, const void *image); /* -1: no simulation can be in such a state */

/* The discrete part of the submodels, as far as it acts on the flight: surfaces that are driven
 * carry their circuits along. */
const double *image_memory(const am_sim *sim, size_t *n);
size_t image_memories(const am_model *model); /* the largest n */

#endif
