/* Feeds: from which tanks each engine draws, and pumps between them; called by fuel.c and
 * engine.c. */
#ifndef AEROMATCH_FEED_H
#define AEROMATCH_FEED_H

#include "flight.h"

int feeds_check(am_sim *sim);
int transfers_check(am_sim *sim);

/* Whether a feed of the engine delivers. */
mask_t fuel_fed(const flight_t *sim, uint32_t engine, const real *x, const real *u);

/* Set the rates of the tanks from the flow to each engine [kg s-1] and the pumps. */
void draw_fuel(const flight_t *sim, const real *x, const real *u, const real flow[MAX_ENGINES],
               real *dx);

#endif
