/* Choices by bytes, promises and exact memory, which all drivers of the fuzzers share. */
#ifndef AEROMATCH_DRIVE_CHOICES_H
#define AEROMATCH_DRIVE_CHOICES_H

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

#endif
