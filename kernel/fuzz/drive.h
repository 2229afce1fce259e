/* Calls of the kernel chosen by bytes: what the fuzzers and the flights under sanitizers have in
 * common. */
#ifndef AEROMATCH_DRIVE_H
#define AEROMATCH_DRIVE_H

#include "kernel.h"

#include <stddef.h>
#include <stdint.h>

/* Choices, taken from the front; zeros when nothing is left. */
typedef struct {
    const uint8_t *at;
    size_t left;
} bytes_t;

uint8_t take_byte(bytes_t *bytes);
uint32_t take_number(bytes_t *bytes, uint32_t below);
double take_value(bytes_t *bytes); /* of any size, sometimes NaN or infinite */

/* A promise of kernel.h that must hold; else the process ends with the words. */
void promise(int holds, const char *words);

/* A piece of memory of exactly n doubles, not set, so that a sanitizer sees what lies beyond or
 * is not written. */
double *room(size_t n);

/* One call of a function of kernel.h, or of the images of the FMU, on a simulation of the model. */
void call_kernel(const am_model *model, am_sim *sim, bytes_t *bytes);

/* Calls of the functions of kernel.h that need no model: paths, sums, elimination. */
void call_estimation(bytes_t *bytes);

/* SHA-256 or CRC-32 do not stop a hostile hand, so the fuzzers write the right ones. */
uint32_t crc32(const uint8_t *bytes, size_t n);

/* Blocks that Python compiled: model k of the folder in the environment variable
 * AEROMATCH_MODELS; NULL past the last. */
am_model *model_of_folder(int k);
const char *folder_of_model(int k); /* where its model.bin lies; NULL past the last */

#endif
