/* What the kinds of trim share. */
#ifndef AEROMATCH_TRIM_H
#define AEROMATCH_TRIM_H

#include "model.h"

void add_turn(am_sim *sim);
void accelerations(am_sim *sim, double r[6]);
int trim_not_finite(am_sim *sim);
int trim_too_slow(am_sim *sim);
/* am_trim_for without its checks; y may be NULL when all goals are accelerations. */
int trim_seek(am_sim *sim, const am_trim_task *task, double *found, double *y, double *left,
              double *jacobian);
int trim_on_ground(am_sim *sim);
/* Guess init.h and init.theta for standing on the ground. */
void stand_up(am_sim *sim);

#endif
