/* A whole record in one step: FMI 3.0 arrays replay.t, replay.u, replay.y whose length is the
 * structural parameter replay.n. */
#include "replay.h"

#include "guard.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_SAMPLES 10000000 /* more than a day at 100 Hz */

size_t replay_doubles(const fmu *f, uint64_t n) { return (size_t)n * (1 + f->inputs + f->outputs); }

static void place_arrays(const fmu *f, replay *r, uint64_t n, double *memory) {
    r->n = n;
    r->t = memory;
    r->u = memory + n;
    r->y = r->u + n * f->inputs;
}

int replay_resize(fmu *f, uint64_t n) {
    double *memory = calloc(replay_doubles(f, n), sizeof(double));
    if (!memory) {
        return fmu_refuse(f, "no memory for a replay of %llu samples", (unsigned long long)n);
    }
    free(f->replay.t);
    place_arrays(f, &f->replay, n, memory);
    for (uint64_t k = 0; k < n; k++) am_get_inputs(f->sim, f->replay.u + k * f->inputs);
    for (uint64_t k = 0; k < n * f->outputs; k++) f->replay.y[k] = NAN;
    f->replay.done = 0;
    return FMU_OK;
}

int replay_copy(const fmu *f, replay *to, const replay *from) {
    size_t bytes = replay_doubles(f, from->n) * sizeof(double);
    double *memory = to->t && to->n == from->n ? to->t : realloc(to->t, bytes);
    if (!memory) return fmu_refuse(f, "no memory for the arrays of a replay");
    memcpy(memory, from->t, bytes);
    place_arrays(f, to, from->n, memory);
    to->done = from->done;
    return FMU_OK;
}

int fmu_get_samples(fmu *f, const uint32_t vr[], size_t n, uint64_t counts[]) {
    if (!f) return FMU_ERROR;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != FMU_REPLAY_N) {
            return fmu_refuse(f, "replay.n is the only variable of this type");
        }
        counts[k] = f->replay.n;
    }
    return FMU_OK;
}

int fmu_set_samples(fmu *f, const uint32_t vr[], size_t n, const uint64_t counts[]) {
    if (demand(f, f && f->phase == FMU_CONFIGURING, "setting replay.n, a structural parameter,")) {
        return FMU_ERROR;
    }
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != FMU_REPLAY_N) {
            return fmu_refuse(f, "replay.n is the only variable of this type");
        }
        if (counts[k] < 1 || counts[k] > MOST_SAMPLES) {
            return fmu_refuse(f, "replay.n is %llu; give 1 (no replay) to %d samples",
                              (unsigned long long)counts[k], MOST_SAMPLES);
        }
        if (replay_resize(f, counts[k])) return FMU_ERROR;
    }
    return FMU_OK;
}

size_t replay_elements(const fmu *f, uint32_t vr) {
    const size_t width[] = {1, f->inputs, f->outputs};
    return (size_t)f->replay.n * width[vr - FMU_REPLAY_T];
}

void replay_get(const fmu *f, uint32_t vr, double values[]) {
    const double *from[] = {f->replay.t, f->replay.u, f->replay.y};
    memcpy(values, from[vr - FMU_REPLAY_T], replay_elements(f, vr) * sizeof(double));
}

void replay_set(fmu *f, uint32_t vr, const double values[]) {
    memcpy(vr == FMU_REPLAY_T ? f->replay.t : f->replay.u, values,
           replay_elements(f, vr) * sizeof(double));
    f->replay.done = 0;
}

int replay_waiting(const fmu *f) { return f->replay.n > 1 && !f->replay.done; }

static int differs(double a, double b) { return !(fabs(a - b) <= 1e-9 * (1.0 + fabs(b))); }

int replay_run(fmu *f, double t, double dt) {
    const replay *r = &f->replay;
    const double last = r->t[r->n - 1];
    size_t done = 0;
    for (uint64_t k = 1; k < r->n; k++) {
        if (!(r->t[k] > r->t[k - 1])) {
            return fmu_refuse(f, "replay.t does not rise after %.9g s (sample %llu)", r->t[k - 1],
                              (unsigned long long)k);
        }
    }
    if (differs(t, r->t[0]) || differs(t + dt, last)) {
        return fmu_refuse(
            f,
            "replay.t runs from %.9g s to %.9g s, the step from %.9g s to %.9g s; give one step "
            "for the whole record",
            r->t[0], last, t, t + dt);
    }
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = 0;
    f->replay.done = 1;
    if (am_run(f->sim, (size_t)r->n, r->t, r->u, 0, r->y, &done) == AM_OK) return FMU_OK;
    for (uint64_t k = done * f->outputs; k < r->n * f->outputs; k++) r->y[k] = NAN;
    f->phase = FMU_FAILED;
    return fmu_refuse(f, "replay failed after %lu samples: %s", (unsigned long)done,
                      am_error(f->sim));
}
