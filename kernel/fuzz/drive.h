/* Calls of the kernel chosen by bytes: what the fuzzers and the flights under sanitizers have in
 * common. */
#ifndef AEROMATCH_DRIVE_H
#define AEROMATCH_DRIVE_H

#include "drive_choices.h"
#include "kernel.h"

enum { MODELS = 9 }; /* in the folder of `model_of_folder` */

/* One call of a function of kernel.h, or of the images of the FMU, on a simulation of the model. */
void call_kernel(const am_model *model, am_sim *sim, bytes_t *bytes);

/* SHA-256 or CRC-32 do not stop a hostile hand, so the fuzzers write the right ones. */
uint32_t crc32(const uint8_t *bytes, size_t n);

/* Blocks that Python compiled: model k of the folder in the environment variable
 * AEROMATCH_MODELS; NULL past the last. */
am_model *model_of_folder(int k);
const char *folder_of_model(int k); /* where its model.bin lies; NULL past the last */

#endif
