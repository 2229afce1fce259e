/* Simulations that fly side by side: four with AVX2, eight with AVX-512, with the bits of each
 * alone. */
#ifndef AEROMATCH_LANES_H
#define AEROMATCH_LANES_H

#include "simulation.h"

#define MOST_LANES 8

/* Runs of a task that have made their first sample, in the same mode (fit_together).  run: of each
 * simulation; one may stand for several lanes, the first of which counts. */
typedef struct {
    const am_batch_task *task;
    am_sim *sim[MOST_LANES];
    size_t run[MOST_LANES];
    int runs;
    int *status;
    size_t *done;
    char (*text)[AM_TEXT];
} group_t;

/* Fly the rest of the record; the simulations have no meaning afterwards.  False, and nothing done:
 * no memory. */
typedef bool fly_t(const group_t *group);
fly_t fly_4;
fly_t fly_8;

#endif
