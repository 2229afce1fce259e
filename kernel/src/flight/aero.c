/* Coefficients and the implicit triple.
 *
 * alpha-dot, beta-dot and the load factor depend on the forces that depend on them.  All three are
 * affine in the force and the force is affine in them, so a 3 x 3 linear system gives them exactly:
 * no iteration, no delay by one step.  Terms that depend on coefficients follow once these are
 * summed, level by level; where such a term is a force, it and the system are solved by turns. */
#include "aero.h"

#include "algebra.h"
#include "look_up.h"
#include "separation.h"
#include "terms.h"

#include <math.h>
#include <string.h>

#define MOST_TURNS 50
#define AGREED 1e-15 /* of the coefficients from turn to turn, against one plus their sum */

/* CL, CD (stability axes) and CY (body axis) to body axes. */
static void lift_drag_to_body(const now_r *now, const real c[3], real f[3]) {
    f[0] = c[0] * now->sa - c[1] * now->ca;
    f[1] = c[2];
    f[2] = -c[0] * now->ca - c[1] * now->sa;
}

/* Force coefficients of the database to CL, CD (stability axes) and CY (body axis). */
static void to_lift_drag(const flight_t *sim, real c[3]) {
    const now_r *now = &sim->now;
    real f[3];
    if (sim->model->force_axes == STABILITY_AXES) return;
    if (sim->model->force_axes == BODY_AXES) {
        f[0] = c[0];
        f[1] = c[2];
        f[2] = c[1];
    } else {
        const real x = -c[1] * now->cb - c[2] * now->sb;
        f[0] = c[0] * now->sa + x * now->ca;
        f[1] = -c[1] * now->sb + c[2] * now->cb;
        f[2] = -c[0] * now->ca + x * now->sa;
    }
    c[0] = f[0] * now->sa - f[2] * now->ca;
    c[1] = -f[0] * now->ca - f[2] * now->sa;
    c[2] = f[1];
}

/* The coefficients as variables of terms: in the force axes of the database. */
static void know_coefficients(flight_t *sim, const real c[COEFFICIENTS]) {
    const now_r *now = &sim->now;
    real *var = sim->var;
    memcpy(var + A_CL, c, COEFFICIENTS * sizeof *c);
    if (sim->model->force_axes == WIND_AXES) {
        var[A_CD] = c[1] * now->cb - c[2] * now->sb;
        var[A_CY] = c[1] * now->sb + c[2] * now->cb;
    } else if (sim->model->force_axes == BODY_AXES) {
        real f[3];
        lift_drag_to_body(now, c, f);
        var[A_CX] = f[0];
        var[A_CZ] = f[2];
    }
}

/* The terms that depend on coefficients, one level after the other: each level finds those that
 * it needs complete. */
static void add_late(flight_t *sim, real c[COEFFICIENTS]) {
    const am_model *m = sim->model;
    for (uint32_t level = 0; level < m->levels; level++) {
        real found[COEFFICIENTS] = {0.0};
        know_coefficients(sim, c);
        look_up(sim, STAGE_LATE + (int)level);
        for (uint32_t k = m->first_late[level]; k < m->first_late[level + 1]; k++) {
            found[m->term[m->late[k]].target] += term_value(sim, m->late[k]);
        }
        to_lift_drag(sim, found);
        for (int k = 0; k < COEFFICIENTS; k++) c[k] += found[k];
    }
}

/* What alpha-dot (0) or beta-dot (1) takes from the acceleration of the air-relative velocity.
 * [rad/s per m/s2] */
static void flow_rate(const now_r *now, uint32_t kind, real row[3]) {
    const mask_t calm = now->Vxz < FLOW_FLOOR;
    row[0] = row[1] = row[2] = 0.0;
    if (EVERY(calm)) return;
    if (kind == 0) {
        row[0] = -now->sa * now->per_Vxz;
        row[2] = now->ca * now->per_Vxz;
    } else {
        row[0] = -now->ca * now->sb * now->per_V;
        row[1] = now->cb * now->per_V;
        row[2] = -now->sa * now->sb * now->per_V;
    }
    if (!ANY(calm)) return;
    for (int i = 0; i < 3; i++) row[i] = PICK(calm, 0.0, row[i]);
}

/* An implicit variable is apart + row . force / mass; returns apart. */
static real implicit_row(const flight_t *sim, uint32_t kind, const real free_fall[3], real row[3]) {
    const now_r *now = &sim->now;
    if (A_ALPHADOTHAT + kind == A_DNZ) {
        row[0] = row[1] = 0.0;
        row[2] = -1.0 / G0;
        return -1.0;
    }
    /* no rate below FLOW_FLOOR */
    const real half = 0.5 * (kind == 0 ? sim->model->cbar : sim->model->b) * now->per_V;
    flow_rate(now, kind, row);
    for (int i = 0; i < 3; i++) row[i] *= half;
    return dot(row, free_fall);
}

/* A row over forces to one over CL, CD, CY: the transpose of lift_drag_to_body. */
static void row_to_lift_drag(const now_r *now, const real row[3], real factor, real to[3]) {
    to[0] = factor * (row[0] * now->sa - row[2] * now->ca);
    to[1] = factor * (-row[0] * now->ca - row[2] * now->sa);
    to[2] = factor * row[1];
}

/* A x = x in place, without pivoting: A is the unit matrix minus small couplings. */
static inline void solve_couplings(real A[IMPLICIT][IMPLICIT], real x[IMPLICIT], uint32_t n) {
    real per[IMPLICIT];
    for (uint32_t k = 0; k < n; k++) {
        per[k] = 1.0 / A[k][k];
        for (uint32_t i = k + 1; i < n; i++) {
            const real factor = A[i][k] * per[k];
            for (uint32_t j = k; j < n; j++) A[i][j] -= factor * A[k][j];
            x[i] -= factor * x[k];
        }
    }
    for (uint32_t k = n; k-- > 0;) {
        for (uint32_t j = k + 1; j < n; j++) x[k] -= A[k][j] * x[j];
        x[k] *= per[k];
    }
}

/* What an evaluation of the forces starts from: dynamic pressure times wing area, and the forces
 * and accelerations of aero_forces. */
typedef struct {
    real qS, per_mass;
    const real *applied, *free_fall;
} flow_t;

/* Slopes of the coefficients over each implicit variable: its terms at the value one. */
static inline void find_slopes(flight_t *sim, real slope[IMPLICIT][COEFFICIENTS], uint32_t n) {
    const am_model *m = sim->model;
    for (uint32_t j = 0; j < n; j++) {
        sim->var[A_ALPHADOTHAT + m->unknown[j]] = 1.0;
        for (int k = 0; k < COEFFICIENTS; k++) slope[j][k] = 0.0;
    }
    for (const implicit_t *t = m->implicit, *end = t + m->implicits; t < end; t++) {
        real *to = slope[n == 1 ? 0 : t->place];
        to[t->target] += t->bare ? sim->scale[t->term] * sim->slot[t->T] : term_value(sim, t->term);
    }
    for (uint32_t j = 0; j < n; j++) to_lift_drag(sim, slope[j]);
}

/* Adds the implicit terms to the coefficients c; n is the number of unknowns.  What does not wait
 * for c comes first. */
__attribute__((always_inline)) static inline void add_implicit(flight_t *sim, const flow_t *flow,
                                                               real c[COEFFICIENTS], uint32_t n) {
    const am_model *m = sim->model;
    real slope[IMPLICIT][COEFFICIENTS], gain[IMPLICIT][3], A[IMPLICIT][IMPLICIT], x[IMPLICIT];
    find_slopes(sim, slope, n);
    /* x_i = apart_i + row_i . F / m and c = c_0 + slope x make (I - gain slope) x = apart + gain
     * c_0 */
    for (uint32_t i = 0; i < n; i++) {
        real row[3];
        x[i] = implicit_row(sim, m->unknown[i], flow->free_fall, row)
               + dot(row, flow->applied) * flow->per_mass;
        row_to_lift_drag(&sim->now, row, flow->qS * flow->per_mass, gain[i]);
        for (uint32_t j = 0; j < n; j++) A[i][j] = (double)(i == j) - dot(gain[i], slope[j]);
    }
    for (uint32_t i = 0; i < n; i++) x[i] += dot(gain[i], c);
    solve_couplings(A, x, n);
    for (uint32_t j = 0; j < n; j++) {
        sim->var[A_ALPHADOTHAT + m->unknown[j]] = x[j];
        for (int k = 0; k < COEFFICIENTS; k++) c[k] += slope[j][k] * x[j];
    }
}

/* The compiler unrolls each. */
static void solve_implicit(flight_t *sim, const flow_t *flow, real c[COEFFICIENTS]) {
    const uint32_t n = sim->model->unknowns;
    if (n == 1) add_implicit(sim, flow, c, 1);
    else if (n == 2) add_implicit(sim, flow, c, 2);
    else add_implicit(sim, flow, c, 3);
}

#if LANES == 1

/* Forces that depend on coefficients which in turn depend on the implicit variables: both are found
 * by turns.  What the coefficients add changes the implicit variables by a part of a thousandth
 * (the air that the aircraft displaces against its mass), so that each turn gives three digits
 * or more.  Without an end the coefficients are not finite, which stops the run. */
static void solve_by_turns(flight_t *sim, const flow_t *flow, real c[COEFFICIENTS]) {
    real added[3] = {0.0, 0.0, 0.0};
    real start[COEFFICIENTS], apart[COEFFICIENTS];
    memcpy(start, c, sizeof start);
    for (int turn = 0; turn < MOST_TURNS; turn++) {
        real change = 0.0;
        real size = 1.0;
        memcpy(apart, start, sizeof apart);
        for (int k = 0; k < 3; k++) apart[k] += added[k];
        solve_implicit(sim, flow, apart);
        for (int k = 0; k < 3; k++) apart[k] -= added[k];
        memcpy(c, apart, sizeof apart);
        add_late(sim, c);
        for (int k = 0; k < 3; k++) {
            const real now = c[k] - apart[k];
            change += fabs(now - added[k]);
            size += fabs(c[k]);
            added[k] = now;
        }
        if (change <= AGREED * size) return;
    }
    for (int k = 0; k < COEFFICIENTS; k++) c[k] = NAN;
}

#endif

/* What the implicit variables and the coefficients themselves add to the coefficients c. */
static void add_dependent(flight_t *sim, const flow_t *flow, real c[COEFFICIENTS]) {
    const am_model *m = sim->model;
#if LANES == 1 /* such a model flies alone: the number of turns is that of a run */
    if (m->unknowns && m->late_force) {
        solve_by_turns(sim, flow, c);
        return;
    }
#endif
    if (m->unknowns) solve_implicit(sim, flow, c);
    if (m->levels) add_late(sim, c);
}

/* alpha-dot and beta-dot from (u, v, w)' = F / m + free fall. */
static void find_flow_rates(now_r *now, const flow_t *flow) {
    real row[3];
    for (int i = 0; i < 3; i++) {
        now->acceleration[i] = now->F[i] * flow->per_mass + flow->free_fall[i];
    }
    flow_rate(now, 0, row);
    now->alpha_dot = dot(row, now->acceleration);
    flow_rate(now, 1, row);
    now->beta_dot = dot(row, now->acceleration);
}

/* Sets coefficients, force, aerodynamic moment about the reference point and the flow rates.
 * applied: the other forces but gravity (thrust, gear); free_fall: acceleration of the
 * air-relative velocity in body axes without any force but gravity. */
void aero_forces(flight_t *sim, real per_mass, const real applied[3], const real free_fall[3]) {
    const am_model *m = sim->model;
    now_r *now = &sim->now;
    const flow_t flow = {now->qbar * m->S, per_mass, applied, free_fall};
    real sum[COEFFICIENTS], c[COEFFICIENTS];
    /* coefficients: sum of the terms, to CL and CD, biases on top, then the implicit terms */
    evaluate_coefficients(sim, sum);
    to_lift_drag(sim, sum);
    for (int k = 0; k < COEFFICIENTS; k++) c[k] = sum[k] + sim->par[P_BIAS_CL + k];
    if (m->unknowns == 1 && !m->levels) {
        /* as most models are; their coefficients stay in registers */
        add_implicit(sim, &flow, c, 1);
    } else if (m->unknowns || m->levels) {
        memcpy(sum, c, sizeof sum);
        add_dependent(sim, &flow, sum);
        memcpy(c, sum, sizeof c);
    }
    memcpy(now->c, c, sizeof c);
    lift_drag_to_body(now, c, now->F);
    for (int i = 0; i < 3; i++) now->F[i] = flow.qS * now->F[i] + applied[i];
    /* the later slopes of a step need no rates of the flow angles, but for a separation */
    if (!sim->anchored || separates(sim)) find_flow_rates(now, &flow);
    /* M = qbar S (b Cl, cbar Cm, b Cn) about the reference point */
    now->M[0] = flow.qS * m->b * c[3];
    now->M[1] = flow.qS * m->cbar * c[4];
    now->M[2] = flow.qS * m->b * c[5];
}
