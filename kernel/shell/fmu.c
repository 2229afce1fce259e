#include "fmu.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "image.h"
#include "resource.h"
#include "sha256.h"

struct fmu {
    am_model *model;
    am_sim *sim;
    size_t inputs, outputs, parameters;
    double *u0, *u1;   /* inputs at both ends of a step */
    double *slopes;    /* of the inputs, for the next step */
    double *y;         /* outputs, valid when fresh */
    double start;      /* [s] */
    int fresh;         /* y belongs to the present state, inputs and parameters */
    int initialized;   /* am_initialize has run on the present inputs and parameters */
    fmu_phase phase;
    char token[65];
    fmu_logger logger;
};

struct fmu_state {
    am_sim *sim;
    fmu_phase phase;
    int initialized;
    double start;
    double slopes[];
};

/* Head of a serialised state; slopes and the image of the simulation follow. */
typedef struct {
    char token[64];  /* SHA-256 of the model */
    char digest[64]; /* SHA-256 of what follows the head */
    int32_t phase, initialized;
    double start;
} state_head;

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

static const char *phase_name(fmu_phase phase) {
    static const char *const names[] = {"instantiated", "in initialization mode", "in step mode", "terminated", "stopped by an error"};
    return names[phase];
}

static int demand(const fmu *f, int allowed, const char *what) {
    if (!f) return FMU_ERROR;
    return allowed ? FMU_OK : fmu_refuse(f, "%s is not allowed while the instance is %s", what, phase_name(f->phase));
}

/* ---- life ----------------------------------------------------------------------------------------------------------- */

static int allocate(fmu *f) {
    f->inputs = (size_t)am_count(f->model, AM_INPUT);
    f->outputs = (size_t)am_count(f->model, AM_OUTPUT);
    f->parameters = (size_t)am_count(f->model, AM_PARAMETER);
    f->sim = am_new(f->model);
    f->u0 = calloc(3 * f->inputs + f->outputs + 1, sizeof(double));
    if (!f->sim || !f->u0) return FMU_ERROR;
    f->u1 = f->u0 + f->inputs;
    f->slopes = f->u1 + f->inputs;
    f->y = f->slopes + f->inputs;
    return FMU_OK;
}

static am_model *load(const char *resources, const char *token, char digest[65], char *text, size_t ntext) {
    char path[4096];
    const char *why;
    size_t n = resources ? strlen(resources) : 0, size = 0;
    int ended = n && (resources[n - 1] == '/' || resources[n - 1] == '\\');
    if (!n || snprintf(path, sizeof path, "%s%smodel.bin", resources, ended ? "" : "/") >= (int)sizeof path) {
        snprintf(text, ntext, "the folder of the resources is missing or too long; give the unpacked FMU's resources folder");
        return NULL;
    }
    unsigned char *bytes = resource_read(path, &size, &why);
    if (!bytes) {
        snprintf(text, ntext, "%.800s: %s; unpack the whole FMU before it is instantiated", path, why);
        return NULL;
    }
    sha256_hex(bytes, size, digest);
    am_model *model = am_load(bytes, size, text, ntext);
    free(bytes);
    if (model && (!token || strcmp(token, digest) != 0)) {
        snprintf(text, ntext, "token %.80s does not belong to model.bin, whose SHA-256 is %s; the FMU is mixed from two, write it anew",
                 token ? token : "(none)", digest);
        am_free(model);
        model = NULL;
    }
    return model;
}

fmu *fmu_open(const char *resources, const char *token, const fmu_logger *logger) {
    char text[1024] = "no memory";
    fmu *f = calloc(1, sizeof *f);
    if (f) {
        f->logger = *logger;
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
    free(f);
}

int fmu_reset(fmu *f) {
    if (!f) return FMU_ERROR;
    am_sim *sim = am_new(f->model);
    if (!sim) return fmu_refuse(f, "no memory for a reset");
    am_delete(f->sim);
    f->sim = sim;
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = f->initialized = 0;
    f->start = 0.0;
    f->phase = FMU_CREATED;
    return FMU_OK;
}

/* ---- initialisation and steps --------------------------------------------------------------------------------------- */

static int initialize(fmu *f) {
    f->fresh = 0;
    if (am_initialize(f->sim, f->start) != AM_OK) return fmu_refuse(f, "initialisation failed: %s", am_error(f->sim));
    f->initialized = 1;
    return FMU_OK;
}

int fmu_set_start(fmu *f, double start) {
    if (demand(f, f && f->phase == FMU_CREATED, "setting the start time")) return FMU_ERROR;
    if (!isfinite(start)) return fmu_refuse(f, "start time is %g; give a finite time in seconds", start);
    f->start = start;
    return FMU_OK;
}

int fmu_begin_initialization(fmu *f) {
    if (demand(f, f && f->phase == FMU_CREATED, "entering initialization mode")) return FMU_ERROR;
    f->phase = FMU_INITIALIZING;
    f->initialized = 0;
    return FMU_OK;
}

int fmu_end_initialization(fmu *f) {
    if (demand(f, f && f->phase == FMU_INITIALIZING, "leaving initialization mode")) return FMU_ERROR;
    int status = f->initialized ? FMU_OK : initialize(f);
    f->phase = status == FMU_OK ? FMU_STEPPING : FMU_FAILED;
    return status;
}

int fmu_step(fmu *f, double t, double dt) {
    if (demand(f, f && f->phase == FMU_STEPPING, "a step")) return FMU_ERROR;
    double now = am_time(f->sim);
    if (!(fabs(t - now) <= 1e-9 * (1.0 + fabs(now)))) /* the importer's clock may differ by rounding only */
        return fmu_refuse(f, "step from t = %.9g s, but the instance stands at %.9g s; step on from there, or set a stored state", t, now);
    if (!(dt > 0.0) || !isfinite(dt)) return fmu_refuse(f, "step size is %g s; give a positive, finite step", dt);
    am_get_inputs(f->sim, f->u0);
    for (size_t i = 0; i < f->inputs; i++) f->u1[i] = f->u0[i] + f->slopes[i] * dt;
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = 0;
    if (am_step(f->sim, t, dt, f->u0, f->u1) == AM_OK) return FMU_OK;
    f->phase = FMU_FAILED;
    return fmu_refuse(f, "step from t = %.9g s to %.9g s failed: %s", t, t + dt, am_error(f->sim));
}

int fmu_stop(fmu *f) {
    if (demand(f, f && (f->phase == FMU_STEPPING || f->phase == FMU_FAILED), "terminating")) return FMU_ERROR;
    f->phase = FMU_STOPPED;
    return FMU_OK;
}

double fmu_time(const fmu *f) { return am_time(f->sim); }

/* ---- values --------------------------------------------------------------------------------------------------------- */

static int find(const fmu *f, uint32_t vr, am_kind *kind, int *i) {
    if (vr >= FMU_PARAMETERS && vr - FMU_PARAMETERS < f->parameters) return *kind = AM_PARAMETER, *i = (int)(vr - FMU_PARAMETERS), 1;
    if (vr >= FMU_OUTPUTS && vr - FMU_OUTPUTS < f->outputs) return *kind = AM_OUTPUT, *i = (int)(vr - FMU_OUTPUTS), 1;
    if (vr >= FMU_INPUTS && vr - FMU_INPUTS < f->inputs) return *kind = AM_INPUT, *i = (int)(vr - FMU_INPUTS), 1;
    return 0;
}

static const char *name_of(const fmu *f, am_kind kind, int i) {
    am_entry entry;
    return am_entry_at(f->model, kind, i, &entry) == AM_OK ? entry.name : "?";
}

static int refresh(fmu *f) {
    if (f->fresh) return FMU_OK;
    if (demand(f, f->phase != FMU_CREATED, "reading an output")) return FMU_ERROR;
    if (f->phase == FMU_INITIALIZING && !f->initialized && initialize(f)) return FMU_ERROR;
    if (am_outputs(f->sim, f->y) != AM_OK) return fmu_refuse(f, "outputs cannot be computed: %s", am_error(f->sim));
    f->fresh = 1;
    return FMU_OK;
}

int fmu_get(fmu *f, const uint32_t vr[], size_t n, double values[]) {
    if (!f) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        am_kind kind;
        int i;
        if (vr[k] == FMU_TIME) {
            values[k] = f->initialized ? am_time(f->sim) : f->start;
        } else if (!find(f, vr[k], &kind, &i)) {
            return fmu_refuse(f, "no variable has the value reference %lu; modelDescription.xml lists them", (unsigned long)vr[k]);
        } else if (kind == AM_OUTPUT) {
            if (refresh(f)) return FMU_ERROR;
            values[k] = f->y[i];
        } else if ((kind == AM_INPUT ? am_get_input : am_get_parameter)(f->sim, i, &values[k]) != AM_OK) {
            return fmu_refuse(f, "%s", am_error(f->sim));
        }
    }
    return FMU_OK;
}

static int may_set(const fmu *f, am_kind kind, int i) {
    am_entry entry;
    if (kind == AM_OUTPUT) return fmu_refuse(f, "%s is an output and cannot be set", name_of(f, kind, i));
    if (kind == AM_INPUT || f->phase != FMU_STEPPING) return FMU_OK;
    if (am_entry_at(f->model, kind, i, &entry) == AM_OK && entry.flags & AM_FIXED)
        return fmu_refuse(f, "%s acts at initialisation only; set it before the end of initialization mode, or reset", entry.name);
    return FMU_OK;
}

int fmu_set(fmu *f, const uint32_t vr[], size_t n, const double values[]) {
    if (demand(f, f && f->phase <= FMU_STEPPING, "setting a variable")) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        am_kind kind;
        int i;
        if (!find(f, vr[k], &kind, &i))
            return fmu_refuse(f, "no variable with the value reference %lu can be set", (unsigned long)vr[k]);
        if (may_set(f, kind, i)) return FMU_ERROR;
        if ((kind == AM_INPUT ? am_set_input : am_set_parameter)(f->sim, i, values[k]) != AM_OK)
            return fmu_refuse(f, "%s", am_error(f->sim));
        f->fresh = 0;
        if (f->phase != FMU_STEPPING) f->initialized = 0;
    }
    return FMU_OK;
}

int fmu_check_integers(const fmu *f, const uint32_t vr[], size_t n) {
    if (!f) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        am_kind kind;
        am_entry entry;
        int i;
        if (!find(f, vr[k], &kind, &i) || am_entry_at(f->model, kind, i, &entry) != AM_OK || !(entry.flags & AM_INTEGER))
            return fmu_refuse(f, "value reference %lu is not an enumeration; read and set it as a real", (unsigned long)vr[k]);
    }
    return FMU_OK;
}

int fmu_set_slopes(fmu *f, const uint32_t vr[], size_t n, const double slopes[]) {
    if (demand(f, f && f->phase <= FMU_STEPPING, "setting the derivative of an input")) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        am_kind kind;
        int i;
        if (!find(f, vr[k], &kind, &i) || kind != AM_INPUT)
            return fmu_refuse(f, "value reference %lu is not an input; only inputs take derivatives", (unsigned long)vr[k]);
        if (!isfinite(slopes[k])) return fmu_refuse(f, "derivative of %s is %g; give a finite value", name_of(f, kind, i), slopes[k]);
        f->slopes[i] = slopes[k];
    }
    return FMU_OK;
}

/* ---- stored states -------------------------------------------------------------------------------------------------- */

static fmu_state *new_state(const fmu *f) {
    fmu_state *state = calloc(1, sizeof *state + f->inputs * sizeof(double));
    if (state && !(state->sim = am_new(f->model))) fmu_free_state(&state);
    return state;
}

void fmu_free_state(fmu_state **state) {
    if (!state || !*state) return;
    if ((*state)->sim) am_delete((*state)->sim);
    free(*state);
    *state = NULL;
}

int fmu_take_state(fmu *f, fmu_state **state) {
    if (!f || !state) return fmu_refuse(f, "no place given for the state");
    if (!*state) *state = new_state(f);
    if (!*state) return fmu_refuse(f, "no memory for a state");
    if (am_copy((*state)->sim, f->sim) != AM_OK) return fmu_refuse(f, "the state belongs to another instance");
    (*state)->phase = f->phase;
    (*state)->initialized = f->initialized;
    (*state)->start = f->start;
    memcpy((*state)->slopes, f->slopes, f->inputs * sizeof(double));
    return FMU_OK;
}

int fmu_put_state(fmu *f, const fmu_state *state) {
    if (!f || !state) return fmu_refuse(f, "no state given");
    if (am_copy(f->sim, state->sim) != AM_OK) return fmu_refuse(f, "the state belongs to another instance");
    f->phase = state->phase;
    f->initialized = state->initialized;
    f->start = state->start;
    memcpy(f->slopes, state->slopes, f->inputs * sizeof(double));
    f->fresh = 0;
    return FMU_OK;
}

static size_t payload(const fmu *f) { return f->inputs * sizeof(double) + image_size(f->model); }

size_t fmu_image_size(const fmu *f) { return sizeof(state_head) + payload(f); }

int fmu_save_state(const fmu *f, const fmu_state *state, void *image, size_t n) {
    char digest[65];
    if (!f || !state || !image || n < fmu_image_size(f)) return fmu_refuse(f, "the buffer for the state is missing or too small");
    state_head head = {.phase = (int32_t)state->phase, .initialized = state->initialized, .start = state->start};
    unsigned char *to = (unsigned char *)image + sizeof head;
    memcpy(to, state->slopes, f->inputs * sizeof(double));
    image_save(state->sim, to + f->inputs * sizeof(double));
    sha256_hex(to, payload(f), digest);
    memcpy(head.token, f->token, sizeof head.token);
    memcpy(head.digest, digest, sizeof head.digest);
    memcpy(image, &head, sizeof head);
    return FMU_OK;
}

int fmu_load_state(fmu *f, const void *image, size_t n, fmu_state **state) {
    state_head head;
    char digest[65];
    if (!f || !image || !state || n != fmu_image_size(f)) return fmu_refuse(f, "these bytes are no state of this model: wrong length");
    const unsigned char *from = (const unsigned char *)image + sizeof head;
    memcpy(&head, image, sizeof head);
    sha256_hex(from, payload(f), digest);
    if (memcmp(head.token, f->token, sizeof head.token) != 0) return fmu_refuse(f, "these bytes are a state of another model");
    if (memcmp(head.digest, digest, sizeof head.digest) != 0 || head.phase < FMU_CREATED || head.phase > FMU_FAILED)
        return fmu_refuse(f, "these bytes are a damaged state: its SHA-256 does not agree");
    if (!*state) *state = new_state(f);
    if (!*state) return fmu_refuse(f, "no memory for a state");
    (*state)->phase = (fmu_phase)head.phase;
    (*state)->initialized = head.initialized;
    (*state)->start = head.start;
    memcpy((*state)->slopes, from, f->inputs * sizeof(double));
    image_restore((*state)->sim, from + f->inputs * sizeof(double));
    return FMU_OK;
}
