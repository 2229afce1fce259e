/* From init.* to a simulation that can fly. */
#include "error.h"

#include "prepare.h"
#include "start.h"
#include "cells.h"

#include <math.h>
#include <string.h>

#define EARTH_RATE 7.292115e-5 /* WGS-84 [rad s-1] */

int am_initialize(am_sim *sim, double t) {
    sim->ready = sim->prepared = false;
    sim->text[0] = 0;
    if (!(fabs(t) <= LATEST)) {
        return fail(sim, AM_BAD_ARGUMENT,
                    "the start time is %g s; it must be finite and within 1e10 s", t);
    }
    int status = prepare(sim);
    if (status != AM_OK) return status;
    const double *p = sim->par;
    sim->earth = (int)p[P_EARTH];
    sim->omega = sim->earth == WGS84_EARTH || sim->earth == SPHERE_ROTATING ? EARTH_RATE : 0.0;
    sim->time = t;
    memset(&sim->trim, 0, sizeof sim->trim);
    memset(sim->below, 0, sizeof(double) * sim->model->axes);
    memset(sim->above, 0, sizeof(double) * sim->model->axes);
    reset_cells(sim);
    start_state(sim, p[P_ALPHA], p[P_BETA], p[P_THETA]);
    if ((status = check_finite(sim, AM_STATE, sim->x)) != AM_OK) return status;
    sim->ready = true;
    if (p[P_TRIM] != 0.0) status = am_trim(sim, (int)p[P_TRIM]);
    sim->ready = status == AM_OK;
    return status;
}
