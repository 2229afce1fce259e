/* What all kinds of trim make small, and their refusals. */
#include "trim_residual.h"

#include "algebra.h"
#include "error.h"
#include "sixdof.h"
#include "start.h"

/* Body rates of a turn with init.psi_dot about the vertical, on top of what the state holds; the
 * flow over the wing halves follows them. */
void add_turn(am_sim *sim) {
    const now_t *now = &sim->now;
    for (int i = 0; i < 3; i++) sim->x[X_P + i] += sim->par[P_PSI_DOT] * dot(now->C[i], now->down);
    start_separation(sim);
}

/* Accelerations minus wanted ones, u' v' w' p' q' r', at the present state. */
void accelerations(am_sim *sim, double r[6]) {
    derivative(sim, sim->x, sim->u, sim->k);
    for (int i = 0; i < 3; i++) {
        r[i] = sim->now.acceleration[i] - sim->par[P_U_DOT + i];
        r[3 + i] = sim->now.angular[i] - sim->par[P_P_DOT + i];
    }
}

int trim_not_finite(am_sim *sim) {
    return fail(sim, AM_NOT_FINITE,
                "the trim met accelerations that are not finite; check the model and the initial "
                "condition");
}

int trim_too_slow(am_sim *sim) {
    return fail(sim, AM_BAD_VALUE, "init.V = %g m/s; a trim needs more than 1 m/s", sim->par[P_V]);
}
