/* One bit of each of four truth values, by the instruction of AVX that gives them. */
#ifndef AEROMATCH_FOUR_BITS_H
#define AEROMATCH_FOUR_BITS_H

#include "four.h"

#define FOUR_BITS(yes) ((uint32_t)__builtin_ia32_movmskpd256((four)(yes)))

#endif
