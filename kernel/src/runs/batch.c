/* Many runs of one record, each with its own parameters, as an estimation needs them. */
#include "error.h"

#include <stdio.h>

static int one_run(am_sim *sim, const am_batch_task *task, size_t run, size_t *done) {
    if (task->samples == 0) {
        return fail(sim, AM_BAD_ARGUMENT, "a batch needs a record of at least one sample");
    }
    const double *values = task->values + run * task->parameters;
    for (size_t i = 0; i < task->parameters; i++) {
        const int status = am_set_parameter(sim, task->parameter[i], values[i]);
        if (status != AM_OK) return status;
    }
    int status = am_set_inputs(sim, task->u);
    if (status == AM_OK) status = am_initialize(sim, task->t[0]);
    if (status != AM_OK) return status;
    return am_record(sim, task->samples, task->t, task->u, task->hold, task->output, task->outputs,
                     task->y + run * task->samples * task->outputs, NULL, done);
}

int am_batch(const am_sim *base, const am_batch_task *task, size_t first, size_t last, int *status,
             size_t *done, char (*text)[AM_TEXT]) {
    am_sim *sim = am_new(base->model);
    if (!sim) return AM_NOT_READY;
    for (size_t run = first; run < last; run++) {
        am_copy(sim, base);
        done[run] = 0;
        status[run] = one_run(sim, task, run, &done[run]);
        snprintf(text[run], AM_TEXT, "%s", status[run] == AM_OK ? "" : am_error(sim));
    }
    am_delete(sim);
    return AM_OK;
}
