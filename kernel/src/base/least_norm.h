/* Nonlinear equations r(z) = 0 inside limits, by steps of the smallest norm.
 *
 * Levenberg-Marquardt steps  dz = -J^T (J J^T + lambda I)^-1 r :  for lambda -> 0 the
 * minimum-norm step, so an unknown without effect stays where it is, a surplus of unknowns is
 * shared out, and what cannot be removed is left as residual. An unknown at its limit is taken
 * out of the step.  The unknowns should be of the order of one, or NUDGE too coarse or too fine. */
#ifndef AEROMATCH_LEAST_NORM_H
#define AEROMATCH_LEAST_NORM_H

#include <stdbool.h>

#define LARGEST_SYSTEM 40 /* unknowns, and equations */
#define NUDGE 1e-6        /* of the central differences */

typedef struct {
    int unknowns, equations;
    bool nearest; /* of many solutions the one nearest to the start: exact slopes at every step */
    double low[LARGEST_SYSTEM], high[LARGEST_SYSTEM];
    /* weighed alike: the sum of the squares is made small */
    void (*residual)(void *task, const double *z, double *r);
    void *task;
} system_t;

typedef double jacobian_t[LARGEST_SYSTEM][LARGEST_SYSTEM]; /* [equation][unknown] */

/* Move z, inside the limits at the start, and return the sum of the squares that is left. */
double least_norm(const system_t *system, double *z);
void differences(const system_t *system, const double *z, jacobian_t J);

#endif
