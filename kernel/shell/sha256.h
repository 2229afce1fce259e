#ifndef AEROMATCH_SHA256_H
#define AEROMATCH_SHA256_H

#include <stddef.h>

/* Write the SHA-256 of n bytes (FIPS 180-4) as 64 lower-case hexadecimal digits and a zero. */
void sha256_hex(const unsigned char *bytes, size_t n, char text[65]);

#endif
