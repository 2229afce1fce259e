/* Trim for a study: any outputs to wanted values. */
#ifndef AEROMATCH_TRIM_FOR_H
#define AEROMATCH_TRIM_FOR_H

#include "simulation.h"

/* am_trim_for without its checks; y may be NULL when all goals are accelerations. */
int solve_trim(am_sim *sim, const am_trim_task *task, double *found, double *y, double *left,
               double *jacobian);

#endif
