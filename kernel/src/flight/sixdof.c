/* Equations of motion of a rigid aircraft over a rotating ellipsoid or a flat Earth.
 *
 *     r' = v                                    Earth-fixed axes
 *     v' = C^T F / m + g(r) - 2 W x v - W x (W x r)
 *     q' = 1/2 q * (w - C W) + (1 - |q|^2) q    quaternion Earth to body, of constant length
 *     w' = J^-1 (M - w x (J w + H))             body rates to inertial space, H of the rotors
 *
 * F and M of the air, the engines and the ground; the discrete part of the submodels stands
 * still in a derivative.
 *
 * Wind is steady in Earth axes for alpha-dot and beta-dot: the rate of a gust is not in them. */
#include "sixdof.h"

#include "aero.h"
#include "air_data.h"
#include "algebra.h"
#include "axes.h"
#include "earth.h"
#include "elementary_real.h"
#include "parts.h"
#include "separation.h"
#include "terms.h"

static void set_variables(flight_t *sim, const real *x, const real *u) {
    const am_model *m = sim->model;
    const now_r *now = &sim->now;
    const real per_V = PICK(now->V > V_FLOOR, now->per_V, 1.0 / V_FLOOR);
    const real span = 0.5 * m->b * per_V;
    const real chord = 0.5 * m->cbar * per_V;
    real *var = sim->var;
    real below[3];
    /* the reference point lies above the c.g. by this much along down */
    from_body(now->C, now->cg, below);
    var[A_ALPHA] = now->alpha;
    var[A_BETA] = now->beta;
    var[A_MACH] = now->mach;
    var[A_H] = now->h;
    var[A_H_AGL] = now->h + dot(below, now->down) - sim->par[P_RUNWAY];
    var[A_V] = now->V;
    var[A_QBAR] = now->qbar;
    /* as gyros show them, which flight-test data reduction uses, or relative to the Earth and
     * its air */
    const real *rate = ANY(sim->par[P_RATES] == RATES_OF_EARTH) ? now->rate : x + X_P;
    const real p = rate[0] - now->gust_rate[0];
    const real q = rate[1] - now->gust_rate[1];
    const real r = rate[2] - now->gust_rate[2];
    var[A_PHAT] = p * span;
    var[A_QHAT] = q * chord;
    var[A_RHAT] = r * span;
    var[A_P] = p;
    var[A_Q] = q;
    var[A_R] = r;
    for (int i = 0; i <= U_DELTA_D; i++) var[A_DELTA_E + i] = applied(sim, u, i);
    var[A_GEAR] = u[U_GEAR];
    var[A_SPEEDBRAKE] = u[U_SPEEDBRAKE];
    for (uint32_t i = 0; i < items(m, G_DEVICE); i++) {
        var[place(m, AM_VARIABLE, G_DEVICE, i) + A_DEVICE] =
            u[place(m, AM_INPUT, G_DEVICE, i) + U_DEVICE];
    }
    var[A_X_CG] = m->x_ref_mac - now->cg[0] / m->cbar;
    if (m->uses_phi) var[A_PHI] = ATAN2(dot(now->C[1], now->down), dot(now->C[2], now->down));
}

/* Air, attitude, motion relative to the air, mass and the variables of the tables from the
 * state. */
void set_flight_condition(flight_t *sim, const real *x, const real *u) {
    now_r *now = &sim->now;
    real air[3], velocity[3], wind[3];
    if (sim->anchored) place_near(x, sim->earth, &sim->anchor, now);
    else place_of(x, sim->earth, now);
    const anchor_r *anchor = sim->anchored ? &sim->anchor : NULL;
    atmosphere_at(&sim->atmosphere, anchor, now->h, &now->T, &now->p, &now->rho, &now->a);
    quaternion_matrix(x + X_Q0, now->C);
    HOOK(wind_of)(sim, u, wind);
    const mask_t calm = (wind[0] == 0.0) & (wind[1] == 0.0) & (wind[2] == 0.0);
    for (int i = 0; i < 3; i++) air[i] = x[X_VX + i];
    /* in calm air the velocity need not wait for the axes */
    for (int i = 0; i < 3 && !EVERY(calm); i++) {
        air[i] -= wind[0] * now->north[i] + wind[1] * now->east[i] + wind[2] * now->down[i];
    }
    to_body(now->C, air, velocity);
    air_data(now, anchor, velocity);
    for (int i = 0; i < 3; i++) now->rate[i] = x[X_P + i] - now->C[i][2] * sim->omega;
    mass_now(sim, x);
    set_variables(sim, x, u);
}

void keep_anchor(flight_t *sim, const real *x) {
    set_anchor(x, sim->earth, &sim->now, &sim->anchor);
    anchor_air(&sim->now, &sim->anchor);
    anchor_power(sim);
}

static void quaternion_rate(const real q[4], const real w[3], real dq[4]) {
    const real pull = 1.0 - (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    dq[0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]) + pull * q[0];
    dq[1] = 0.5 * (q[0] * w[0] - q[3] * w[1] + q[2] * w[2]) + pull * q[1];
    dq[2] = 0.5 * (q[3] * w[0] + q[0] * w[1] - q[1] * w[2]) + pull * q[2];
    dq[3] = 0.5 * (-q[2] * w[0] + q[1] * w[1] + q[0] * w[2]) + pull * q[3];
}

/* Gravitation, Coriolis and centrifugal acceleration in Earth axes. */
static void field(const flight_t *sim, const real *x, real g[3]) {
    const double W = sim->omega;
    gravitation(x, sim->earth, g);
    g[0] += 2.0 * W * x[4] + W * W * x[0];
    g[1] += -2.0 * W * x[3] + W * W * x[1];
}

static void set_thrust_coefficient(flight_t *sim) {
    const real qbar = PICK(sim->now.qbar > QBAR_FLOOR, sim->now.qbar, QBAR_FLOOR);
    real thrust = 0.0;
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) thrust += sim->now.thrust[i];
    sim->var[A_CT] = thrust / (qbar * sim->model->S);
}

void derivative(flight_t *sim, const real *x, const real *u, real *dx) {
    now_r *now = &sim->now;
    const real *w = x + X_P;
    real g[3], fall[3], turn[3], push[3], moment[3], H[3], ground[3], ground_moment[3], aero[3],
        arm[3], Jw[3];
    set_flight_condition(sim, x, u);
    const real per_mass = 1.0 / now->mass;
    /* force and moment of engines and gear; tables of the gear may use the thrust */
    engine_forces(sim, x, u, push, moment, H, dx);
    set_thrust_coefficient(sim);
    gear_forces(sim, x, u, ground, ground_moment, dx);
    if (separates(sim)) separation_variables(sim, x);
    for (int i = 0; i < 3; i++) {
        push[i] += ground[i];
        moment[i] += ground_moment[i];
    }
    /* velocity rate relative to the air without any force: C g - (w - C W) x v */
    field(sim, x, g);
    const real velocity[3] = {now->u, now->v, now->w};
    to_body(now->C, g, fall);
    cross(now->rate, velocity, turn);
    for (int i = 0; i < 3; i++) fall[i] -= turn[i];
    /* the force acts at the reference point: its moment about the c.g. is -cg x F */
    aero_forces(sim, per_mass, push, fall);
    for (int i = 0; i < 3; i++) aero[i] = now->F[i] - push[i];
    cross(aero, now->cg, arm);
    to_body(now->J, w, Jw);
    for (int i = 0; i < 3; i++) {
        now->M[i] += arm[i] + moment[i];
        Jw[i] += H[i];
    }
    /* w' = J^-1 (M + (J w + H) x w) */
    cross(Jw, w, turn);
    for (int i = 0; i < 3; i++) turn[i] += now->M[i];
    to_body(now->J_inverse, turn, now->angular);
    /* v' = C^T F / m + g */
    from_body(now->C, now->F, push);
    for (int i = 0; i < 3; i++) {
        dx[X_X + i] = x[X_VX + i];
        dx[X_VX + i] = push[i] * per_mass + g[i];
        dx[X_P + i] = now->angular[i];
    }
    quaternion_rate(x + X_Q0, now->rate, dx + X_Q0);
    if (separates(sim)) separation_rates(sim, x, dx);
}
