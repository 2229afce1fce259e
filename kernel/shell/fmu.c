#include "fmu.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "instance.h"
#include "resource.h"
#include "sha256.h"

int fmu_refuse(const fmu *f, const char *format, ...) {
    char text[1024];
    va_list arguments;
    if (!f) return FMU_ERROR;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    f->logger.tell(&f->logger, FMU_ERROR, text);
    return FMU_ERROR;
}

int demand(const fmu *f, int allowed, const char *what) {
    static const char *const phases[] = {
        "instantiated", "in configuration mode", "in initialization mode",
        "in step mode", "in event mode",         "in continuous-time mode",
        "terminated",   "stopped by an error"};
    if (!f) return FMU_ERROR;
    return allowed ? FMU_OK
                   : fmu_refuse(f, "%s is not allowed while the instance is %s", what,
                                phases[f->phase]);
}

/* ---- life ------------------------------------------------------------------------------------ */

static int allocate(fmu *f) {
    f->inputs = (size_t)am_count(f->model, AM_INPUT);
    f->outputs = (size_t)am_count(f->model, AM_OUTPUT);
    f->parameters = (size_t)am_count(f->model, AM_PARAMETER);
    f->states = (size_t)am_state_count(f->model);
    if (!(f->sim = am_new(f->model))) return FMU_ERROR;
    f->u0 = calloc(3 * f->inputs + f->outputs + 2 * f->states + image_memories(f->model),
                   sizeof(double));
    if (!f->u0 || replay_resize(f, 1)) return FMU_ERROR;
    f->u1 = f->u0 + f->inputs;
    f->slopes = f->u1 + f->inputs;
    f->y = f->slopes + f->inputs;
    f->x = f->y + f->outputs;
    f->dx = f->x + f->states;
    f->memory = f->dx + f->states;
    return FMU_OK;
}

static am_model *load(const char *resources, const char *token, char digest[65], char *text,
                      size_t ntext) {
    char path[4096];
    const char *why;
    size_t n = resources ? strlen(resources) : 0;
    size_t size = 0;
    int ended = n && (resources[n - 1] == '/' || resources[n - 1] == '\\');
    if (!n
        || snprintf(path, sizeof path, "%s%smodel.bin", resources, ended ? "" : "/")
               >= (int)sizeof path) {
        snprintf(text, ntext,
                 "the folder of the resources is missing or too long; give the unpacked FMU's "
                 "resources folder");
        return NULL;
    }
    unsigned char *bytes = resource_read(path, &size, &why);
    if (!bytes) {
        snprintf(text, ntext, "%.800s: %s; unpack the whole FMU before it is instantiated", path,
                 why);
        return NULL;
    }
    sha256_hex(bytes, size, digest);
    am_model *model = am_load(bytes, size, text, ntext);
    free(bytes);
    if (model && (!token || strcmp(token, digest) != 0)) {
        snprintf(text, ntext,
                 "token %.80s does not belong to model.bin, whose SHA-256 is %s; the FMU is mixed "
                 "from two, write it anew",
                 token ? token : "(none)", digest);
        am_free(model);
        model = NULL;
    }
    return model;
}

fmu *fmu_open(const char *resources, const char *token, fmu_kind kind, const fmu_logger *logger) {
    char text[1024] = "no memory";
    fmu *f = calloc(1, sizeof *f);
    if (f) {
        f->logger = *logger;
        f->kind = kind;
        f->model = load(resources, token, f->token, text, sizeof text);
        if (f->model && allocate(f) == FMU_OK) return f;
        if (f->model) snprintf(text, sizeof text, "no memory for an instance");
    }
    logger->tell(logger, FMU_ERROR, text);
    fmu_close(f);
    return NULL;
}

void fmu_close(fmu *f) {
    if (!f) return;
    if (f->sim) am_delete(f->sim);
    if (f->model) am_free(f->model);
    free(f->u0);
    free(f->replay.t);
    free(f);
}

int fmu_reset(fmu *f) {
    if (!f) return FMU_ERROR;
    am_sim *sim = am_new(f->model);
    if (!sim || replay_resize(f, 1)) {
        if (sim) am_delete(sim);
        return fmu_refuse(f, "no memory for a reset");
    }
    am_delete(f->sim);
    f->sim = sim;
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = f->initialized = 0;
    f->start = f->time = 0.0;
    f->phase = FMU_CREATED;
    return FMU_OK;
}

/* ---- initialisation and steps ---------------------------------------------------------------- */

static int initialize(fmu *f) {
    f->fresh = 0;
    if (replay_waiting(f)) am_set_inputs(f->sim, f->replay.u);
    if (am_initialize(f->sim, f->start) != AM_OK) {
        return fmu_refuse(f, "initialisation failed: %s", am_error(f->sim));
    }
    f->time = f->start;
    f->moving = 0;
    f->initialized = 1;
    return FMU_OK;
}

int demand_initialized(fmu *f, const char *what) {
    if (demand(f, f->phase > FMU_CONFIGURING, what)) return FMU_ERROR;
    return f->phase == FMU_INITIALIZING && !f->initialized ? initialize(f) : FMU_OK;
}

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
    int status = f->initialized ? FMU_OK : initialize(f);
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
    am_get_inputs(f->sim, f->u0);
    for (size_t i = 0; i < f->inputs; i++) f->u1[i] = f->u0[i] + f->slopes[i] * dt;
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = 0;
    if (am_step(f->sim, t, dt, f->u0, f->u1) == AM_OK) return FMU_OK;
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

/* ---- values ---------------------------------------------------------------------------------- */

typedef enum { INPUT, OUTPUT, PARAMETER, STATE, DERIVATIVE, REPLAY, TIME } value_kind;

typedef struct {
    value_kind kind;
    int i;       /* index within the kind */
    size_t size; /* elements: more than one for the arrays of a replay */
} place;

static int locate(const fmu *f, uint32_t vr, place *at) {
    const struct {
        uint32_t base;
        size_t count;
    } group[] = {{FMU_INPUTS, f->inputs},
                 {FMU_OUTPUTS, f->outputs},
                 {FMU_PARAMETERS, f->parameters},
                 {FMU_STATES, f->states},
                 {FMU_DERIVATIVES, f->states},
                 {FMU_REPLAY_T, 3},
                 {FMU_TIME, 1}};
    for (int k = INPUT; k <= TIME; k++) {
        if (vr >= group[k].base && vr - group[k].base < group[k].count) {
            *at = (place){(value_kind)k, (int)(vr - group[k].base),
                          k == REPLAY ? replay_elements(f, vr) : 1};
            return FMU_OK;
        }
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

int refresh_outputs(fmu *f) {
    if (f->fresh) return FMU_OK;
    if (demand_initialized(f, "reading an output")) return FMU_ERROR;
    if (am_outputs(f->sim, f->y) != AM_OK) {
        return fmu_refuse(f, "outputs cannot be computed: %s", am_error(f->sim));
    }
    f->fresh = 1;
    return FMU_OK;
}

/* States and derivatives are fetched once per call of fmu_get: `there` tells which are. */
static int get_one(fmu *f, place at, int there[2], double *value) {
    int derivative = at.kind == DERIVATIVE;
    switch (at.kind) {
    case TIME:
        return *value = fmu_time(f), FMU_OK;
    case INPUT:
        return am_get_input(f->sim, at.i, value);
    case PARAMETER:
        return am_get_parameter(f->sim, at.i, value);
    case REPLAY:
        return replay_get(f, FMU_REPLAY_T + (uint32_t)at.i, value);
    case OUTPUT:
        if (refresh_outputs(f)) return FMU_ERROR;
        return *value = f->y[at.i], FMU_OK;
    default:
        if (!there[derivative]
            && (derivative ? fmu_get_derivatives(f, f->dx, f->states)
                           : fmu_get_states(f, f->x, f->states))) {
            return FMU_ERROR;
        }
        there[derivative] = 1;
        return *value = (derivative ? f->dx : f->x)[at.i], FMU_OK;
    }
}

int fmu_get(fmu *f, const uint32_t vr[], size_t n, double values[], size_t nvalues) {
    int there[2] = {0, 0};
    size_t left = nvalues;
    if (!f) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        place at;
        if (locate(f, vr[k], &at)) return FMU_ERROR;
        if (at.size > left) return refuse_count(f, n, nvalues);
        if (get_one(f, at, there, values)) return FMU_ERROR;
        values += at.size;
        left -= at.size;
    }
    return left ? refuse_count(f, n, nvalues) : FMU_OK;
}

/* A parameter acts between steps, or in event mode; one that acts at initialisation only before. */
static int check_settable(const fmu *f, place at) {
    const am_entry entry = entry_of(f, at);
    if (at.kind != INPUT && at.kind != PARAMETER
        && !(at.kind == REPLAY && at.i != FMU_REPLAY_Y - FMU_REPLAY_T)) {
        return fmu_refuse(f, "%s is computed by the model and cannot be set", entry.name);
    }
    if (at.kind == INPUT || f->phase <= FMU_INITIALIZING) return FMU_OK;
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

static int check_finite(const fmu *f, place at, const double values[]) {
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
        if (locate(f, vr[k], &at) || check_settable(f, at)) return FMU_ERROR;
        if (at.size > nvalues - done) return refuse_count(f, n, nvalues);
        if (check_finite(f, at, values + done)) return FMU_ERROR;
    }
    if (done != nvalues) return refuse_count(f, n, nvalues);
    for (k = 0; k < n; k++, values += at.size) {
        locate(f, vr[k], &at);
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
        if (locate(f, vr[k], &at)) return FMU_ERROR;
        if (!(entry_of(f, at).flags & AM_INTEGER)) {
            return fmu_refuse(f, "%s is no integer or enumeration; read and set it as a real",
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
        if (locate(f, vr[k], &at)) return FMU_ERROR;
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
