/* Failures of a simulation: status and text. */
#include "error.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

int fail(am_sim *sim, int status, const char *format, ...) {
    va_list list;
    va_start(list, format);
    vsnprintf(sim->text, sizeof sim->text, format, list);
    va_end(list);
    return status;
}

int bad_parameter(am_sim *sim, uint32_t parameter, const char *rule) {
    return fail(sim, AM_BAD_VALUE, "%s is %g; it must be %s",
                sim->model->entry[AM_PARAMETER][parameter].name, sim->par[parameter], rule);
}

int bad_value(am_sim *sim, const double *parameter, const char *rule) {
    return bad_parameter(sim, (uint32_t)(parameter - sim->par), rule);
}

int check_finite(am_sim *sim, am_kind kind, const double *values) {
    const am_model *m = sim->model;
    if (all_finite(values, (size_t)m->count[kind])) return AM_OK;
    int i = 0;
    while (isfinite(values[i])) i++;
    return fail(
        sim, AM_NOT_FINITE,
        "%s is not finite at t = %g s; the model has diverged, or its numbers have no meaning",
        m->entry[kind][i].name, sim->time);
}
