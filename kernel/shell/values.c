/* Values of variables by their references. */
#include "guard.h"

#include "readiness.h"
#include "replay.h"

#include <math.h>
#include <string.h>

typedef enum { INPUT, OUTPUT, PARAMETER, STATE, DERIVATIVE, REPLAY, TIME } value_kind;

typedef struct {
    value_kind kind;
    int i;       /* index within the kind */
    size_t size; /* elements: more than one for the arrays of a replay */
} place;

static inline int find(uint32_t vr, uint32_t base, size_t count, value_kind kind, place *at) {
    if (vr < base || vr - base >= count) return 0;
    *at = (place){kind, (int)(vr - base), 1};
    return 1;
}

static inline int find_value(const fmu *f, uint32_t vr, place *at) {
    if (find(vr, FMU_INPUTS, f->inputs, INPUT, at) || find(vr, FMU_OUTPUTS, f->outputs, OUTPUT, at)
        || find(vr, FMU_PARAMETERS, f->parameters, PARAMETER, at)
        || find(vr, FMU_STATES, f->states, STATE, at)
        || find(vr, FMU_DERIVATIVES, f->states, DERIVATIVE, at)
        || find(vr, FMU_TIME, 1, TIME, at)) {
        return FMU_OK;
    }
    if (find(vr, FMU_REPLAY_T, 3, REPLAY, at)) {
        at->size = replay_elements(f, vr);
        return FMU_OK;
    }
    return fmu_refuse(f, "no variable has the value reference %lu; modelDescription.xml lists them",
                      (unsigned long)vr);
}

static am_entry entry_of(const fmu *f, place at) {
    static const am_kind known[] = {AM_INPUT, AM_OUTPUT, AM_PARAMETER};
    am_entry entry = {.name = "a state or its derivative"};
    if (at.kind == REPLAY) entry.name = "an array of the replay";
    if (at.kind == TIME) entry.name = "the time";
    if (at.kind <= PARAMETER) am_entry_at(f->model, known[at.kind], at.i, &entry);
    return entry;
}

static int refuse_count(const fmu *f, size_t n, size_t nvalues) {
    return fmu_refuse(
        f, "%lu values for %lu variables; a scalar takes one, an array as many as it has elements",
        (unsigned long)nvalues, (unsigned long)n);
}

/* Without a replay the one row of replay.y holds the outputs of the moment. */
static int get_array(fmu *f, uint32_t vr, double values[]) {
    if (vr == FMU_REPLAY_Y && f->replay.n == 1) {
        if (refresh_outputs(f)) return FMU_ERROR;
        memcpy(values, f->y, f->outputs * sizeof(double));
        return FMU_OK;
    }
    replay_get(f, vr, values);
    return FMU_OK;
}

/* States and derivatives are fetched once per call of fmu_get: `there` states which have been. */
static int get_one(fmu *f, place at, int there[2], double *value) {
    int derivative = at.kind == DERIVATIVE;
    switch (at.kind) {
    case TIME:
        *value = fmu_time(f);
        return FMU_OK;
    case INPUT:
        return am_get_input(f->sim, at.i, value);
    case PARAMETER:
        return am_get_parameter(f->sim, at.i, value);
    case REPLAY:
        return get_array(f, FMU_REPLAY_T + (uint32_t)at.i, value);
    case OUTPUT:
        if (refresh_outputs(f)) return FMU_ERROR;
        *value = f->y[at.i];
        return FMU_OK;
    default:
        if (!there[derivative]
            && (derivative ? fmu_get_derivatives(f, f->dx, f->states)
                           : fmu_get_states(f, f->x, f->states))) {
            return FMU_ERROR;
        }
        there[derivative] = 1;
        *value = (derivative ? f->dx : f->x)[at.i];
        return FMU_OK;
    }
}

int fmu_get(fmu *f, const uint32_t vr[], size_t n, double values[], size_t nvalues) {
    int there[2] = {0, 0};
    size_t left = nvalues;
    if (!f) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        place at;
        if (find_value(f, vr[k], &at)) return FMU_ERROR;
        if (at.size > left) return refuse_count(f, n, nvalues);
        if (get_one(f, at, there, values)) return FMU_ERROR;
        values += at.size;
        left -= at.size;
    }
    return left ? refuse_count(f, n, nvalues) : FMU_OK;
}

/* A parameter acts between steps, or in event mode; one that acts at initialisation only before. */
static int check_settable(const fmu *f, place at) {
    if (at.kind == INPUT) return FMU_OK;
    const am_entry entry = entry_of(f, at);
    if (at.kind != PARAMETER && !(at.kind == REPLAY && at.i != FMU_REPLAY_Y - FMU_REPLAY_T)) {
        return fmu_refuse(f, "%s is computed by the model and cannot be set", entry.name);
    }
    if (f->phase <= FMU_INITIALIZING) return FMU_OK;
    if (entry.flags & AM_FIXED) {
        return fmu_refuse(
            f,
            "%s acts at initialisation only; set it before the end of initialization mode, or "
            "reset",
            entry.name);
    }
    if (f->phase == FMU_CONTINUOUS) {
        return fmu_refuse(f, "%s is a parameter; set it in event mode", entry.name);
    }
    return FMU_OK;
}

static int check_finite_values(const fmu *f, place at, const double values[]) {
    for (size_t k = 0; k < at.size; k++) {
        if (!isfinite(values[k])) {
            return fmu_refuse(f, "%s is %g; it must be finite", entry_of(f, at).name, values[k]);
        }
    }
    return FMU_OK;
}

int fmu_set(fmu *f, const uint32_t vr[], size_t n, const double values[], size_t nvalues) {
    place at;
    size_t k;
    size_t done = 0;
    if (demand(f, f && f->phase <= FMU_CONTINUOUS && f->phase != FMU_CONFIGURING,
               "setting a variable")) {
        return FMU_ERROR;
    }
    for (k = 0; k < n; k++, done += at.size) { /* all are checked before the first is set */
        if (find_value(f, vr[k], &at) || check_settable(f, at)) return FMU_ERROR;
        if (at.size > nvalues - done) return refuse_count(f, n, nvalues);
        if (check_finite_values(f, at, values + done)) return FMU_ERROR;
    }
    if (done != nvalues) return refuse_count(f, n, nvalues);
    for (k = 0; k < n; k++, values += at.size) {
        find_value(f, vr[k], &at);
        if (at.kind == REPLAY) replay_set(f, vr[k], values);
        else (at.kind == INPUT ? am_set_input : am_set_parameter)(f->sim, at.i, *values);
    }
    f->fresh = 0;
    if (f->phase <= FMU_INITIALIZING) f->initialized = 0;
    return FMU_OK;
}

int fmu_check_integers(const fmu *f, const uint32_t vr[], size_t n) {
    if (!f) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        place at;
        if (find_value(f, vr[k], &at)) return FMU_ERROR;
        if (!(entry_of(f, at).flags & AM_INTEGER)) {
            return fmu_refuse(f, "%s is not an integer or enumeration; read and set it as a real",
                              entry_of(f, at).name);
        }
    }
    return FMU_OK;
}

int fmu_set_slopes(fmu *f, const uint32_t vr[], size_t n, const double slopes[]) {
    if (demand(f, f && f->phase <= FMU_STEPPING && f->phase != FMU_CONFIGURING,
               "setting the derivative of an input")) {
        return FMU_ERROR;
    }
    for (size_t k = 0; k < n; k++) {
        place at;
        if (find_value(f, vr[k], &at)) return FMU_ERROR;
        if (at.kind != INPUT) {
            return fmu_refuse(f, "%s is not an input; only inputs take derivatives",
                              entry_of(f, at).name);
        }
        if (!isfinite(slopes[k])) {
            return fmu_refuse(f, "derivative of %s is %g; give a finite value",
                              entry_of(f, at).name, slopes[k]);
        }
    }
    for (size_t k = 0; k < n; k++) f->slopes[vr[k] - FMU_INPUTS] = slopes[k];
    return FMU_OK;
}
