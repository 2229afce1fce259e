/* The memory of a simulation: one block, the arrays behind the struct, so that a copy is one
 * memcpy. */
#include "allocate.h"

#include "error.h"
#include "cells.h"

#include <stdlib.h>
#include <string.h>

#define STAND (4 + sizeof(stand_t) / sizeof(double)) /* of a bench: with its fractions */

static double *next_array(double **at, size_t n) {
    double *array = *at;
    *at += n;
    return array;
}

size_t sim_size(const am_model *m) {
    const size_t nx = (size_t)am_state_count(m);
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t np = (size_t)m->count[AM_PARAMETER];
    const size_t na = m->axes;
    const size_t doubles = np + 3 * nu + (size_t)m->count[AM_OUTPUT] + 6 * nx
                           + m->total[AM_VARIABLE] + values_of(m) + m->total[AM_TARGET] + 2 * na
                           + STAND * (size_t)m->first_bench[STAGES] + 2 * (size_t)m->memories
                           + m->works + LAST_POWER + m->corners + m->first_packet[STAGES * WAYS];
    return sizeof(am_sim) + doubles * sizeof(double)
           + (2 * na + m->bundles + LIST_WORDS(m)) * sizeof(uint32_t);
}

am_sim *am_new(const am_model *m) {
    const size_t nx = (size_t)am_state_count(m);
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t np = (size_t)m->count[AM_PARAMETER];
    const size_t na = m->axes;
    am_sim *sim = calloc(1, m->sim_bytes);
    if (!sim) return NULL;
    sim->model = m;
    double *at = (double *)(sim + 1);
    sim->par = next_array(&at, np);
    sim->u = next_array(&at, nu);
    sim->u_work = next_array(&at, nu);
    sim->u_end = next_array(&at, nu);
    sim->y_work = next_array(&at, (size_t)m->count[AM_OUTPUT]);
    sim->x = next_array(&at, nx);
    sim->x_work = next_array(&at, nx);
    sim->k = next_array(&at, 4 * nx);
    sim->var = next_array(&at, m->total[AM_VARIABLE]);
    sim->slot = next_array(&at, values_of(m));
    sim->sum = next_array(&at, m->total[AM_TARGET]);
    sim->memory = next_array(&at, m->memories);
    sim->memory_before = next_array(&at, m->memories);
    sim->work = next_array(&at, m->works);
    sim->last_power = next_array(&at, LAST_POWER);
    sim->fraction = next_array(&at, 4 * (size_t)m->first_bench[STAGES]);
    sim->below = next_array(&at, na);
    sim->above = next_array(&at, na);
    sim->stand = (stand_t *)next_array(&at,
                                       sizeof(stand_t) / sizeof(double) * m->first_bench[STAGES]);
    sim->packed = next_array(&at, m->corners);
    sim->wake = (uint64_t *)next_array(&at, m->first_packet[STAGES * WAYS]);
    sim->cell = (uint32_t *)at;
    sim->end_cell = sim->cell + na;
    sim->corner = sim->end_cell + na;
    sim->lists = lay_lists(m, sim->corner + m->bundles);
    sim->scale = sim->par + m->total[AM_PARAMETER];
    sim->exponent = sim->scale + m->terms;
    for (size_t i = 0; i < np; i++) sim->par[i] = m->entry[AM_PARAMETER][i].value;
    for (size_t i = 0; i < nu; i++) sim->u[i] = m->entry[AM_INPUT][i].value;
    sim->slot[0] = sim->var[A_ONE] = sim->part = 1.0;
    reset_cells(sim);
    return sim;
}

void am_delete(am_sim *sim) { free(sim); }

int am_copy(am_sim *to, const am_sim *from) {
    if (to->model != from->model) {
        return fail(to, AM_BAD_ARGUMENT,
                    "a simulation can only be copied to one of the same model");
    }
    const size_t start = offsetof(am_sim, now);
    if (to != from) {
        memcpy((char *)to + start, (const char *)from + start, to->model->sim_bytes - start);
    }
    return AM_OK;
}
