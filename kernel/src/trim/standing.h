/* The attitude in which an aircraft stands. */
#ifndef AEROMATCH_STANDING_H
#define AEROMATCH_STANDING_H

#include "simulation.h"

/* Guess init.h and init.theta for standing on the ground on legs that do not bend. */
void guess_standing(am_sim *sim);

#endif
