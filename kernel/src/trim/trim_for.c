/* Trim for a study: any outputs to wanted values by any inputs, parameters and states, for a
 * start on a given path. */
#include "trim_for.h"

#include "algebra.h"
#include "axes.h"
#include "elementary.h"
#include "error.h"
#include "least_norm.h"
#include "outputs.h"
#include "prepare.h"
#include "sixdof.h"
#include "standing.h"
#include "start.h"
#include "trim_residual.h"
#include "tyre.h"
#include "weather.h"

#include <math.h>
#include <string.h>

#define PASSES 500  /* most, of tyres to their steady deflection */
#define STILL 1e-14 /* [m] */

/* acceleration for which one newton counts: flight goes before feel [m s-2 N-1] */
#define FORCE 0.01

typedef struct {
    am_sim *sim;
    const am_trim_task *given;
    double weight[LARGEST_SYSTEM];
    double *y;    /* NULL when all goals are accelerations */
    double theta; /* pitch attitude of the last start */
    int status;
} study_t;

/* Rates of an attitude that stays as it is over the curved and turning Earth, and of the turn. */
static void start_rates(am_sim *sim) {
    const now_t *now = &sim->now;
    double *x = sim->x;
    double horizon[3] = {0.0, 0.0, 0.0};
    double body[3];
    if (sim->earth != FLAT_EARTH) {
        const double per_square = 1.0 / dot(x, x);
        cross(x, x + 3, horizon);
        for (int i = 0; i < 3; i++) horizon[i] *= per_square;
        horizon[2] += sim->omega;
    }
    to_body(now->C, horizon, body);
    for (int i = 0; i < 3; i++) x[X_P + i] += body[i];
    add_turn(sim);
}

/* Airspeed and flow angles of a speed init.V over the ground along the heading, climbing by
 * init.gamma. */
static void flow_on_ground(const am_sim *sim, double flow[3]) {
    const double *p = sim->par;
    const double level = p[P_V] * am_cos(p[P_GAMMA]);
    const double ground[3] = {level * am_cos(p[P_PSI]), level * am_sin(p[P_PSI]),
                              -p[P_V] * am_sin(p[P_GAMMA])};
    double C[3][3], wind[3], air[3], b[3];
    steady_wind(sim, sim->u, p[P_H], wind);
    for (int i = 0; i < 3; i++) air[i] = ground[i] - wind[i];
    euler_matrix(p[P_PHI], p[P_THETA], p[P_PSI], C);
    to_body(C, air, b);
    flow[0] = sqrt(dot(b, b));
    flow[1] = flow[0] > 0.0 ? am_atan2(b[2], b[0]) : 0.0;
    flow[2] = flow[0] > 0.0 ? am_atan2(b[1], sqrt(b[0] * b[0] + b[2] * b[2])) : 0.0;
}

static void start_on_path(study_t *study) {
    am_sim *sim = study->sim;
    double *p = sim->par;
    double flow[3] = {p[P_V], p[P_ALPHA], p[P_BETA]};
    const double speed = p[P_V];
    if (study->given->path == AM_PATH_GROUND) flow_on_ground(sim, flow);
    study->theta = study->given->path == AM_PATH_GAMMA ? start_pitch(sim, flow[1], flow[2])
                                                       : p[P_THETA];
    p[P_V] = flow[0];
    start_state(sim, flow[1], flow[2], study->theta);
    p[P_V] = speed;
    start_rates(sim);
    sim->trim.alpha = flow[1];
    sim->trim.beta = flow[2];
}

static double *moved_value(am_sim *sim, const am_mover *m) {
    return (m->kind == AM_STATE ? sim->x : m->kind == AM_INPUT ? sim->u : sim->par) + m->index;
}

/* Where no guess was given: standing on the ground, or as it is now. */
static void first_guess(am_sim *sim, const am_trim_task *given, double *found) {
    const double h = sim->par[P_H];
    const double theta = sim->par[P_THETA];
    if (given->path == AM_PATH_GROUND) guess_standing(sim);
    for (int i = 0; i < given->movers; i++) {
        double *guess = &found[given->mover[i].unknown];
        if (isnan(*guess)) *guess = *moved_value(sim, &given->mover[i]);
    }
    sim->par[P_H] = h;
    sim->par[P_THETA] = theta;
}

/* Values of the unknowns: inputs and parameters before the start, states on top of it. */
static void move(am_sim *sim, const am_trim_task *given, const double *z, bool states) {
    for (int i = 0; i < given->movers; i++) {
        const am_mover *m = &given->mover[i];
        if ((m->kind == AM_STATE) == states) {
            *moved_value(sim, m) = z[m->unknown] * given->size[m->unknown];
        }
    }
}

/* Deflections of the tyres that no longer change: rolling they carry rolling resistance, brakes and
 * slip; at rest what exceeds brake and friction runs back, else its damping would appear as a
 * force. */
static void relax_tyres(am_sim *sim) {
    double most = INFINITY;
    for (int pass = 0; pass < PASSES && most > STILL; pass++) {
        derivative(sim, sim->x, sim->u, sim->k);
        most = 0.0;
        for (uint32_t i = 0; i < items(sim->model, G_CONTACT); i++) {
            for (int k = X_CONTACT_LONG; k <= X_CONTACT_SIDE; k++) {
                const double step = TYRE_LAG * state_of(sim, sim->k, G_CONTACT, i)[k];
                rate_of(sim, sim->x, G_CONTACT, i)[k] += step;
                most = fmax(most, fabs(step));
            }
        }
    }
}

static int attempt(study_t *study, const double *z) {
    am_sim *sim = study->sim;
    for (int j = 0; j < study->given->unknowns; j++) {
        if (!isfinite(z[j] * study->given->size[j])) return trim_not_finite(sim);
    }
    move(sim, study->given, z, false);
    sim->prepared = false;
    const int status = ready(sim);
    if (status != AM_OK) return status;
    start_on_path(study);
    move(sim, study->given, z, true);
    if (study->given->path == AM_PATH_GROUND) relax_tyres(sim);
    accelerations(sim, sim->trim.residual);
    sim->fresh = true;
    return study->y ? am_outputs(sim, study->y) : AM_OK;
}

/* init.* to the state, so that a start without a trim comes back to it. */
static void keep_start(const study_t *study) {
    double *p = study->sim->par;
    p[P_THETA] = study->theta;
    memcpy(p + P_P, study->sim->x + X_P, 3 * sizeof *p);
}

static double value_of(const study_t *study, int goal) {
    const am_sim *sim = study->sim;
    const now_t *now = &sim->now;
    double down[3];
    if (goal >= Y_TRIM_U_DOT && goal <= Y_TRIM_R_DOT) {
        return sim->trim.residual[goal - Y_TRIM_U_DOT];
    }
    if (goal != AM_GOAL_CLIMB) return study->y[goal];
    /* stands still in the body: the attitude against the horizon does */
    to_body(now->C, now->down, down);
    return -dot(now->acceleration, down);
}

static void weighed_goals(void *task, const double *z, double *r) {
    study_t *study = task;
    const am_trim_task *given = study->given;
    study->status = attempt(study, z);
    for (int i = 0; i < given->goals; i++) {
        r[i] = study->status == AM_OK
                   ? (value_of(study, given->goal[i]) - given->wanted[i]) * study->weight[i]
                   : INFINITY;
    }
}

/* What makes a goal an acceleration: half the span for rotations, gravity for angles and load
 * factor, FORCE for forces. */
static double weight_of(const am_sim *sim, int output, double wanted) {
    const double V = fmax(sim->par[P_V], 1.0);
    if (output == Y_P_DOT || output == Y_Q_DOT || output == Y_R_DOT
        || (output >= Y_TRIM_P_DOT && output <= Y_TRIM_R_DOT)) {
        return 0.5 * sim->model->b;
    }
    if (output == AM_GOAL_CLIMB || (output >= Y_TRIM_U_DOT && output <= Y_TRIM_W_DOT)) return 1.0;
    if (output == Y_AX || output == Y_AY || output == Y_AZ) return 1.0;
    if (output == Y_ALPHA_DOT || output == Y_BETA_DOT) return V;
    if (output == Y_HDOT) return G0 / V;
    /* N and N m */
    if (output >= 0 && sim->model->entry[AM_OUTPUT][output].units[0] == 'N') return FORCE;
    return G0 / fmax(fabs(wanted), 1.0);
}

static int check_task(am_sim *sim, const am_trim_task *given) {
    if (given->unknowns < 1 || given->unknowns > LARGEST_SYSTEM || given->goals < 1
        || given->goals > given->unknowns) {
        return fail(
            sim, AM_BAD_ARGUMENT,
            "a trim of %d goals by %d unknowns; allowed are 1 to %d unknowns and no more goals "
            "than unknowns",
            given->goals, given->unknowns, LARGEST_SYSTEM);
    }
    for (int i = 0; i < given->movers; i++) {
        const am_mover *m = &given->mover[i];
        if (m->kind != AM_INPUT && m->kind != AM_PARAMETER && m->kind != AM_STATE) {
            return fail(sim, AM_BAD_INDEX, "a trim moves inputs, parameters and states only");
        }
        const bool here = m->index >= (m->kind == AM_STATE ? X_PER_CORE : 0)
                          && m->index < sim->model->count[m->kind];
        if (!here || m->unknown < 0 || m->unknown >= given->unknowns) {
            return fail(sim, AM_BAD_INDEX, "mover %d of the trim names what is not there", i);
        }
    }
    for (int i = 0; i < given->goals; i++) {
        if (given->goal[i] < AM_GOAL_CLIMB || given->goal[i] >= sim->model->count[AM_OUTPUT]) {
            return fail(sim, AM_BAD_INDEX, "there is no output %d", given->goal[i]);
        }
    }
    for (int j = 0; j < given->unknowns; j++) {
        if (!(given->low[j] <= given->high[j] && given->size[j] > 0.0
              && isfinite(given->size[j]))) {
            return fail(
                sim, AM_BAD_ARGUMENT,
                "unknown %d of the trim lies between %g and %g in steps of %g; the limits must "
                "be in order, the size positive",
                j, given->low[j], given->high[j], given->size[j]);
        }
    }
    for (int i = 0; i < given->goals; i++) {
        if (!isfinite(given->wanted[i])) {
            return fail(sim, AM_NOT_FINITE, "goal %d of the trim is %g; it must be finite", i,
                        given->wanted[i]);
        }
    }
    if (given->path < AM_PATH_GAMMA || given->path > AM_PATH_GROUND) {
        return fail(sim, AM_BAD_ARGUMENT,
                    "path %d of the trim; allowed: 0 (gamma), 1 (theta), 2 (ground)", given->path);
    }
    if (given->path != AM_PATH_GROUND && !(sim->par[P_V] > 1.0)) return trim_too_slow(sim);
    return AM_OK;
}

int solve_trim(am_sim *sim, const am_trim_task *given, double *found, double *y, double *left,
               double *jacobian) {
    memset(&sim->trim, 0, sizeof sim->trim);
    study_t study = {.sim = sim, .given = given, .y = y};
    system_t system = {.unknowns = given->unknowns,
                       .equations = given->goals,
                       .residual = weighed_goals,
                       .task = &study};
    for (int i = 0; i < given->goals; i++) {
        study.weight[i] = weight_of(sim, given->goal[i], given->wanted[i]);
    }
    double z[LARGEST_SYSTEM];
    first_guess(sim, given, found);
    for (int j = 0; j < given->unknowns; j++) {
        if (!isfinite(found[j])) {
            return fail(
                sim, AM_NOT_FINITE,
                "the first guess of unknown %d of the trim is %g; give one, or what it moves", j,
                found[j]);
        }
    }
    for (int j = 0; j < given->unknowns; j++) {
        system.low[j] = given->low[j] / given->size[j];
        system.high[j] = given->high[j] / given->size[j];
        z[j] = clamp(found[j] / given->size[j], system.low[j], system.high[j]);
    }
    if (!isfinite(least_norm(&system, z))) {
        return study.status != AM_OK ? study.status : trim_not_finite(sim);
    }
    if (jacobian) {
        jacobian_t J;
        differences(&system, z, J);
        for (int i = 0; i < given->goals; i++) {
            for (int j = 0; j < given->unknowns; j++) jacobian[i * given->unknowns + j] = J[i][j];
        }
    }
    for (int j = 0; j < given->unknowns; j++) found[j] = z[j] * given->size[j];
    weighed_goals(&study, z, left);
    if (study.status == AM_OK && given->path != AM_PATH_GROUND) keep_start(&study);
    return study.status;
}

int am_trim_for(am_sim *sim, const am_trim_task *given, double *found, double *y, double *left,
                double *jacobian) {
    int status = ready(sim);
    if (status == AM_OK) status = check_task(sim, given);
    return status == AM_OK ? solve_trim(sim, given, found, y, left, jacobian) : status;
}
