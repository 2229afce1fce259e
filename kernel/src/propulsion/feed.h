/* Feeds: from which tanks each engine draws; fuel.c and engine.c call it. */
#ifndef AEROMATCH_FEED_H
#define AEROMATCH_FEED_H

#include "flight.h"

int feeds_check(am_sim *sim);

/* Whether a feed of the engine delivers. */
mask_t fuel_fed(const flight_t *sim, uint32_t engine, const real *x, const real *u);

/* Add the flow to one engine [kg s-1] to the rates of the tanks that it comes from, which are zero
 * before the first engine. */
void draw_fuel(const flight_t *sim, uint32_t engine, const real *x, const real *u, real flow,
               real *dx);

#endif
