/* One internal step of a simulation. */
#include "one_step.h"

#include "error.h"
#include "runge_kutta.h"

#include <string.h>

#if ORIGINAL

#include "control_step.h"
#include "engine.h"
#include "weather.h"

static void find_end_cells(am_sim *sim) {
    sim->end_cells = 0;
    for (uint32_t i = 0; i < sim->model->axes; i++) {
        if (sim->cell[i] == 0) sim->end_cell[sim->end_cells++] = 2 * i;
        if (sim->cell[i] == sim->model->axis[i].cells - 1)
            sim->end_cell[sim->end_cells++] = 2 * i + 1;
    }
}

void count_outside(am_sim *sim) {
    if (sim->end_cells == RECOUNT) find_end_cells(sim);
    for (uint32_t k = 0; k < sim->end_cells; k++) {
        const uint32_t end_cell = sim->end_cell[k];
        (end_cell & 1 ? sim->above : sim->below)[end_cell / 2] += 1.0;
    }
}

/* The discrete part of the submodels from t to t + h; u0 and u1 are the inputs at both ends.
 * One that jumps at t clears sim->fresh, so that the first slope is found anew. */
void advance_memory(am_sim *sim, double t, double h, const double *u0, const double *u1) {
    if (air_moves(sim)) weather_advance(sim, t, h, u0, u1);
    engine_advance(sim, t, h, u0, u1);
    control_advance(sim, t, h, u0, u1);
}

#endif

static void one_advance_parts(am_sim *sim, double t, double h, const double *u0, const double *u1) {
    if (sim->model->memories) advance_memory(sim, t, h, u0, u1);
}

static bool one_can_reuse(const am_sim *sim, const double *u) {
    return sim->fresh && memcmp(u, sim->u, sizeof *u * (size_t)sim->model->count[AM_INPUT]) == 0;
}

static void one_first_slope(am_sim *sim, double t, double h, const double *u, bool reuse) {
    if (!reuse || !sim->fresh) {
        slope(sim, t, h, 0.0, sim->x, u, sim->k);
        keep_anchor(sim, sim->x);
    }
    sim->fresh = false;
}

static void one_count_steps_outside(am_sim *sim, bool counts) {
    if (counts) count_outside(sim);
}

bool one_step(flight_t *sim, double t, double h, const real *u0, const real *u1, double s0,
              double s1) {
    runge_kutta(sim, t, h, u0, u1, s0, s1);
    return all_finite(sim->x_work, (size_t)am_state_count(sim->model));
}
