/* Model exchange: the importer's solver integrates; states, derivatives and outputs are those of
 * the kernel. */
#include "guard.h"
#include "image.h"
#include "readiness.h"

#include <math.h>
#include <string.h>

static int demand_exchange(const fmu *f, int allowed, const char *what) {
    if (f && f->kind != FMU_MODEL_EXCHANGE) {
        return fmu_refuse(f, "%s belongs to model exchange; this instance is for co-simulation",
                          what);
    }
    return demand(f, allowed, what);
}

static int demand_states(const fmu *f, size_t n) {
    if (n == f->states) return FMU_OK;
    return fmu_refuse(f, "an array of %lu for the %lu states", (unsigned long)n,
                      (unsigned long)f->states);
}

/* Typical size of a state by its unit; the writer of modelDescription.xml uses the same. */
static double nominal(const char *units) {
    static const struct {
        const char *units;
        double size;
    } known[] = {{"m", 1000.0},  {"m s-1", 100.0}, {"rad s-1", 0.1},
                 {"N", 10000.0}, {"kg", 1000.0},   {"rad", 0.1}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        if (strcmp(units, known[i].units) == 0) return known[i].size;
    }
    return 1.0;
}

int fmu_begin_event(fmu *f) {
    if (demand_exchange(f, f && f->phase == FMU_CONTINUOUS, "entering event mode")) {
        return FMU_ERROR;
    }
    f->phase = FMU_EVENT;
    return FMU_OK;
}

int fmu_begin_continuous(fmu *f) {
    if (demand_exchange(f, f && f->phase == FMU_EVENT, "entering continuous-time mode")) {
        return FMU_ERROR;
    }
    f->phase = FMU_CONTINUOUS;
    return FMU_OK;
}

/* Turbulence, gusts, delays and control systems with friction are not states.  They are constant
 * between events and move at them, so that they do not depend on the solver's steps; a model in
 * which none is active needs one event only. */
static int move_discrete(fmu *f) {
    size_t n;
    const double *memory = image_memory(f->sim, &n);
    memcpy(f->memory, memory, n * sizeof(double));
    f->fresh = 0;
    if (am_complete_step(f->sim, f->time) != AM_OK) {
        return fmu_refuse(f, "the step to t = %.9g s cannot be completed: %s", f->time,
                          am_error(f->sim));
    }
    if (memcmp(f->memory, memory, n * sizeof(double)) != 0) f->moving = 1;
    return FMU_OK;
}

int fmu_update_discrete(fmu *f, double *next_event) {
    double step = 0.0;
    *next_event = INFINITY;
    if (demand_exchange(f, f && f->phase == FMU_EVENT, "updating discrete states")
        || move_discrete(f)) {
        return FMU_ERROR;
    }
    am_get_parameter(f->sim, am_find(f->model, AM_PARAMETER, "mode.step"), &step);
    if (f->moving || f->time == f->start) *next_event = f->time + step;
    return FMU_OK;
}

int fmu_complete_step(fmu *f, int *event) {
    if (demand_exchange(f, f && f->phase == FMU_CONTINUOUS, "completing an integrator step")) {
        return FMU_ERROR;
    }
    if (f->moving) return FMU_OK;
    if (move_discrete(f)) return FMU_ERROR;
    *event = f->moving;
    return FMU_OK;
}

int fmu_set_time(fmu *f, double t) {
    if (demand_exchange(f, f && (f->phase == FMU_EVENT || f->phase == FMU_CONTINUOUS),
                        "setting the time")) {
        return FMU_ERROR;
    }
    if (!isfinite(t)) return fmu_refuse(f, "time is %g; give a finite time in seconds", t);
    f->time = t;
    f->fresh = 0;
    return FMU_OK;
}

/* A solver may try states that are not finite: FMU_DISCARD makes it try a smaller step, and the
 * instance stays as it was. */
int fmu_set_states(fmu *f, const double x[], size_t n) {
    if (demand_exchange(f, f && f->phase == FMU_CONTINUOUS, "setting the states")
        || demand_states(f, n)) {
        return FMU_ERROR;
    }
    if (am_set_state(f->sim, x) != AM_OK) return FMU_DISCARD;
    f->fresh = 0;
    return FMU_OK;
}

int fmu_get_states(fmu *f, double x[], size_t n) {
    if (!f || demand_states(f, n) || demand_initialized(f, "reading the states")) return FMU_ERROR;
    am_get_state(f->sim, x);
    return FMU_OK;
}

int fmu_get_derivatives(fmu *f, double dx[], size_t n) {
    if (!f || demand_states(f, n) || demand_initialized(f, "reading the derivatives")) {
        return FMU_ERROR;
    }
    am_get_state(f->sim, f->x);
    am_get_inputs(f->sim, f->u0);
    const int status = am_derivative(f->sim, f->x, f->u0, dx);
    if (status == AM_NOT_FINITE) return FMU_DISCARD;
    return status == AM_OK ? FMU_OK
                           : fmu_refuse(f, "derivatives cannot be computed: %s", am_error(f->sim));
}

int fmu_get_nominals(fmu *f, double nominals[], size_t n) {
    if (demand_exchange(f, f && f->phase > FMU_CONFIGURING, "reading the nominals")
        || demand_states(f, n)) {
        return FMU_ERROR;
    }
    for (size_t i = 0; i < n; i++) {
        am_entry entry;
        am_entry_at(f->model, AM_STATE, (int)i, &entry);
        nominals[i] = nominal(entry.units);
    }
    return FMU_OK;
}

int fmu_get_indicators(fmu *f, size_t n) {
    if (demand_exchange(f, f && f->phase > FMU_CONFIGURING, "reading event indicators")) {
        return FMU_ERROR;
    }
    return n == 0 ? FMU_OK : fmu_refuse(f, "the model has no event indicators");
}

int fmu_count_states(fmu *f, size_t *n) {
    if (demand_exchange(f, f != NULL, "counting the states")) return FMU_ERROR;
    *n = f->states;
    return FMU_OK;
}
