/* Steps in time; the end of a step that an importer's solver has made. */
#include "integrate.h"

#include "access.h"
#include "delay.h"
#include "error.h"
#include "once_avx2.h"
#include "one_step.h"
#include "outputs.h"
#include "prepare.h"
#include "weather.h"

#include <math.h>
#include <string.h>

/* The memory of a step that is taken back: all of it but that of the weather where the air does not
 * move, and the places that the delays of the levers do not use. */
static void copy_memory(const am_model *m, bool air, double *to, const double *from) {
    const uint32_t first = m->first_memory[G_SPOOL];
    const uint32_t size = m->per_memory[G_SPOOL];
    const uint32_t end = first + items(m, G_SPOOL) * size;
    if (air) memcpy(to, from, sizeof *to * first);
    for (uint32_t i = first; i < end; i += size) {
        memcpy(to + i, from + i, sizeof *to * delay_used(from + i));
    }
    memcpy(to + end, from + end, sizeof *to * (m->memories - end));
}

int check_inputs(am_sim *sim, const double *u) {
    for (int i = 0; i < sim->model->count[AM_INPUT]; i++) {
        if (!isfinite(u[i])) {
            const char *name = sim->model->entry[AM_INPUT][i].name;
            return fail(sim, AM_NOT_FINITE, "input %s is %g at t = %g s; it must be finite", name,
                        u[i], sim->time);
        }
    }
    return AM_OK;
}

int am_step(am_sim *sim, double t, double dt, const double *u0, const double *u1) {
    if (!(dt >= 0.0 && fabs(t) <= LATEST && fabs(t + dt) <= LATEST)) {
        return fail(
            sim, AM_BAD_ARGUMENT,
            "step from t = %g s by %g s; the step must be finite and not negative, times within "
            "1e10 s",
            t, dt);
    }
    int status = ready(sim);
    if (status != AM_OK) return status;
    sim->time = t;
    if ((status = check_inputs(sim, u0)) != AM_OK) return status;
    sim->time = t + dt;
    if ((status = check_inputs(sim, u1)) != AM_OK) return status;
    const double parts = ceil(dt / sim->par[P_STEP] - 1e-9);
    if (!(parts <= 1e9)) {
        return fail(sim, AM_BAD_ARGUMENT, "%g s are more than 1e9 steps of mode.step = %g s", dt,
                    sim->par[P_STEP]);
    }
    const long n = dt > 0.0 && parts < 1.0 ? 1 : (long)parts;
    /* no step: the state may be that of a trim that failed */
    if (n == 0 && (status = check_finite(sim, AM_STATE, sim->x)) != AM_OK) return status;
    for (long i = 0; i < n; i++) {
        const double s0 = (double)i / (double)n;
        const double s1 = (double)(i + 1) / (double)n;
        const bool air = air_moves(sim);
        copy_memory(sim->model, air, sim->memory_before, sim->memory);
        const bool finite = best_step(sim, t + dt * s0, dt / (double)n, u0, u1, s0, s1);
        sim->time = t + dt * s1;
        if (!finite) {
            copy_memory(sim->model, air, sim->memory, sim->memory_before);
            return check_finite(sim, AM_STATE, sim->x_work);
        }
        memcpy(sim->x, sim->x_work, sizeof(double) * (size_t)am_state_count(sim->model));
    }
    store_inputs(sim, u1);
    return AM_OK;
}

int am_derivative(am_sim *sim, const double *x, const double *u, double *dx) {
    int status = ready(sim);
    if (status != AM_OK) return status;
    sim->fresh = false;
    sim->clock = sim->time;
    sim->part = 1.0;
    best_derivative(sim, x, u, dx);
    return check_finite(sim, AM_STATE, dx);
}

int am_complete_step(am_sim *sim, double t) {
    const int status = ready(sim);
    if (status != AM_OK) return status;
    if (!(t >= sim->time && t <= LATEST)) {
        return fail(
            sim, AM_BAD_ARGUMENT,
            "a step is completed at %g s, but the simulation stands at %g s; times go on, up to "
            "1e10 s",
            t, sim->time);
    }
    if (t > sim->time) advance_memory(sim, sim->time, t - sim->time, sim->u, sim->u);
    sim->time = t;
    sim->fresh = false;
    refresh(sim);
    count_outside(sim);
    return AM_OK;
}
