/* Equations of motion of a rigid aircraft over a rotating ellipsoid or a flat Earth; outputs.
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
#include "elementary.h"
#include "model.h"

#include <math.h>
#include <string.h>

double applied(const am_sim *sim, const double *u, int control) {
    const bool flown = control <= U_DELTA_R;
    const bool biased = control <= U_DELTA_D;
    const double deflection = flown && sim->controls != SURFACE_DRIVEN
                                  ? control_deflection(sim, u, control)
                                  : u[control];
    return deflection + (biased ? sim->par[P_BIAS_DELTA_E + control] : 0.0)
           + (flown ? sim->trim.delta[control] : 0.0);
}

static void set_variables(am_sim *sim, const double *x, const double *u) {
    const am_model *m = sim->model;
    const now_t *now = &sim->now;
    const double per_V = now->V > V_FLOOR ? now->per_V : 1.0 / V_FLOOR;
    const double span = 0.5 * m->b * per_V;
    const double chord = 0.5 * m->cbar * per_V;
    double *var = sim->var;
    double below[3];
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
    const double *rate = sim->par[P_RATES] == RATES_OF_EARTH ? now->rate : x + X_P;
    const double p = rate[0] - now->gust_rate[0];
    const double q = rate[1] - now->gust_rate[1];
    const double r = rate[2] - now->gust_rate[2];
    var[A_PHAT] = p * span;
    var[A_QHAT] = q * chord;
    var[A_RHAT] = r * span;
    var[A_P] = p;
    var[A_Q] = q;
    var[A_R] = r;
    for (int i = 0; i <= U_DELTA_D; i++) var[A_DELTA_E + i] = applied(sim, u, i);
    var[A_GEAR] = u[U_GEAR];
    var[A_SPEEDBRAKE] = u[U_SPEEDBRAKE];
    var[A_X_CG] = m->x_ref_mac - now->cg[0] / m->cbar;
    if (m->uses_phi) var[A_PHI] = am_atan2(dot(now->C[1], now->down), dot(now->C[2], now->down));
}

/* Air, attitude, motion relative to the air, mass and the variables of the tables from the
 * state. */
void look_around(am_sim *sim, const double *x, const double *u) {
    now_t *now = &sim->now;
    double air[3], velocity[3], wind[3];
    if (!sim->anchored || !place_near(x, &sim->anchor, now)) place_of(x, sim->earth, now);
    atmosphere_at(&sim->atmosphere, now->h, &now->T, &now->p, &now->rho, &now->a);
    quaternion_matrix(x + X_Q0, now->C);
    weather_wind(sim, u, wind);
    for (int i = 0; i < 3; i++) {
        air[i] = x[X_VX + i]
                 - (wind[0] * now->north[i] + wind[1] * now->east[i] + wind[2] * now->down[i]);
    }
    to_body(now->C, air, velocity);
    air_data(now, velocity);
    for (int i = 0; i < 3; i++) now->rate[i] = x[X_P + i] - now->C[i][2] * sim->omega;
    mass_now(sim, x);
    set_variables(sim, x, u);
}

static void quaternion_rate(const double q[4], const double w[3], double dq[4]) {
    const double pull = 1.0 - (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    dq[0] = 0.5 * (-q[1] * w[0] - q[2] * w[1] - q[3] * w[2]) + pull * q[0];
    dq[1] = 0.5 * (q[0] * w[0] - q[3] * w[1] + q[2] * w[2]) + pull * q[1];
    dq[2] = 0.5 * (q[3] * w[0] + q[0] * w[1] - q[1] * w[2]) + pull * q[2];
    dq[3] = 0.5 * (-q[2] * w[0] + q[1] * w[1] + q[0] * w[2]) + pull * q[3];
}

/* Gravitation, Coriolis and centrifugal acceleration in Earth axes. */
static void field(const am_sim *sim, const double *x, double g[3]) {
    const double W = sim->omega;
    gravitation(x, sim->earth, g);
    g[0] += 2.0 * W * x[4] + W * W * x[0];
    g[1] += -2.0 * W * x[3] + W * W * x[1];
}

static void set_thrust_coefficient(am_sim *sim) {
    const double qbar = sim->now.qbar > QBAR_FLOOR ? sim->now.qbar : QBAR_FLOOR;
    double thrust = 0.0;
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) thrust += sim->now.thrust[i];
    sim->var[A_CT] = thrust / (qbar * sim->model->S);
}

void derivative(am_sim *sim, const double *x, const double *u, double *dx) {
    now_t *now = &sim->now;
    const double *w = x + X_P;
    double g[3], fall[3], turn[3], push[3], moment[3], H[3], ground[3], ground_moment[3], aero[3],
        arm[3], Jw[3];
    look_around(sim, x, u);
    const double per_mass = 1.0 / now->mass;
    engine_forces(sim, x, u, push, moment, H, dx);
    set_thrust_coefficient(sim);
    gear_forces(sim, x, u, ground, ground_moment, dx);
    for (int i = 0; i < 3; i++) {
        push[i] += ground[i];
        moment[i] += ground_moment[i];
    }
    field(sim, x, g);
    const double velocity[3] = {now->u, now->v, now->w};
    to_body(now->C, g, fall);
    cross(now->rate, velocity, turn);
    for (int i = 0; i < 3; i++) fall[i] -= turn[i];
    aero_forces(sim, push, fall);
    for (int i = 0; i < 3; i++) aero[i] = now->F[i] - push[i];
    cross(aero, now->cg, arm); /* -cg x F: the force acts at the reference point */
    to_body(now->J, w, Jw);
    for (int i = 0; i < 3; i++) {
        now->M[i] += arm[i] + moment[i];
        Jw[i] += H[i];
    }
    cross(Jw, w, turn);
    for (int i = 0; i < 3; i++) turn[i] += now->M[i];
    to_body(now->J_inverse, turn, now->angular);
    from_body(now->C, now->F, push);
    for (int i = 0; i < 3; i++) {
        dx[X_X + i] = x[X_VX + i];
        dx[X_VX + i] = push[i] * per_mass + g[i];
        dx[X_P + i] = now->angular[i];
    }
    quaternion_rate(x + X_Q0, now->rate, dx + X_Q0);
}

static void attitude_outputs(const now_t *now, double *y) {
    const double n = dot(now->C[0], now->north);
    const double e = dot(now->C[0], now->east);
    const double d = dot(now->C[0], now->down);
    y[Y_PHI] = am_atan2(dot(now->C[1], now->down), dot(now->C[2], now->down));
    y[Y_THETA] = am_atan2(-d, sqrt(n * n + e * e));
    y[Y_PSI] = am_atan2(e, n);
}

static void ground_outputs(am_sim *sim, double *y) {
    now_t *now = &sim->now;
    const double *v = sim->x + 3;
    locate_angles(sim, sim->x, now);
    y[Y_H] = now->h;
    y[Y_H_AGL] = sim->var[A_H_AGL];
    y[Y_LAT] = now->lat;
    y[Y_LON] = now->lon;
    y[Y_VN] = dot(v, now->north);
    y[Y_VE] = dot(v, now->east);
    y[Y_VD] = dot(v, now->down);
    y[Y_HDOT] = -y[Y_VD];
    y[Y_GAMMA] = am_atan2(-y[Y_VD], sqrt(y[Y_VN] * y[Y_VN] + y[Y_VE] * y[Y_VE]));
}

static void write_outputs(am_sim *sim, double *y) {
    const am_model *m = sim->model;
    const now_t *now = &sim->now;
    y[Y_V] = now->V;
    y[Y_V_CAS] = calibrated_airspeed(now->mach, now->p);
    y[Y_MACH] = now->mach;
    y[Y_QBAR] = now->qbar;
    y[Y_ALPHA] = now->alpha;
    y[Y_BETA] = now->beta;
    y[Y_U] = now->u;
    y[Y_V_BODY] = now->v;
    y[Y_W] = now->w;
    y[Y_ALPHA_DOT] = now->alpha_dot;
    y[Y_BETA_DOT] = now->beta_dot;
    for (int i = 0; i < 3; i++) {
        y[Y_P + i] = sim->x[10 + i];
        y[Y_P_DOT + i] = now->angular[i];
        y[Y_AX + i] = now->F[i] / now->mass;
        y[Y_TRIM_DELTA_E + i] = sim->trim.delta[i];
    }
    y[Y_NZ] = -y[Y_AZ] / G0;
    attitude_outputs(now, y);
    ground_outputs(sim, y);
    memcpy(y + Y_CL, now->c, sizeof now->c);
    y[Y_RHO] = now->rho;
    y[Y_P_STATIC] = now->p;
    y[Y_TEMPERATURE] = now->T;
    y[Y_H_BARO] = pressure_altitude(&sim->standard, now->p);
    y[Y_MASS] = now->mass;
    for (int i = 0; i <= U_DELTA_D; i++) y[Y_APPLIED_DELTA_E + i] = applied(sim, sim->u, i);
    y[Y_TRIM_ALPHA] = sim->trim.alpha;
    y[Y_TRIM_BETA] = sim->trim.beta;
    y[Y_TRIM_THRUST] = sim->trim.thrust;
    y[Y_TRIM_THROTTLE] = sim->trim.throttle;
    memcpy(y + Y_TRIM_U_DOT, sim->trim.residual, sizeof sim->trim.residual);
    y[Y_OUT_OF_RANGE] = 0.0;
    for (uint32_t i = 0; i < m->axes; i++) y[Y_OUT_OF_RANGE] += sim->below[i] + sim->above[i];
    weather_outputs(sim, y);
    fuel_outputs(sim, y);
    engine_outputs(sim, y);
    gear_outputs(sim, y);
    control_outputs(sim, y);
}

int am_outputs(am_sim *sim, double *y) {
    const int status = refresh(sim);
    if (status != AM_OK) return status;
    write_outputs(sim, y);
    return check_finite(sim, AM_OUTPUT, y);
}
