/* Stored states: all that moves in an instance, in memory or as bytes. */
#include "guard.h"
#include "image.h"
#include "replay.h"
#include "sha256.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct fmu_state {
    am_sim *sim;
    fmu_kind kind;
    fmu_phase phase;
    int initialized, moving;
    double start, time;
    replay replay;
    double slopes[];
};

/* Head of a serialised state; slopes, the arrays of the replay and the image of the simulation
 * follow. */
typedef struct {
    char token[64];  /* SHA-256 of the model */
    char digest[64]; /* SHA-256 of all that follows the digest */
    int32_t kind, phase, initialized, replayed, moving, unused;
    double start, time;
    uint64_t samples, layout;
} state_head;

#define PROTECTED offsetof(state_head, kind)

static fmu_state *new_state(const fmu *f) {
    fmu_state *state = calloc(1, sizeof *state + f->inputs * sizeof(double));
    if (state && !(state->sim = am_new(f->model))) fmu_free_state(&state);
    if (!state) fmu_refuse(f, "no memory for a state");
    return state;
}

void fmu_free_state(fmu_state **state) {
    if (!state || !*state) return;
    if ((*state)->sim) am_delete((*state)->sim);
    free((*state)->replay.t);
    free(*state);
    *state = NULL;
}

int fmu_get_state(fmu *f, fmu_state **state) {
    if (!f || !state) return fmu_refuse(f, "no place given for the state");
    if (!*state && !(*state = new_state(f))) return FMU_ERROR;
    fmu_state *to = *state;
    if (am_copy(to->sim, f->sim) != AM_OK) {
        return fmu_refuse(f, "the state belongs to another instance");
    }
    if (replay_copy(f, &to->replay, &f->replay)) return FMU_ERROR;
    to->kind = f->kind;
    to->phase = f->phase;
    to->initialized = f->initialized;
    to->start = f->start;
    to->time = f->time;
    to->moving = f->moving;
    memcpy(to->slopes, f->slopes, f->inputs * sizeof(double));
    return FMU_OK;
}

int fmu_set_state(fmu *f, const fmu_state *state) {
    if (!f || !state) return fmu_refuse(f, "no state given");
    if (state->kind != f->kind) {
        return fmu_refuse(
            f, "a state of co-simulation does not fit model exchange, nor the other way round");
    }
    if (am_copy(f->sim, state->sim) != AM_OK) {
        return fmu_refuse(f, "the state belongs to another instance");
    }
    if (replay_copy(f, &f->replay, &state->replay)) return FMU_ERROR;
    f->phase = state->phase;
    f->initialized = state->initialized;
    f->start = state->start;
    f->time = state->time;
    f->moving = state->moving;
    memcpy(f->slopes, state->slopes, f->inputs * sizeof(double));
    f->fresh = 0;
    return FMU_OK;
}

static size_t bytes_of(const fmu *f, uint64_t samples) {
    return sizeof(state_head) + (f->inputs + replay_doubles(f, samples)) * sizeof(double)
           + image_size(f->model);
}

static void digest_of(const void *image, size_t n, char digest[65]) {
    sha256_hex((const unsigned char *)image + PROTECTED, n - PROTECTED, digest);
}

int fmu_state_size(const fmu *f, const fmu_state *state, size_t *size) {
    if (!f || !state || !size) return fmu_refuse(f, "no state given");
    *size = bytes_of(f, state->replay.n);
    return FMU_OK;
}

int fmu_save_state(const fmu *f, const fmu_state *state, void *image, size_t n) {
    char digest[65];
    if (!f || !state || !image || n != bytes_of(f, state->replay.n)) {
        return fmu_refuse(f, "the buffer for the state is missing or of the wrong size");
    }
    state_head head = {.kind = (int32_t)state->kind,
                       .phase = (int32_t)state->phase,
                       .initialized = state->initialized,
                       .replayed = state->replay.done,
                       .moving = state->moving,
                       .start = state->start,
                       .time = state->time,
                       .samples = state->replay.n,
                       .layout = image_layout()};
    const size_t slopes = f->inputs * sizeof(double);
    const size_t arrays = replay_doubles(f, state->replay.n) * sizeof(double);
    unsigned char *to = (unsigned char *)image + sizeof head;
    memcpy(to, state->slopes, slopes);
    memcpy(to + slopes, state->replay.t, arrays);
    image_save(state->sim, to + slopes + arrays);
    memcpy(head.token, f->token, sizeof head.token);
    memcpy(image, &head, sizeof head);
    digest_of(image, n, digest);
    memcpy((unsigned char *)image + offsetof(state_head, digest), digest, sizeof head.digest);
    return FMU_OK;
}

static int check_image(const fmu *f, const void *image, size_t n, state_head *head) {
    char digest[65];
    if (n < sizeof *head) {
        return fmu_refuse(f, "these bytes are not a state of this model: wrong length");
    }
    memcpy(head, image, sizeof *head);
    if (memcmp(head->token, f->token, sizeof head->token) != 0) {
        return fmu_refuse(f, "these bytes are a state of another model");
    }
    if (head->samples < 1 || head->samples > n || n != bytes_of(f, head->samples)) {
        return fmu_refuse(f, "these bytes are not a state of this model: wrong length");
    }
    digest_of(image, n, digest);
    if (memcmp(head->digest, digest, sizeof head->digest) != 0) {
        return fmu_refuse(f, "these bytes are a damaged state: its SHA-256 does not agree");
    }
    if (head->layout != image_layout()) {
        return fmu_refuse(
            f, "these bytes are a state of another version of the kernel; simulate from the start");
    }
    if (head->phase < FMU_CREATED || head->phase > FMU_FAILED
        || (head->kind != FMU_MODEL_EXCHANGE && head->kind != FMU_CO_SIMULATION)) {
        return fmu_refuse(f, "these bytes are not a state of this model: unknown mode");
    }
    if (!isfinite(head->start) || !isfinite(head->time)) {
        return fmu_refuse(f, "these bytes are not a state of this model: time is not finite");
    }
    return FMU_OK;
}

int fmu_load_state(fmu *f, const void *image, size_t n, fmu_state **state) {
    state_head head;
    if (!f || !image || !state) return fmu_refuse(f, "no state given");
    if (check_image(f, image, n, &head)) return FMU_ERROR;
    const size_t slopes = f->inputs * sizeof(double);
    const size_t doubles = replay_doubles(f, head.samples);
    const unsigned char *from = (const unsigned char *)image + sizeof head;
    fmu_state *made = new_state(f);
    double *arrays = made ? malloc(doubles * sizeof(double)) : NULL;
    if (!arrays) {
        fmu_free_state(&made);
        return fmu_refuse(f, "no memory for a state");
    }
    memcpy(arrays, from + slopes, doubles * sizeof(double));
    const replay stored = {.n = head.samples, .t = arrays, .done = head.replayed};
    int status = replay_copy(f, &made->replay, &stored);
    free(arrays);
    if (status || image_restore(made->sim, from + slopes + doubles * sizeof(double))) {
        fmu_free_state(&made);
        return fmu_refuse(f, "these bytes are not a state of this model: values without meaning");
    }
    made->kind = (fmu_kind)head.kind;
    made->phase = (fmu_phase)head.phase;
    made->initialized = head.initialized != 0;
    made->start = head.start;
    made->time = head.time;
    made->moving = head.moving != 0;
    memcpy(made->slopes, from, slopes);
    fmu_free_state(state);
    *state = made;
    return FMU_OK;
}
