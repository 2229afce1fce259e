/* Trim: the start of a steady flight.
 *
 * am_trim, for the start of every run: six accelerations to their wanted values by alpha, beta, elevator, aileron, rudder and
 * thrust (or throttle), found as biases on top of the inputs; on the ground height and attitude.
 * am_trim_for, for a study: any outputs to wanted values by any inputs, parameters and states.
 * Both solve by least_norm on the same derivative that flies.  Residuals are weighed as accelerations: rotations by half the span.
 * am_trim's unknowns are in radians, thrust in parts of the weight, throttle in parts of its travel. */
#include "elementary.h"
#include "least_norm.h"
#include "model.h"

#include <math.h>
#include <string.h>

enum { Z_ALPHA, Z_BETA, Z_DELTA, Z_POWER = 5, UNKNOWNS };

#define ALPHA_LIMIT 0.6 /* [rad] */
#define BETA_LIMIT 0.35 /* [rad] */

/* Body rates of a turn with init.psi_dot about the vertical, on top of what the state holds. */
static void add_turn(am_sim *sim) {
    const now_t *now = &sim->now;
    for (int i = 0; i < 3; i++) sim->x[X_P + i] += sim->par[P_PSI_DOT] * dot(now->C[i], now->down);
}

/* Accelerations minus wanted ones, u' v' w' p' q' r', at the present state. */
static void accelerations(am_sim *sim, double r[6]) {
    derivative(sim, sim->x, sim->u, sim->k);
    for (int i = 0; i < 3; i++) {
        r[i] = sim->now.acceleration[i] - sim->par[P_U_DOT + i];
        r[3 + i] = sim->now.angular[i] - sim->par[P_P_DOT + i];
    }
}

/* ---- biases at the start of a run --------------------------------------------------------------------------------- */

typedef struct {
    am_sim *sim;
    int seek;
    double power; /* thrust per engine for one unit of Z_POWER [N], or 1 for the throttle */
} task_t;

static void start_with(const task_t *task, const double *z, double r[6]) {
    am_sim *sim = task->sim;
    for (int i = 0; i < 3; i++) sim->trim.delta[i] = z[Z_DELTA + i];
    sim->trim.alpha = z[Z_ALPHA], sim->trim.beta = z[Z_BETA];
    *(task->seek == 2 ? &sim->trim.throttle : &sim->trim.thrust) = z[Z_POWER] * task->power;
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
    s->low[Z_ALPHA] = -ALPHA_LIMIT, s->high[Z_ALPHA] = ALPHA_LIMIT;
    s->low[Z_BETA] = -BETA_LIMIT, s->high[Z_BETA] = BETA_LIMIT;
    for (int i = 0; i < 3; i++) {
        const double at = applied(sim, sim->u, i);
        s->low[Z_DELTA + i] = fmin(input[i].low - at, 0.0), s->high[Z_DELTA + i] = fmax(input[i].high - at, 0.0);
    }
    s->low[Z_POWER] = -1.0, s->high[Z_POWER] = 1.0;
    if (task->seek != 2) return;
    for (uint32_t k = 0; k < items(sim->model, G_ENGINE); k++) {
        const am_entry *throttle = &input[place(sim->model, AM_INPUT, G_ENGINE, k) + U_THROTTLE];
        const double at = applied_throttle(sim, sim->u, k);
        s->low[Z_POWER] = fmax(s->low[Z_POWER], fmin(throttle->low - at, 0.0));
        s->high[Z_POWER] = fmin(s->high[Z_POWER], fmax(throttle->high - at, 0.0));
    }
}

static double between(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

static int not_finite(am_sim *sim) {
    return fail(sim, AM_NOT_FINITE, "the trim met accelerations that are not finite; check the model and the initial condition");
}

static int too_slow(am_sim *sim) {
    return fail(sim, AM_BAD_VALUE, "init.V = %g m/s; a trim needs more than 1 m/s", sim->par[P_V]);
}

static int trim_biases(am_sim *sim, int seek) {
    if (seek == 2 && sim->drive == THRUST_DRIVEN)
        return fail(sim, AM_BAD_VALUE, "mode.trim = 2 seeks the throttle, but mode.engine = 2 flies a given thrust; use mode.trim = 1");
    if (!(sim->par[P_V] > 1.0)) return too_slow(sim);
    const double engines = items(sim->model, G_ENGINE) ? items(sim->model, G_ENGINE) : 1.0;
    task_t task = {.sim = sim, .seek = seek, .power = seek == 2 ? 1.0 : sim->par[P_MASS] * G0 / engines};
    system_t system = {.unknowns = UNKNOWNS, .equations = 6, .residual = weighed, .task = &task};
    set_limits(&task, &system);
    double z[UNKNOWNS] = {between(sim->par[P_ALPHA], -ALPHA_LIMIT, ALPHA_LIMIT), between(sim->par[P_BETA], -BETA_LIMIT, BETA_LIMIT)};
    const double left = least_norm(&system, z);
    start_with(&task, z, sim->trim.residual);
    sim->fresh = false;
    return isfinite(left) ? AM_OK : not_finite(sim);
}

/* ---- any quantities ----------------------------------------------------------------------------------------------- */

typedef struct {
    am_sim *sim;
    const am_trim_task *ask;
    double weight[LARGEST_SYSTEM];
    double *y; /* NULL when all goals are trim.u_dot ... trim.r_dot */
    double flow[3], theta; /* V, alpha, beta and pitch attitude of the last start */
    int status;
} study_t;

static double *moved(am_sim *sim, const am_mover *mover) {
    return (mover->kind == AM_INPUT ? sim->u : sim->par) + mover->index;
}

/* Rates of an attitude that stays as it is over the curved and turning Earth, and of the turn. */
static void start_rates(am_sim *sim) {
    const now_t *now = &sim->now;
    double *x = sim->x, horizon[3] = {0.0, 0.0, 0.0}, body[3];
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

/* Airspeed and flow angles of a speed init.V over the ground along the heading, climbing by init.gamma. */
static void flow_on_ground(const am_sim *sim, double flow[3]) {
    const double *p = sim->par, level = p[P_V] * am_cos(p[P_GAMMA]);
    const double ground[3] = {level * am_cos(p[P_PSI]), level * am_sin(p[P_PSI]), -p[P_V] * am_sin(p[P_GAMMA])};
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
    double *p = sim->par, *flow = study->flow;
    const double speed = p[P_V];
    flow[0] = speed, flow[1] = p[P_ALPHA], flow[2] = p[P_BETA];
    if (study->ask->path == AM_PATH_GROUND) flow_on_ground(sim, flow);
    study->theta = study->ask->path == AM_PATH_GAMMA ? start_pitch(sim, flow[1], flow[2]) : p[P_THETA];
    p[P_V] = flow[0];
    start_state(sim, flow[1], flow[2], study->theta);
    p[P_V] = speed;
    start_rates(sim);
    sim->trim.alpha = flow[1], sim->trim.beta = flow[2];
}

static int attempt(study_t *study, const double *z) {
    am_sim *sim = study->sim;
    const am_trim_task *ask = study->ask;
    for (int i = 0; i < ask->movers; i++) *moved(sim, &ask->mover[i]) = z[ask->mover[i].unknown] * ask->size[ask->mover[i].unknown];
    sim->prepared = false;
    const int status = ready(sim);
    if (status != AM_OK) return status;
    start_on_path(study);
    accelerations(sim, sim->trim.residual);
    sim->fresh = true;
    return study->y ? am_outputs(sim, study->y) : AM_OK;
}

/* init.* to the state, so that a start without a trim comes back to it. */
static void keep_start(study_t *study) {
    double *p = study->sim->par;
    p[P_V] = study->flow[0], p[P_ALPHA] = study->flow[1], p[P_BETA] = study->flow[2], p[P_THETA] = study->theta;
    memcpy(p + P_P, study->sim->x + X_P, 3 * sizeof *p);
}

static void weighed_goals(void *task, const double *z, double *r) {
    study_t *study = task;
    const am_trim_task *ask = study->ask;
    study->status = attempt(study, z);
    for (int i = 0; i < ask->goals; i++) {
        const int k = ask->goal[i] - Y_TRIM_U_DOT;
        const double value = k >= 0 && k < 6 ? study->sim->trim.residual[k] : study->y[ask->goal[i]];
        r[i] = study->status == AM_OK ? (value - ask->wanted[i]) * study->weight[i] : INFINITY;
    }
}

/* What makes a goal an acceleration: half the span for rotations, gravity for angles and load factor. */
static double weight_of(const am_sim *sim, int output, double wanted) {
    const double V = fmax(sim->par[P_V], 1.0);
    if (output == Y_P_DOT || output == Y_Q_DOT || output == Y_R_DOT || (output >= Y_TRIM_P_DOT && output <= Y_TRIM_R_DOT))
        return 0.5 * sim->model->b;
    if (output >= Y_TRIM_U_DOT && output <= Y_TRIM_W_DOT) return 1.0;
    if (output == Y_AX || output == Y_AY || output == Y_AZ) return 1.0;
    if (output == Y_ALPHA_DOT || output == Y_BETA_DOT) return V;
    if (output == Y_HDOT) return G0 / V;
    return G0 / fmax(fabs(wanted), 1.0);
}

static int check_task(am_sim *sim, const am_trim_task *ask) {
    if (ask->unknowns < 1 || ask->unknowns > LARGEST_SYSTEM || ask->goals < 1 || ask->goals > ask->unknowns)
        return fail(sim, AM_BAD_ARGUMENT, "a trim of %d goals by %d unknowns; allowed are 1 to %d unknowns and no more goals than unknowns",
                    ask->goals, ask->unknowns, LARGEST_SYSTEM);
    for (int i = 0; i < ask->movers; i++) {
        const am_mover *m = &ask->mover[i];
        if (m->kind != AM_INPUT && m->kind != AM_PARAMETER) return fail(sim, AM_BAD_INDEX, "a trim moves inputs and parameters only");
        if (m->index < 0 || m->index >= sim->model->count[m->kind] || m->unknown < 0 || m->unknown >= ask->unknowns)
            return fail(sim, AM_BAD_INDEX, "mover %d of the trim names what is not there", i);
    }
    for (int i = 0; i < ask->goals; i++)
        if (ask->goal[i] < 0 || ask->goal[i] >= sim->model->count[AM_OUTPUT])
            return fail(sim, AM_BAD_INDEX, "there is no output %d", ask->goal[i]);
    if (ask->path < AM_PATH_GAMMA || ask->path > AM_PATH_GROUND)
        return fail(sim, AM_BAD_ARGUMENT, "path %d of the trim; allowed: 0 (gamma), 1 (theta), 2 (ground)", ask->path);
    return AM_OK;
}

int am_trim_for(am_sim *sim, const am_trim_task *ask, double *found, double *y, double *left, double *jacobian) {
    int status = ready(sim);
    if (status == AM_OK) status = check_task(sim, ask);
    if (status != AM_OK) return status;
    memset(&sim->trim, 0, sizeof sim->trim);
    study_t study = {.sim = sim, .ask = ask, .y = y};
    system_t system = {.unknowns = ask->unknowns, .equations = ask->goals, .residual = weighed_goals, .task = &study};
    for (int i = 0; i < ask->goals; i++) study.weight[i] = weight_of(sim, ask->goal[i], ask->wanted[i]);
    double z[LARGEST_SYSTEM];
    for (int j = 0; j < ask->unknowns; j++) {
        system.low[j] = ask->low[j] / ask->size[j], system.high[j] = ask->high[j] / ask->size[j];
        z[j] = between(found[j] / ask->size[j], system.low[j], system.high[j]);
    }
    if (!isfinite(least_norm(&system, z))) return study.status != AM_OK ? study.status : not_finite(sim);
    if (jacobian) {
        jacobian_t J;
        differences(&system, z, J);
        for (int i = 0; i < ask->goals; i++)
            for (int j = 0; j < ask->unknowns; j++) jacobian[i * ask->unknowns + j] = J[i][j];
    }
    for (int j = 0; j < ask->unknowns; j++) found[j] = z[j] * ask->size[j];
    weighed_goals(&study, z, left);
    if (study.status == AM_OK) keep_start(&study);
    return study.status;
}

int am_trim(am_sim *sim, int seek) {
    const int status = ready(sim);
    if (status != AM_OK) return status;
    if (seek != 1 && seek != 2) return fail(sim, AM_BAD_ARGUMENT, "mode.trim is %d; allowed: 1 seeks thrust, 2 seeks throttle", seek);
    memset(&sim->trim, 0, sizeof sim->trim);
    return trim_biases(sim, seek);
}
