/* A whole record in one call. */
#include "access.h"

#include "error.h"
#include "integrate.h"
#include "terms.h"

#include <math.h>

static int sample(am_sim *sim, const int *output, size_t outputs, double *y, double *terms) {
    const int status = am_outputs(sim, output ? sim->y_work : y);
    if (status != AM_OK) return status;
    if (output) {
        for (size_t i = 0; i < outputs; i++) y[i] = sim->y_work[output[i]];
    }
    if (!terms) return AM_OK;
    contributions(sim, terms);
    return check_finite(sim, AM_TERM, terms);
}

int am_record(am_sim *sim, size_t n, const double *t, const double *u, int hold, const int *output,
              size_t outputs, double *y, double *terms, size_t *done) {
    const am_model *m = sim->model;
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t ny = output ? outputs : (size_t)m->count[AM_OUTPUT];
    *done = 0;
    for (size_t i = 0; output && i < outputs; i++) {
        if (output[i] < 0 || output[i] >= m->count[AM_OUTPUT]) {
            return fail(sim, AM_BAD_INDEX, "there is no output %d", output[i]);
        }
    }
    for (size_t k = 0; k < n; k++) {
        int status;
        if (k == 0) {
            if (!(fabs(t[0]) <= LATEST)) {
                return fail(sim, AM_BAD_ARGUMENT,
                            "the record starts at %g s; times must be finite and within 1e10 s",
                            t[0]);
            }
            sim->time = t[0];
            if ((status = check_inputs(sim, u)) == AM_OK) store_inputs(sim, u);
        } else {
            const double *u0 = u + (k - 1) * nu;
            status = am_step(sim, t[k - 1], t[k] - t[k - 1], u0, hold ? u0 : u0 + nu);
        }
        if (status == AM_OK) {
            status = sample(sim, output, outputs, y + k * ny, terms ? terms + k * m->terms : NULL);
        }
        if (status != AM_OK) return status;
        *done = k + 1;
    }
    return AM_OK;
}

int am_run(am_sim *sim, size_t n, const double *t, const double *u, int hold, double *y,
           size_t *done) {
    return am_record(sim, n, t, u, hold, NULL, 0, y, NULL, done);
}
