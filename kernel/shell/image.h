/* A simulation as bytes, for another instance or process with the same library and the same model. */
#ifndef AEROMATCH_IMAGE_H
#define AEROMATCH_IMAGE_H

#include <stddef.h>

#include "kernel.h"

size_t image_size(const am_model *model);
void image_save(const am_sim *sim, void *image); /* image[image_size] */
void image_restore(am_sim *sim, const void *image);

#endif
