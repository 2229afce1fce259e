/* Trim at the start of a run: six accelerations to their wanted values by alpha, beta, elevator,
 * aileron, rudder and thrust (or throttle), found as biases on top of the inputs, and by bank
 * within init.phi_range of init.phi: in a straight sideslip the side forces of fin and rudder can
 * cancel, so that a small side acceleration takes a large rudder, or a little bank.
 *
 * Minimum-norm steps (least_norm.h) on the same derivative that flies.  Residuals are weighed as
 * accelerations: rotations by half the span.  Unknowns are in radians, thrust in parts of the
 * weight, throttle in parts of its travel. */
#include "trim_ground.h"

#include "algebra.h"
#include "control_drive.h"
#include "engine.h"
#include "error.h"
#include "least_norm.h"
#include "prepare.h"
#include "start.h"
#include "trim_residual.h"

#include <math.h>
#include <string.h>

enum { Z_ALPHA, Z_BETA, Z_DELTA, Z_AILERON = Z_DELTA + 1, Z_RUDDER, Z_POWER, Z_PHI, UNKNOWNS };

#define ALPHA_LIMIT 0.6 /* [rad] */
#define BETA_LIMIT 0.35 /* [rad] */
#define BETTER 0.1      /* share of it that a second search must leave at most */

typedef struct {
    am_sim *sim;
    int mode;
    double power; /* thrust per engine for one unit of Z_POWER [N], or 1 for the throttle */
} task_t;

static void start_with(const task_t *task, const double *z, double r[6]) {
    am_sim *sim = task->sim;
    for (int i = 0; i < 3; i++) sim->trim.delta[i] = z[Z_DELTA + i];
    sim->trim.alpha = z[Z_ALPHA];
    sim->trim.beta = z[Z_BETA];
    sim->par[P_PHI] = z[Z_PHI];
    *(task->mode == 2 ? &sim->trim.throttle : &sim->trim.thrust) = z[Z_POWER] * task->power;
    start_state(sim, z[Z_ALPHA], z[Z_BETA], start_pitch(sim, z[Z_ALPHA], z[Z_BETA]));
    add_turn(sim);
    accelerations(sim, r);
}

static void weighed(void *task, const double *z, double *r) {
    const task_t *t = task;
    start_with(t, z, r);
    for (int i = 3; i < 6; i++) r[i] *= 0.5 * t->sim->model->b;
}

static void set_limits(const task_t *task, system_t *s) {
    const am_sim *sim = task->sim;
    const am_entry *input = sim->model->entry[AM_INPUT];
    s->low[Z_ALPHA] = -ALPHA_LIMIT;
    s->high[Z_ALPHA] = ALPHA_LIMIT;
    s->low[Z_BETA] = -BETA_LIMIT;
    s->high[Z_BETA] = BETA_LIMIT;
    for (int i = 0; i < 3; i++) {
        const double at = applied(sim, sim->u, i);
        s->low[Z_DELTA + i] = fmin(input[i].low - at, 0.0);
        s->high[Z_DELTA + i] = fmax(input[i].high - at, 0.0);
    }
    s->low[Z_POWER] = -1.0;
    s->high[Z_POWER] = 1.0;
    if (task->mode != 2) return;
    for (uint32_t k = 0; k < items(sim->model, G_ENGINE); k++) {
        const am_entry *throttle = &input[place(sim->model, AM_INPUT, G_ENGINE, k) + U_THROTTLE];
        const double at = applied_throttle(sim, sim->u, k);
        s->low[Z_POWER] = fmax(s->low[Z_POWER], fmin(throttle->low - at, 0.0));
        s->high[Z_POWER] = fmin(s->high[Z_POWER], fmax(throttle->high - at, 0.0));
    }
}

/* With the bank held, then, from there, with the bank free and the lateral unknowns back at the
 * start: that step is nearly linear, so that the smallest step leads to the solution nearest to
 * the start, whatever the way to the first one was. */
static double solve_with_bank(system_t *s, double *z, double *par) {
    const double phi = z[Z_PHI] = par[P_PHI];
    const double range = par[P_PHI_RANGE];
    const double beta = z[Z_BETA];
    s->low[Z_PHI] = s->high[Z_PHI] = phi;
    double left = least_norm(s, z);
    if (range > 0.0) {
        s->low[Z_PHI] = phi - range;
        s->high[Z_PHI] = phi + range;
        z[Z_BETA] = beta;
        z[Z_AILERON] = z[Z_RUDDER] = 0.0;
        s->nearest = true;
        left = least_norm(s, z);
    }
    return left;
}

static bool is_trimmed(const system_t *s, const double *z) {
    double r[6];
    s->residual(s->task, z, r);
    bool small = true;
    for (int i = 0; i < 6; i++) small = small && fabs(r[i]) <= TRIMMED;
    return small;
}

/* A lever at its stop can have no effect: a piston engine without air stands, and a little more air
 * does not turn it.  An untrimmed flight is therefore tried again from the middle of the travel.
 * Without a rudder a little side acceleration remains either way. */
static double solve_with_lever(system_t *s, double *z, double *par, bool lever) {
    const double phi = par[P_PHI];
    double middle[UNKNOWNS];
    memcpy(middle, z, sizeof middle);
    const double left = solve_with_bank(s, z, par);
    if (!lever || is_trimmed(s, z)) return left;
    par[P_PHI] = phi;
    middle[Z_POWER] = 0.5 * (s->low[Z_POWER] + s->high[Z_POWER]);
    s->nearest = false;
    const double again = solve_with_bank(s, middle, par);
    if (!(again < BETTER * left)) return left;
    memcpy(z, middle, sizeof middle);
    return again;
}

static int trim_biases(am_sim *sim, int mode) {
    if (mode == 2 && sim->drive != LEVER_DRIVEN) {
        return fail(
            sim, AM_BAD_VALUE,
            "mode.trim = 2 solves for the throttle, but mode.engine = %d does not fly by the "
            "lever; use mode.trim = 1",
            sim->drive);
    }
    if (!(sim->par[P_V] > 1.0)) return trim_too_slow(sim);
    const double engines = items(sim->model, G_ENGINE) ? items(sim->model, G_ENGINE) : 1.0;
    task_t task = {
        .sim = sim, .mode = mode, .power = mode == 2 ? 1.0 : sim->par[P_MASS] * G0 / engines};
    system_t system = {.unknowns = UNKNOWNS, .equations = 6, .residual = weighed, .task = &task};
    set_limits(&task, &system);
    double z[UNKNOWNS] = {clamp(sim->par[P_ALPHA], -ALPHA_LIMIT, ALPHA_LIMIT),
                          clamp(sim->par[P_BETA], -BETA_LIMIT, BETA_LIMIT)};
    const double phi = sim->par[P_PHI];
    const double left = solve_with_lever(&system, z, sim->par, mode == 2);
    start_with(&task, z, sim->trim.residual);
    sim->par[P_PHI] = phi;
    sim->fresh = false;
    return isfinite(left) ? AM_OK : trim_not_finite(sim);
}

int am_trim(am_sim *sim, int mode) {
    const int status = ready(sim);
    if (status != AM_OK) return status;
    if (mode < 1 || mode > 3) {
        return fail(
            sim, AM_BAD_ARGUMENT,
            "mode.trim is %d; allowed: 1 (thrust), 2 (throttle), 3 (standing on the ground)", mode);
    }
    memset(&sim->trim, 0, sizeof sim->trim);
    return mode == 3 ? trim_on_ground(sim) : trim_biases(sim, mode);
}
