/* Trim: six accelerations to their wanted values by alpha, beta, elevator, aileron, rudder and thrust (or throttle).
 *
 * Levenberg-Marquardt steps  dz = -J^T (J J^T + lambda I)^-1 r  on the same derivative that flies: for lambda -> 0 the
 * minimum-norm step, so a control without effect stays where it is and what cannot be removed is left as residual.
 * An unknown at its limit is taken out of the step.  Residuals are weighed as accelerations: rotations by half the span.
 * Unknowns are in radians, thrust in parts of the weight, throttle in parts of its travel. */
#include "model.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { Z_ALPHA, Z_BETA, Z_DELTA, Z_POWER = 5, UNKNOWNS };

#define ALPHA_LIMIT 0.6 /* [rad] */
#define BETA_LIMIT 0.35 /* [rad] */
#define NUDGE 1e-6      /* of the central differences */

typedef struct {
    am_sim *sim;
    int seek;
    double power; /* thrust per engine for one unit of Z_POWER [N], or 1 for the throttle */
    double low[UNKNOWNS], high[UNKNOWNS];
} task_t;

static void apply(const task_t *task, const double z[UNKNOWNS]) {
    am_sim *sim = task->sim;
    for (int i = 0; i < 3; i++) sim->trim.delta[i] = z[Z_DELTA + i];
    sim->trim.alpha = z[Z_ALPHA], sim->trim.beta = z[Z_BETA];
    *(task->seek == 2 ? &sim->trim.throttle : &sim->trim.thrust) = z[Z_POWER] * task->power;
    start_state(sim, z[Z_ALPHA], z[Z_BETA], start_pitch(sim, z[Z_ALPHA], z[Z_BETA]));
}

/* Acceleration minus wanted acceleration: u' v' w' p' q' r'. */
static void residual(const task_t *task, const double z[UNKNOWNS], double r[6]) {
    am_sim *sim = task->sim;
    apply(task, z);
    derivative(sim, sim->x, sim->u, sim->k);
    for (int i = 0; i < 3; i++) {
        r[i] = sim->now.acceleration[i] - sim->par[P_U_DOT + i];
        r[3 + i] = sim->now.angular[i] - sim->par[P_P_DOT + i];
    }
}

static double weigh(const task_t *task, double r[6]) {
    double sum = 0.0;
    for (int i = 0; i < 6; i++) {
        if (i >= 3) r[i] *= 0.5 * task->sim->model->b;
        sum += r[i] * r[i];
    }
    return sum;
}

static void jacobian(const task_t *task, const double z[UNKNOWNS], double J[6][UNKNOWNS]) {
    for (int j = 0; j < UNKNOWNS; j++) {
        double up[UNKNOWNS], down[UNKNOWNS], r_up[6], r_down[6];
        memcpy(up, z, sizeof up), memcpy(down, z, sizeof down);
        up[j] += NUDGE, down[j] -= NUDGE;
        residual(task, up, r_up), weigh(task, r_up);
        residual(task, down, r_down), weigh(task, r_down);
        for (int i = 0; i < 6; i++) J[i][j] = (r_up[i] - r_down[i]) / (2.0 * NUDGE);
    }
}

/* Cholesky solution of the positive definite A y = r, in place. */
static bool solve6(double A[6][6], double r[6]) {
    for (int j = 0; j < 6; j++) {
        for (int k = 0; k < j; k++) A[j][j] -= A[j][k] * A[j][k];
        if (!(A[j][j] > 0.0)) return false;
        A[j][j] = sqrt(A[j][j]);
        for (int i = j + 1; i < 6; i++) {
            for (int k = 0; k < j; k++) A[i][j] -= A[i][k] * A[j][k];
            A[i][j] /= A[j][j];
        }
    }
    for (int i = 0; i < 6; i++) {
        for (int k = 0; k < i; k++) r[i] -= A[i][k] * r[k];
        r[i] /= A[i][i];
    }
    for (int i = 5; i >= 0; i--) {
        for (int k = i + 1; k < 6; k++) r[i] -= A[k][i] * r[k];
        r[i] /= A[i][i];
    }
    return true;
}

static bool minimum_norm_step(double J[6][UNKNOWNS], const bool free[UNKNOWNS], const double r[6], double lambda, double dz[UNKNOWNS]) {
    double A[6][6], y[6], trace = 0.0;
    for (int i = 0; i < 6; i++)
        for (int k = 0; k < 6; k++) {
            A[i][k] = 0.0;
            for (int j = 0; j < UNKNOWNS; j++) A[i][k] += free[j] ? J[i][j] * J[k][j] : 0.0;
        }
    for (int i = 0; i < 6; i++) trace += A[i][i];
    for (int i = 0; i < 6; i++) A[i][i] += lambda * trace + DBL_MIN;
    memcpy(y, r, sizeof y);
    if (!solve6(A, y)) return false;
    for (int j = 0; j < UNKNOWNS; j++) {
        dz[j] = 0.0;
        for (int i = 0; i < 6; i++) dz[j] -= free[j] ? J[i][j] * y[i] : 0.0;
    }
    return true;
}

/* One accepted step; false when no step makes the residual smaller. */
static bool improve(const task_t *task, double z[UNKNOWNS], double r[6], double *size, double *lambda) {
    double J[6][UNKNOWNS];
    jacobian(task, z, J);
    for (int attempt = 0; attempt < 24; attempt++, *lambda *= 10.0) {
        bool free[UNKNOWNS] = {true, true, true, true, true, true}, moved = true;
        double dz[UNKNOWNS], next[UNKNOWNS], r_next[6];
        while (moved) {
            if (!minimum_norm_step(J, free, r, *lambda, dz)) break;
            moved = false;
            for (int j = 0; j < UNKNOWNS; j++) {
                next[j] = z[j] + dz[j];
                const bool stuck = (z[j] >= task->high[j] && dz[j] > 0.0) || (z[j] <= task->low[j] && dz[j] < 0.0);
                if (free[j] && stuck) free[j] = false, moved = true;
                next[j] = next[j] > task->high[j] ? task->high[j] : next[j] < task->low[j] ? task->low[j] : next[j];
            }
        }
        if (moved) continue;
        residual(task, next, r_next);
        const double size_next = weigh(task, r_next);
        if (!(size_next < *size)) continue;
        memcpy(z, next, sizeof next), memcpy(r, r_next, sizeof r_next);
        *size = size_next, *lambda = *lambda > 1e-14 ? *lambda * 0.01 : *lambda;
        return true;
    }
    return false;
}

static void set_limits(task_t *task) {
    const am_sim *sim = task->sim;
    const am_entry *input = sim->model->entry[AM_INPUT];
    task->low[Z_ALPHA] = -ALPHA_LIMIT, task->high[Z_ALPHA] = ALPHA_LIMIT;
    task->low[Z_BETA] = -BETA_LIMIT, task->high[Z_BETA] = BETA_LIMIT;
    for (int i = 0; i < 3; i++) {
        const double at = applied(sim, sim->u, i);
        task->low[Z_DELTA + i] = fmin(input[i].low - at, 0.0), task->high[Z_DELTA + i] = fmax(input[i].high - at, 0.0);
    }
    task->low[Z_POWER] = -1.0, task->high[Z_POWER] = 1.0;
    if (task->seek != 2) return;
    for (uint32_t k = 0; k < items(sim->model, G_ENGINE); k++) {
        const am_entry *throttle = &input[place(sim->model, AM_INPUT, G_ENGINE, k) + U_THROTTLE];
        const double at = applied_throttle(sim, sim->u, k);
        task->low[Z_POWER] = fmax(task->low[Z_POWER], fmin(throttle->low - at, 0.0));
        task->high[Z_POWER] = fmin(task->high[Z_POWER], fmax(throttle->high - at, 0.0));
    }
}

static double between(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

int am_trim(am_sim *sim, int seek) {
    const int status = ready(sim);
    if (status != AM_OK) return status;
    if (seek != 1 && seek != 2) return fail(sim, AM_BAD_ARGUMENT, "mode.trim is %d; allowed: 1 seeks thrust, 2 seeks throttle", seek);
    if (seek == 2 && sim->drive == THRUST_DRIVEN)
        return fail(sim, AM_BAD_VALUE, "mode.trim = 2 seeks the throttle, but mode.engine = 2 flies a given thrust; use mode.trim = 1");
    if (!(sim->par[P_V] > 1.0)) return fail(sim, AM_BAD_VALUE, "init.V = %g m/s; a trim needs more than 1 m/s", sim->par[P_V]);
    memset(&sim->trim, 0, sizeof sim->trim);
    const double engines = items(sim->model, G_ENGINE) ? items(sim->model, G_ENGINE) : 1.0;
    task_t task = {.sim = sim, .seek = seek, .power = seek == 2 ? 1.0 : sim->par[P_MASS] * G0 / engines};
    set_limits(&task);
    double z[UNKNOWNS] = {between(sim->par[P_ALPHA], -ALPHA_LIMIT, ALPHA_LIMIT), between(sim->par[P_BETA], -BETA_LIMIT, BETA_LIMIT)};
    double r[6], lambda = 1e-6;
    residual(&task, z, r);
    double size = weigh(&task, r);
    for (int i = 0; i < 100 && size > 1e-26; i++)
        if (!improve(&task, z, r, &size, &lambda)) break;
    residual(&task, z, sim->trim.residual);
    sim->fresh = false;
    if (!isfinite(size))
        return fail(sim, AM_NOT_FINITE, "the trim met accelerations that are not finite; check the model and the initial condition");
    return AM_OK;
}
