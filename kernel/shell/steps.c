/* Modes and steps of co-simulation. */
#include "guard.h"

#include "readiness.h"
#include "replay.h"

#include <math.h>
#include <string.h>

int fmu_set_start(fmu *f, double start) {
    if (demand(f, f && f->phase == FMU_CREATED, "setting the start time")) return FMU_ERROR;
    if (!isfinite(start)) {
        return fmu_refuse(f, "start time is %g; give a finite time in seconds", start);
    }
    f->start = start;
    return FMU_OK;
}

int fmu_begin_configuration(fmu *f) {
    if (demand(f, f && f->phase == FMU_CREATED, "entering configuration mode")) return FMU_ERROR;
    f->phase = FMU_CONFIGURING;
    return FMU_OK;
}

int fmu_end_configuration(fmu *f) {
    if (demand(f, f && f->phase == FMU_CONFIGURING, "leaving configuration mode")) return FMU_ERROR;
    f->phase = FMU_CREATED;
    return FMU_OK;
}

int fmu_begin_initialization(fmu *f) {
    if (demand(f, f && f->phase == FMU_CREATED, "entering initialization mode")) return FMU_ERROR;
    f->phase = FMU_INITIALIZING;
    f->initialized = 0;
    return FMU_OK;
}

int fmu_end_initialization(fmu *f) {
    if (demand(f, f && f->phase == FMU_INITIALIZING, "leaving initialization mode")) {
        return FMU_ERROR;
    }
    int status = f->initialized ? FMU_OK : initialize_instance(f);
    f->phase = status != FMU_OK               ? FMU_FAILED
               : f->kind == FMU_CO_SIMULATION ? FMU_STEPPING
                                              : FMU_EVENT;
    return status;
}

int fmu_step(fmu *f, double t, double dt) {
    if (f && f->kind != FMU_CO_SIMULATION) {
        return fmu_refuse(f,
                          "a step belongs to co-simulation; this instance is for model exchange");
    }
    if (demand(f, f && f->phase == FMU_STEPPING, "a step")) return FMU_ERROR;
    double now = am_time(f->sim);
    /* the importer's clock may differ by rounding only */
    if (!(fabs(t - now) <= 1e-9 * (1.0 + fabs(now)))) {
        return fmu_refuse(
            f,
            "step from t = %.9g s, but the instance stands at %.9g s; step on from there, or set "
            "a stored state",
            t, now);
    }
    if (!(dt > 0.0) || !isfinite(dt)) {
        return fmu_refuse(f, "step size is %g s; give a positive, finite step", dt);
    }
    if (replay_waiting(f)) return replay_run(f, t, dt);
    /* inputs without a slope are held, which the kernel need not blend */
    const double *u1 = f->u0;
    am_get_inputs(f->sim, f->u0);
    for (size_t i = 0; i < f->inputs; i++) {
        f->u1[i] = f->u0[i] + f->slopes[i] * dt;
        if (f->slopes[i] != 0.0) u1 = f->u1;
    }
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = 0;
    if (am_step(f->sim, t, dt, f->u0, u1) == AM_OK) return FMU_OK;
    f->phase = FMU_FAILED;
    return fmu_refuse(f, "step from t = %.9g s to %.9g s failed: %s", t, t + dt, am_error(f->sim));
}

int fmu_stop(fmu *f) {
    if (demand(f, f && f->phase > FMU_INITIALIZING && f->phase != FMU_STOPPED, "terminating")) {
        return FMU_ERROR;
    }
    f->phase = FMU_STOPPED;
    return FMU_OK;
}

double fmu_time(const fmu *f) {
    if (!f->initialized) return f->start;
    return f->kind == FMU_CO_SIMULATION ? am_time(f->sim) : f->time;
}
