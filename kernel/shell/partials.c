/* Partial derivatives of outputs and state rates over inputs and states: central differences of
 * the kernel's derivative, on a copy of the simulation, so that the instance stays as it is.
 *
 * Each input and state is moved by itself, by eps^(1/3) of its size, as flightmech.linearize does;
 * the error is about 1e-8 of an entry over a position, whose rounding is 1e-9 m, and 1e-10 over
 * the others.  Tables are piecewise linear: on a breakpoint the mean of both sides comes out. */
#include "guard.h"
#include "readiness.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GRAVITY 9.80665 /* weight per mass [m s-2] */

/* An input or a state; an output or a state rate by its place in a row. */
typedef struct {
    bool state;
    size_t i;
} known_t;

typedef struct {
    am_sim *sim;
    size_t inputs, states, outputs;
    double *u, *x, *up, *down; /* up, down: outputs, then state rates */
} probe;

static bool find_known(const fmu *f, uint32_t vr, known_t *to) {
    if (vr >= FMU_INPUTS && vr - FMU_INPUTS < f->inputs) *to = (known_t){false, vr - FMU_INPUTS};
    else if (vr >= FMU_STATES && vr - FMU_STATES < f->states) {
        *to = (known_t){true, vr - FMU_STATES};
    } else return false;
    return true;
}

static bool find_unknown(const fmu *f, uint32_t vr, size_t *at) {
    if (vr >= FMU_OUTPUTS && vr - FMU_OUTPUTS < f->outputs) *at = vr - FMU_OUTPUTS;
    else if (vr >= FMU_DERIVATIVES && vr - FMU_DERIVATIVES < f->states) {
        *at = f->outputs + vr - FMU_DERIVATIVES;
    } else return false;
    return true;
}

/* ---- steps ----------------------------------------------------------------------------------- */

static double mass_of(const fmu *f) {
    double mass = 1.0;
    am_get_parameter(f->sim, am_find(f->model, AM_PARAMETER, "mass.mass"), &mass);
    return mass;
}

/* Over which the rates change by their own size: 10 km of air for the position (state.x), 0.1 m
 * for a tyre or a control, 100 m/s, the weight and the mass of the aircraft, 1000 K. */
static double natural_size(const fmu *f, known_t known) {
    am_entry entry;
    am_entry_at(f->model, known.state ? AM_STATE : AM_INPUT, (int)known.i, &entry);
    if (strcmp(entry.units, "m") == 0) {
        const bool position = known.state && strchr(entry.name, '.') == strrchr(entry.name, '.');
        return position ? 1e4 : 0.1;
    }
    if (strcmp(entry.units, "m s-1") == 0) return 100.0;
    if (strcmp(entry.units, "N") == 0) return mass_of(f) * GRAVITY;
    if (strcmp(entry.units, "kg") == 0) return mass_of(f);
    return strcmp(entry.units, "K") == 0 ? 1e3 : 1.0;
}

/* ---- a copy of the simulation ---------------------------------------------------------------- */

static void close_probe(probe *p) {
    if (p->sim) am_delete(p->sim);
    free(p->u);
}

static bool open_probe(const fmu *f, probe *p) {
    const size_t row = f->outputs + f->states;
    *p = (probe){.inputs = f->inputs, .states = f->states, .outputs = f->outputs};
    p->sim = am_new(f->model);
    p->u = malloc((f->inputs + f->states + 2 * row + 1) * sizeof(double));
    if (!p->sim || !p->u || am_copy(p->sim, f->sim) != AM_OK) {
        close_probe(p);
        return false;
    }
    p->x = p->u + f->inputs;
    p->up = p->x + f->states;
    p->down = p->up + row;
    am_get_inputs(p->sim, p->u);
    am_get_state(p->sim, p->x);
    return true;
}

static int row_at(probe *p, double *row) {
    int status = am_set_inputs(p->sim, p->u);
    if (status == AM_OK) status = am_set_state(p->sim, p->x);
    if (status == AM_OK) status = am_outputs(p->sim, row);
    return status == AM_OK ? am_derivative(p->sim, p->x, p->u, row + p->outputs) : status;
}

/* The column of the Jacobian over one input or state, in p->up. */
static int find_column(const fmu *f, probe *p, known_t known) {
    static const double cube_root_of_eps = 6.0554544523933429e-6;
    double *moved = known.state ? &p->x[known.i] : &p->u[known.i];
    const double middle = *moved;
    const double step = cube_root_of_eps * natural_size(f, known);
    const double high = middle + step;
    const double low = middle - step;
    *moved = high;
    int status = row_at(p, p->up);
    *moved = low;
    if (status == AM_OK) status = row_at(p, p->down);
    *moved = middle;
    if (status == AM_NOT_FINITE) return FMU_DISCARD;
    if (status != AM_OK) {
        return fmu_refuse(f, "partial derivatives cannot be computed: %s", am_error(p->sim));
    }
    /* by the difference of what was represented */
    for (size_t i = 0; i < p->outputs + p->states; i++) {
        p->up[i] = (p->up[i] - p->down[i]) / (high - low);
    }
    return FMU_OK;
}

/* ---- the two products ------------------------------------------------------------------------ */

static int check_references(const fmu *f, const uint32_t unknowns[], size_t nu,
                            const uint32_t knowns[], size_t nk) {
    known_t known;
    size_t at;
    for (size_t k = 0; k < nu; k++) {
        if (!find_unknown(f, unknowns[k], &at)) {
            return fmu_refuse(
                f, "%lu is not an output or a state derivative; only they have partial derivatives",
                (unsigned long)unknowns[k]);
        }
    }
    for (size_t k = 0; k < nk; k++) {
        if (!find_known(f, knowns[k], &known)) {
            return fmu_refuse(
                f, "%lu is not an input or a state; partial derivatives are taken over them only",
                (unsigned long)knowns[k]);
        }
    }
    return FMU_OK;
}

static int open_checked(fmu *f, const uint32_t unknowns[], size_t nu, const uint32_t knowns[],
                        size_t nk, probe *p) {
    if (!f || demand_initialized(f, "reading partial derivatives")
        || check_references(f, unknowns, nu, knowns, nk)) {
        return FMU_ERROR;
    }
    return open_probe(f, p) ? FMU_OK : fmu_refuse(f, "no memory for partial derivatives");
}

int fmu_directional(fmu *f, const uint32_t unknowns[], size_t nu, const uint32_t knowns[],
                    size_t nk, const double seed[], double to[]) {
    probe p;
    int status = open_checked(f, unknowns, nu, knowns, nk, &p);
    if (status != FMU_OK) return status;
    for (size_t i = 0; i < nu; i++) to[i] = 0.0;
    for (size_t k = 0; k < nk && status == FMU_OK; k++) {
        known_t known;
        size_t at = 0;
        if (seed[k] == 0.0) continue;
        find_known(f, knowns[k], &known);
        status = find_column(f, &p, known);
        for (size_t i = 0; i < nu && status == FMU_OK; i++) {
            find_unknown(f, unknowns[i], &at);
            to[i] += p.up[at] * seed[k];
        }
    }
    close_probe(&p);
    return status;
}

int fmu_adjoint(fmu *f, const uint32_t unknowns[], size_t nu, const uint32_t knowns[], size_t nk,
                const double seed[], double to[]) {
    probe p;
    int status = open_checked(f, unknowns, nu, knowns, nk, &p);
    if (status != FMU_OK) return status;
    for (size_t k = 0; k < nk && status == FMU_OK; k++) {
        known_t known;
        size_t at = 0;
        find_known(f, knowns[k], &known);
        status = find_column(f, &p, known);
        to[k] = 0.0;
        for (size_t i = 0; i < nu && status == FMU_OK; i++) {
            find_unknown(f, unknowns[i], &at);
            to[k] += p.up[at] * seed[i];
        }
    }
    close_probe(&p);
    return status;
}
