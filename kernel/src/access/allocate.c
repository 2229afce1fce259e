/* The memory of a simulation: one piece, the arrays behind the struct, so that a copy is one
 * memcpy. */
#include "allocate.h"

#include "error.h"
#include "table.h"

#include <stdlib.h>
#include <string.h>

#define STAND (4 + sizeof(stand_t) / sizeof(double)) /* of a bench: with its fractions */

static double *take(double **at, size_t n) {
    double *piece = *at;
    *at += n;
    return piece;
}

size_t sim_size(const am_model *m) {
    const size_t nx = (size_t)am_state_count(m);
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t np = (size_t)m->count[AM_PARAMETER];
    const size_t na = m->axes;
    const size_t doubles = np + 3 * nu + (size_t)m->count[AM_OUTPUT] + 6 * nx
                           + m->total[AM_VARIABLE] + values_of(m) + m->total[AM_TARGET] + 2 * na
                           + STAND * (size_t)m->first_bench[STAGES] + 2 * (size_t)m->memories
                           + m->works + LAST_POWER + m->corners + m->first_quad[STAGES * WAYS];
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
    sim->par = take(&at, np);
    sim->u = take(&at, nu);
    sim->u_work = take(&at, nu);
    sim->u_end = take(&at, nu);
    sim->y_work = take(&at, (size_t)m->count[AM_OUTPUT]);
    sim->x = take(&at, nx);
    sim->x_work = take(&at, nx);
    sim->k = take(&at, 4 * nx);
    sim->var = take(&at, m->total[AM_VARIABLE]);
    sim->slot = take(&at, values_of(m));
    sim->sum = take(&at, m->total[AM_TARGET]);
    sim->memory = take(&at, m->memories);
    sim->memory_before = take(&at, m->memories);
    sim->work = take(&at, m->works);
    sim->last_power = take(&at, LAST_POWER);
    sim->fraction = take(&at, 4 * (size_t)m->first_bench[STAGES]);
    sim->below = take(&at, na);
    sim->above = take(&at, na);
    sim->stand = (stand_t *)take(&at, sizeof(stand_t) / sizeof(double) * m->first_bench[STAGES]);
    sim->packed = take(&at, m->corners);
    sim->wake = (uint64_t *)take(&at, m->first_quad[STAGES * WAYS]);
    sim->cell = (uint32_t *)at;
    sim->outer = sim->cell + na;
    sim->corner = sim->outer + na;
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
