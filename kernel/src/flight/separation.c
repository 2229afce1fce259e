/* Separation point of each wing half, the form of Goman and Khrabrov (J. Aircraft 31(5), 1994):
 *
 *     tau1 (cbar / V) X' + X = X0(alpha - tau2 (cbar / V) alpha'),
 *     X0(alpha) = (1 - tanh(a1 (alpha - alpha*))) / 2 = 1 / (1 + exp(2 a1 (alpha - alpha*)))
 *
 * alpha and alpha' are those of the air that meets the wing at the stations y = -+ stall.station:
 * u - r y, w + p y.  alpha* is stall.alpha_star, less half of stall.asymmetry on the left and plus
 * half of it on the right.  The factor of the lift is ((1 + sqrt X) / 2)^2 (Kirchhoff).
 *
 * The rate is at most FASTEST: steps of 10 ms keep X between 0 and 1, since all weights of X and X0
 * in a step of Runge-Kutta are then positive. */
#include "separation.h"

#include "algebra.h"
#include "elementary_real.h"
#include "terms.h"

#if ORIGINAL
#include "error.h"
#endif

#define FASTEST 100.0  /* [1/s] */
#define STEEPEST 600.0 /* of the exponent: beyond it X0 is 0 or 1 to the last bit */

static real kirchhoff_lift(real X) {
    const real half = 0.5 * (1.0 + root(X));
    return half * half;
}

void separation_variables(flight_t *sim, const real *x) {
    const real *state = state_of(sim, x, G_SEPARATION, 0);
    real *var = var_of(sim, G_SEPARATION, 0);
    const real left = clamp(state[X_SEPARATION_LEFT], 0.0, 1.0);
    const real right = clamp(state[X_SEPARATION_RIGHT], 0.0, 1.0);
    const real lift_left = kirchhoff_lift(left);
    const real lift_right = kirchhoff_lift(right);
    var[A_SEPARATION_LEFT] = left;
    var[A_SEPARATION_RIGHT] = right;
    var[A_SEPARATION] = 0.5 * (left + right);
    var[A_SEPARATION_DIFF] = left - right;
    var[A_SEPARATION_LIFT] = 0.5 * (lift_left + lift_right);
    var[A_SEPARATION_LIFT_DIFF] = lift_left - lift_right;
    evaluate_stage(sim, STAGE_SEPARATION);
}

/* alpha of a wing half at the station y; its rate in *rate. */
static real half_alpha(const flight_t *sim, real y, real *rate) {
    const now_r *now = &sim->now;
    const real u = now->u - sim->var[A_R] * y;
    const real w = now->w + sim->var[A_P] * y;
    const real du = now->acceleration[0] - now->angular[2] * y;
    const real dw = now->acceleration[2] + now->angular[0] * y;
    const real square = u * u + w * w;
    /* no rate below FLOW_FLOOR, as that of the aircraft */
    const mask_t calm = square < FLOW_FLOOR * FLOW_FLOOR;
    *rate = PICK(calm, 0.0, (u * dw - w * du) / PICK(calm, 1.0, square));
    return ATAN2(w, u);
}

/* X0 of a wing half; side is -1 left, 1 right; moving: with the rate of alpha. */
real steady_separation(const flight_t *sim, double side, bool moving) {
    const real *sum = sum_of(sim, G_SEPARATION, 0);
    real rate;
    real alpha = half_alpha(sim, side * par_of(sim, G_SEPARATION, 0)[P_STATION], &rate);
    if (moving) alpha -= sum[T_TAU2] * (sim->model->cbar * sim->now.per_V) * rate;
    const real star = sum[T_ALPHA_STAR] + 0.5 * side * sum[T_ASYMMETRY];
    return 1.0 / (1.0 + EXP(clamp(2.0 * sum[T_A1] * (alpha - star), -STEEPEST, STEEPEST)));
}

void separation_rates(flight_t *sim, const real *x, real *dx) {
    const real *state = state_of(sim, x, G_SEPARATION, 0);
    const real chords = sim->now.V / sim->model->cbar; /* per second */
    const real lag = larger(sum_of(sim, G_SEPARATION, 0)[T_TAU1], 0.0);
    /* V / (tau1 cbar), at most FASTEST */
    const real fast = chords / larger(lag, chords / FASTEST);
    const real rate = PICK(chords > 0.0, fast, 0.0);
    for (int i = X_SEPARATION_LEFT; i <= X_SEPARATION_RIGHT; i++) {
        const double side = i == X_SEPARATION_LEFT ? -1.0 : 1.0;
        rate_of(sim, dx, G_SEPARATION, 0)[i] = rate
                                               * (steady_separation(sim, side, true) - state[i]);
    }
}

void separation_outputs(const flight_t *sim, real *y) {
    if (!separates(sim)) return;
    const real *sum = sum_of(sim, G_SEPARATION, 0);
    real *to = output_of(sim, y, G_SEPARATION, 0);
    to[Y_SEPARATION_LEFT] = var_of(sim, G_SEPARATION, 0)[A_SEPARATION_LEFT];
    to[Y_SEPARATION_RIGHT] = var_of(sim, G_SEPARATION, 0)[A_SEPARATION_RIGHT];
    for (int k = 0; k < 3; k++) to[Y_BUFFET_RMS + k] = sum[T_BUFFET_RMS + k];
}

#if ORIGINAL

/* Scales of the terms of a target: a separation without slope or lag has no meaning. */
static int check_target(am_sim *sim, uint32_t target, double least, bool open, const char *rule) {
    const am_model *m = sim->model;
    const uint32_t t = place(m, AM_TARGET, G_SEPARATION, 0) + target;
    for (uint32_t i = m->first_of[t]; i < m->end_of[t]; i++) {
        const uint32_t scale = m->total[AM_PARAMETER] + i;
        const bool good = open ? sim->par[scale] > least : sim->par[scale] >= least;
        if (!good) return bad_parameter(sim, scale, rule);
    }
    return AM_OK;
}

int separation_check(am_sim *sim) {
    if (!separates(sim)) return AM_OK;
    const uint32_t station = place(sim->model, AM_PARAMETER, G_SEPARATION, 0) + P_STATION;
    if (!(sim->par[station] >= 0.0 && sim->par[station] <= sim->model->b)) {
        return bad_parameter(sim, station, "zero or positive, at most the span");
    }
    int status = check_target(sim, T_A1, 0.0, true, "positive");
    if (status == AM_OK) status = check_target(sim, T_TAU1, 0.0, true, "positive");
    if (status == AM_OK) status = check_target(sim, T_TAU2, 0.0, false, "zero or positive");
    return status;
}

#endif
