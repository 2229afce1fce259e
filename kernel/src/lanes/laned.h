/* Between lanes and the simulation of each: numbers of one lane, given to it or taken from it. */
#ifndef AEROMATCH_LANED_H
#define AEROMATCH_LANED_H

#include "flight.h"

/* Number by number: a vector that is loaded for one of its lanes, or stored for one, costs more. */
typedef double number_t __attribute__((may_alias));

static inline double *copy_from_lane(const real *from, size_t n, int lane, double *to) {
    const number_t *at = (const number_t *)from + lane;
    for (size_t i = 0; i < n; i++) to[i] = at[i * LANES];
    return to;
}

static inline void copy_to_lane(const double *from, size_t n, int lane, real *to) {
    number_t *at = (number_t *)to + lane;
    for (size_t i = 0; i < n; i++) at[i * LANES] = from[i];
}

/* The first n numbers of now; now_r is made of real, as now_t of double. */
static inline void copy_now_from_lane(const flight_t *f, int lane, size_t n) {
    double *now = (double *)&f->lane[lane]->now;
    copy_from_lane((const real *)&f->now, n, lane, now);
}

#define BEFORE_FORCES (offsetof(now_t, F) / sizeof(double))

#endif
