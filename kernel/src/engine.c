/* Thrust: a static table with a first-order lag, or the recorded thrust as an input. */
#include "model.h"

double applied_throttle(const am_sim *sim, const double *u, uint32_t engine) {
    return input_of(sim, u, G_ENGINE, engine)[U_THROTTLE] + sim->par[P_BIAS_THROTTLE] + sim->trim.throttle;
}

int engine_check(am_sim *sim) {
    const am_model *m = sim->model;
    for (uint32_t i = 0; i < items(m, G_ENGINE); i++) {
        const uint32_t tau = place(m, AM_PARAMETER, G_ENGINE, i) + P_TIME_CONSTANT;
        if (!(sim->par[tau] >= 0.0)) return bad_parameter(sim, tau, "zero or positive");
        if (sim->drive != THRUST_DRIVEN && !has_terms(m, G_ENGINE, i, T_THRUST))
            return fail(sim, AM_BAD_VALUE, "mode.engine = %d needs a thrust table, engine%u has none; use mode.engine = 2", sim->drive, (unsigned)(i + 1));
    }
    return AM_OK;
}

static void find_thrust(am_sim *sim, const double *x, const double *u) {
    const am_model *m = sim->model;
    now_t *now = &sim->now;
    for (uint32_t i = 0; i < items(m, G_ENGINE); i++) var_of(sim, G_ENGINE, i)[A_THROTTLE] = applied_throttle(sim, u, i);
    evaluate_stage(sim, STAGE_ENGINE);
    for (uint32_t i = 0; i < items(m, G_ENGINE); i++) {
        now->steady[i] = sum_of(sim, G_ENGINE, i)[T_THRUST];
        const double lagged = par_of(sim, G_ENGINE, i)[P_TIME_CONSTANT] > 0.0 ? state_of(sim, x, G_ENGINE, i)[X_LAGGED] : now->steady[i];
        const double drive = input_of(sim, u, G_ENGINE, i)[U_THRUST_DRIVE];
        now->thrust[i] = (sim->drive == THRUST_DRIVEN ? drive : lagged) + sim->par[P_BIAS_THRUST] + sim->trim.thrust;
        var_of(sim, G_ENGINE, i)[A_THRUST] = now->thrust[i];
    }
}

/* To the steady thrust of the present state and inputs. */
void engine_start(am_sim *sim, double t) {
    (void)t;
    find_thrust(sim, sim->x, sim->u);
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) rate_of(sim, sim->x, G_ENGINE, i)[X_LAGGED] = sim->now.steady[i];
}

void engine_advance(am_sim *sim, double t, double h, const double *u0, const double *u1) { (void)sim, (void)t, (void)h, (void)u0, (void)u1; }

/* Force, moment about the c.g. and angular momentum of the rotors, all in body axes. */
void engine_forces(am_sim *sim, const double *x, const double *u, double F[3], double M[3], double H[3], double *dx) {
    find_thrust(sim, x, u);
    for (int i = 0; i < 3; i++) F[i] = M[i] = H[i] = 0.0;
    for (uint32_t k = 0; k < items(sim->model, G_ENGINE); k++) {
        const double *p = par_of(sim, G_ENGINE, k), tau = p[P_TIME_CONSTANT], *direction = p + P_DIRECTION_X;
        double force[3], arm[3], moment[3];
        for (int i = 0; i < 3; i++) {
            force[i] = sim->now.thrust[k] * direction[i];
            arm[i] = p[P_ENGINE_X + i] - sim->now.cg[i];
        }
        cross(arm, force, moment);
        for (int i = 0; i < 3; i++) {
            F[i] += force[i];
            M[i] += moment[i];
            H[i] += p[P_ANGULAR_MOMENTUM] * direction[i];
        }
        const double lagged = state_of(sim, x, G_ENGINE, k)[X_LAGGED];
        rate_of(sim, dx, G_ENGINE, k)[X_LAGGED] = tau > 0.0 && sim->drive != THRUST_DRIVEN ? (sim->now.steady[k] - lagged) / tau : 0.0;
    }
}

void engine_outputs(am_sim *sim, double *y) {
    for (uint32_t i = 0; i < items(sim->model, G_ENGINE); i++) output_of(sim, y, G_ENGINE, i)[Y_THRUST] = sim->now.thrust[i];
}
