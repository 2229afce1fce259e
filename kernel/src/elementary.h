#ifndef AEROMATCH_ELEMENTARY_H
#define AEROMATCH_ELEMENTARY_H
#include <math.h>
#define am_pow pow
#endif
