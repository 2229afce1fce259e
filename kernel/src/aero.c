/* Sum of terms to six coefficients, and the implicit triple.
 *
 * alpha-dot, beta-dot and the load factor depend on the forces that depend on them.  All three are affine in the force
 * and the force is affine in them, so a 3 x 3 linear system gives them exactly: no iteration, no delay by one step. */
#include "model.h"

#include <string.h>

static double term_value(const am_sim *sim, uint32_t i) {
    const term_t *t = &sim->model->term[i];
    return sim->scale[i] * sim->slot[t->K1] * sim->slot[t->K2] * sim->slot[t->T] * sim->var[t->v1] * sim->var[t->v2];
}

void evaluate_terms(am_sim *sim, int group) {
    for (uint32_t i = sim->model->first_term[group]; i < sim->model->first_term[group + 1]; i++) sim->term[i] = term_value(sim, i);
}

void sum_coefficients(const am_model *model, const double *term, double c[COEFFICIENTS]) {
    for (int k = 0; k < COEFFICIENTS; k++) {
        c[k] = 0.0;
        for (uint32_t i = model->first_of[k]; i < model->first_of[k + 1]; i++) c[k] += term[i];
    }
}

static void set_implicit(am_sim *sim, double x0, double x1, double x2) {
    sim->var[A_ALPHADOTHAT] = x0, sim->var[A_BETADOTHAT] = x1, sim->var[A_DNZ] = x2;
}

/* Force coefficients of the database to CL, CD (stability axes) and CY (body axis). */
static void to_house(const am_sim *sim, double c[3]) {
    if (sim->model->force_axes == STABILITY_AXES) return;
    double A[3][3], S[3][3], force[3];
    force_directions(&sim->now, sim->model->force_axes, A);
    force_directions(&sim->now, STABILITY_AXES, S);
    to_body(A, c, force);
    from_body(S, force, c);
}

/* Rows: what alpha_dot, beta_dot (rad/s per m/s2) take from the acceleration of the air-relative velocity. */
static void flow_rates(const now_t *now, double row[2][3]) {
    memset(row, 0, 6 * sizeof row[0][0]);
    if (now->Vxz < FLOW_FLOOR) return;
    row[0][0] = -now->sa / now->Vxz, row[0][2] = now->ca / now->Vxz;
    row[1][0] = -now->ca * now->sb / now->V, row[1][1] = now->cb / now->V, row[1][2] = -now->sa * now->sb / now->V;
}

/* x = d + M x by Cramer's rule on the rows of I - M. */
static void solve3(double M[3][3], const double d[3], double x[3]) {
    double R[3][3], n0[3], n1[3], n2[3];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) R[i][j] = (i == j) - M[i][j];
    cross(R[1], R[2], n0), cross(R[2], R[0], n1), cross(R[0], R[1], n2);
    const double det = dot(R[0], n0);
    for (int i = 0; i < 3; i++) x[i] = (d[0] * n0[i] + d[1] * n1[i] + d[2] * n2[i]) / det;
}

/* Adds the implicit terms to the coefficients c; force is the total force without them. */
static void close_loop(am_sim *sim, const double force[3], const double free_fall[3], double S[3][3], double c[COEFFICIENTS]) {
    const am_model *m = sim->model;
    const now_t *now = &sim->now;
    const double V = now->V > V_FLOOR ? now->V : V_FLOOR, mass = sim->par[P_MASS], qS = now->qbar * m->S;
    double slope[IMPLICIT][COEFFICIENTS] = {{0.0}}, row[IMPLICIT][3] = {{0.0}}, M[3][3], d[3], x[3];
    set_implicit(sim, 1.0, 1.0, 1.0);
    for (uint32_t i = 0; i < m->implicits; i++) slope[m->implicit[i][1]][m->term[m->implicit[i][0]].coefficient] += term_value(sim, m->implicit[i][0]);
    flow_rates(now, row);
    for (int k = 0; k < 3; k++) {
        row[0][k] *= 0.5 * m->cbar / V;
        row[1][k] *= 0.5 * m->b / V;
    }
    row[2][2] = -1.0 / G0;
    const double apart[3] = {dot(row[0], free_fall), dot(row[1], free_fall), -1.0};
    for (int j = 0; j < IMPLICIT; j++) {
        double push[3];
        to_house(sim, slope[j]);
        to_body(S, slope[j], push);
        for (int i = 0; i < IMPLICIT; i++) M[i][j] = dot(row[i], push) * qS / mass;
        d[j] = apart[j] + dot(row[j], force) / mass;
    }
    solve3(M, d, x);
    set_implicit(sim, x[0], x[1], x[2]);
    for (uint32_t i = 0; i < m->implicits; i++) sim->term[m->implicit[i][0]] = term_value(sim, m->implicit[i][0]);
    for (int k = 0; k < COEFFICIENTS; k++) c[k] += slope[0][k] * x[0] + slope[1][k] * x[1] + slope[2][k] * x[2];
}

static void forces_of(const am_sim *sim, double S[3][3], const double c[COEFFICIENTS], const double thrust_force[3], double F[3]) {
    const double qS = sim->now.qbar * sim->model->S;
    to_body(S, c, F);
    for (int i = 0; i < 3; i++) F[i] = qS * F[i] + thrust_force[i];
}

/* Sets coefficients, force, aerodynamic moment about the reference point and the flow rates.
 * free_fall: acceleration of the air-relative velocity in body axes without any force but gravity. */
void aero_forces(am_sim *sim, const double thrust_force[3], const double free_fall[3]) {
    const am_model *m = sim->model;
    now_t *now = &sim->now;
    double S[3][3], row[2][3], a[3];
    force_directions(now, STABILITY_AXES, S);
    set_implicit(sim, 0.0, 0.0, 0.0);
    look_up(sim, AERO_GROUP);
    evaluate_terms(sim, AERO_GROUP);
    sum_coefficients(m, sim->term, now->c);
    to_house(sim, now->c);
    for (int k = 0; k < COEFFICIENTS; k++) now->c[k] += sim->par[P_BIAS_CL + k];
    forces_of(sim, S, now->c, thrust_force, now->F);
    if (m->implicits) {
        close_loop(sim, now->F, free_fall, S, now->c);
        forces_of(sim, S, now->c, thrust_force, now->F);
    }
    flow_rates(now, row);
    for (int i = 0; i < 3; i++) a[i] = now->F[i] / sim->par[P_MASS] + free_fall[i];
    memcpy(now->acceleration, a, sizeof a);
    now->alpha_dot = dot(row[0], a);
    now->beta_dot = dot(row[1], a);
    const double qS = now->qbar * m->S;
    now->M[0] = qS * m->b * now->c[3], now->M[1] = qS * m->cbar * now->c[4], now->M[2] = qS * m->b * now->c[5];
}
