/* Thrust: a static table with a first-order lag, or the recorded thrust as an input. */
#include "model.h"

double applied_throttle(const am_sim *sim, const double *u, uint32_t engine) {
    return u[U_FIXED + (int)engine * U_PER_ENGINE + U_THROTTLE] + sim->par[P_BIAS_THROTTLE] + sim->trim.throttle;
}

static double parameter(const am_sim *sim, uint32_t engine, int code) { return sim->par[P_FIXED + (int)engine * P_PER_ENGINE + code]; }

void engine_thrust(am_sim *sim, const double *x, const double *u) {
    const am_model *m = sim->model;
    now_t *now = &sim->now;
    for (uint32_t i = 0; i < m->engines; i++) {
        sim->var[A_FIXED + (int)i * A_PER_ENGINE + A_THROTTLE] = applied_throttle(sim, u, i);
        now->steady[i] = 0.0;
    }
    look_up(sim, ENGINE_GROUP);
    evaluate_terms(sim, ENGINE_GROUP);
    for (uint32_t i = m->first_term[ENGINE_GROUP]; i < m->first_term[AERO_GROUP]; i++)
        now->steady[m->term[i].coefficient - COEFFICIENTS] += sim->term[i];
    for (uint32_t i = 0; i < m->engines; i++) {
        const double lagged = parameter(sim, i, P_TIME_CONSTANT) > 0.0 ? x[RIGID_STATES + i] : now->steady[i];
        const double drive = u[U_FIXED + (int)i * U_PER_ENGINE + U_THRUST_DRIVE];
        now->thrust[i] = (sim->drive == THRUST_DRIVEN ? drive : lagged) + sim->par[P_BIAS_THRUST] + sim->trim.thrust;
        sim->var[A_FIXED + (int)i * A_PER_ENGINE + A_THRUST] = now->thrust[i];
    }
}

/* Force, moment about the c.g. and angular momentum of the rotors, all in body axes. */
void engine_forces(const am_sim *sim, double F[3], double M[3], double H[3]) {
    for (int i = 0; i < 3; i++) F[i] = M[i] = H[i] = 0.0;
    for (uint32_t k = 0; k < sim->model->engines; k++) {
        const engine_t *engine = &sim->model->engine[k];
        double force[3], arm[3], moment[3];
        for (int i = 0; i < 3; i++) {
            force[i] = sim->now.thrust[k] * engine->direction[i];
            arm[i] = engine->position[i] - sim->par[P_X_CG_B + i];
        }
        cross(arm, force, moment);
        for (int i = 0; i < 3; i++) {
            F[i] += force[i];
            M[i] += moment[i];
            H[i] += parameter(sim, k, P_ANGULAR_MOMENTUM) * engine->direction[i];
        }
    }
}

void engine_derivative(const am_sim *sim, const double *x, double *dx) {
    for (uint32_t i = 0; i < sim->model->engines; i++) {
        const double tau = parameter(sim, i, P_TIME_CONSTANT);
        dx[RIGID_STATES + i] = tau > 0.0 && sim->drive != THRUST_DRIVEN ? (sim->now.steady[i] - x[RIGID_STATES + i]) / tau : 0.0;
    }
}
