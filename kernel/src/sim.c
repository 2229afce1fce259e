/* A simulation: its memory, parameters and inputs, and the state at the start. */
#include "elementary.h"
#include "model.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EARTH_RATE 7.292115e-5 /* WGS-84 [rad s-1] */
#define LARGEST 1e16           /* of a parameter, so that no product of a few overflows */

static double *take(double **at, size_t n) {
    double *piece = *at;
    *at += n;
    return piece;
}

size_t sim_size(const am_model *m) {
    const size_t nx = (size_t)am_state_count(m);
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t np = (size_t)m->count[AM_PARAMETER];
    const size_t na = m->axes;
    const size_t doubles = np + 3 * nu + (size_t)m->count[AM_OUTPUT] + 6 * nx
                           + m->total[AM_VARIABLE] + m->slots + m->places + m->total[AM_TARGET]
                           + 3 * na + 2 * (size_t)m->memories + m->works;
    return sizeof(am_sim) + doubles * sizeof(double) + (na + m->bundles) * sizeof(uint32_t);
}

am_sim *am_new(const am_model *m) {
    const size_t nx = (size_t)am_state_count(m);
    const size_t nu = (size_t)m->count[AM_INPUT];
    const size_t np = (size_t)m->count[AM_PARAMETER];
    const size_t na = m->axes;
    am_sim *sim = calloc(1, m->sim_bytes);
    if (!sim) return NULL;
    sim->model = m;
    double *at = (double *)(sim + 1);
    sim->par = take(&at, np);
    sim->u = take(&at, nu);
    sim->u_work = take(&at, nu);
    sim->u_end = take(&at, nu);
    sim->y_work = take(&at, (size_t)m->count[AM_OUTPUT]);
    sim->x = take(&at, nx);
    sim->x_work = take(&at, nx);
    sim->k = take(&at, 4 * nx);
    sim->var = take(&at, m->total[AM_VARIABLE]);
    sim->slot = take(&at, m->slots);
    sim->term = take(&at, m->places);
    sim->sum = take(&at, m->total[AM_TARGET]);
    sim->memory = take(&at, m->memories);
    sim->memory_before = take(&at, m->memories);
    sim->work = take(&at, m->works);
    sim->fraction = take(&at, na);
    sim->below = take(&at, na);
    sim->above = take(&at, na);
    sim->cell = (uint32_t *)at;
    sim->corner = sim->cell + na;
    sim->scale = sim->par + m->total[AM_PARAMETER];
    sim->exponent = sim->scale + m->terms;
    for (size_t i = 0; i < np; i++) sim->par[i] = m->entry[AM_PARAMETER][i].value;
    for (size_t i = 0; i < nu; i++) sim->u[i] = m->entry[AM_INPUT][i].value;
    sim->slot[0] = sim->var[A_ONE] = sim->part = 1.0;
    settle_cells(sim);
    return sim;
}

void am_delete(am_sim *sim) { free(sim); }

int am_copy(am_sim *to, const am_sim *from) {
    if (to->model != from->model) {
        return fail(to, AM_BAD_ARGUMENT,
                    "a simulation can only be copied to one of the same model");
    }
    const size_t start = offsetof(am_sim, now);
    if (to != from) {
        memcpy((char *)to + start, (const char *)from + start, to->model->sim_bytes - start);
    }
    return AM_OK;
}

int fail(am_sim *sim, int status, const char *format, ...) {
    va_list list;
    va_start(list, format);
    vsnprintf(sim->text, sizeof sim->text, format, list);
    va_end(list);
    return status;
}

const char *am_error(const am_sim *sim) { return sim->text; }

double am_time(const am_sim *sim) { return sim->time; }

void take_inputs(am_sim *sim, const double *u) {
    memcpy(sim->u, u, sizeof(double) * (size_t)sim->model->count[AM_INPUT]);
    sim->fresh = false;
}

int check_finite(am_sim *sim, am_kind kind, const double *values) {
    const am_model *m = sim->model;
    if (all_finite(values, (size_t)m->count[kind])) return AM_OK;
    int i = 0;
    while (isfinite(values[i])) i++;
    return fail(
        sim, AM_NOT_FINITE,
        "%s is not finite at t = %g s; the model has diverged, or its numbers have no meaning",
        m->entry[kind][i].name, sim->time);
}

static int refuse_value(am_sim *sim, am_kind kind, int i, double value) {
    return fail(sim, AM_NOT_FINITE, "%s is %g; it must be finite", sim->model->entry[kind][i].name,
                value);
}

int am_set_parameter(am_sim *sim, int i, double value) {
    if (i < 0) return fail(sim, AM_BAD_INDEX, "there is no parameter %d", i);
    const bool catalogued = i < sim->model->count[AM_PARAMETER];
    if (!isfinite(value) && catalogued) return refuse_value(sim, AM_PARAMETER, i, value);
    if (!isfinite(value)) {
        return fail(sim, AM_NOT_FINITE,
                    "a node, scale or offset of a table is %g; it must be finite", value);
    }
    if (catalogued) {
        sim->par[i] = value;
    } else {
        const int status = set_table_parameter(sim, (uint32_t)i, value);
        if (status != AM_OK) return status;
    }
    sim->prepared = sim->fresh = false;
    return AM_OK;
}

int am_get_parameter(const am_sim *sim, int i, double *value) {
    if (i < 0) return AM_BAD_INDEX;
    if (i >= sim->model->count[AM_PARAMETER]) return get_table_parameter(sim, (uint32_t)i, value);
    *value = sim->par[i];
    return AM_OK;
}

int am_set_input(am_sim *sim, int i, double value) {
    if (i < 0 || i >= sim->model->count[AM_INPUT]) {
        return fail(sim, AM_BAD_INDEX, "there is no input %d", i);
    }
    if (!isfinite(value)) return refuse_value(sim, AM_INPUT, i, value);
    sim->u[i] = value;
    sim->fresh = false;
    return AM_OK;
}

int am_get_input(const am_sim *sim, int i, double *value) {
    if (i < 0 || i >= sim->model->count[AM_INPUT]) return AM_BAD_INDEX;
    *value = sim->u[i];
    return AM_OK;
}

int am_set_inputs(am_sim *sim, const double *u) {
    for (int i = 0; i < sim->model->count[AM_INPUT]; i++) {
        if (!isfinite(u[i])) return refuse_value(sim, AM_INPUT, i, u[i]);
    }
    take_inputs(sim, u);
    return AM_OK;
}

int am_get_inputs(const am_sim *sim, double *u) {
    memcpy(u, sim->u, sizeof(double) * (size_t)sim->model->count[AM_INPUT]);
    return AM_OK;
}

int bad_parameter(am_sim *sim, uint32_t parameter, const char *rule) {
    return fail(sim, AM_BAD_VALUE, "%s is %g; it must be %s",
                sim->model->entry[AM_PARAMETER][parameter].name, sim->par[parameter], rule);
}

/* Mass properties without fuel: inertia tensor about the c.g. and its inverse; the products are
 * integrals of xy dm and so on. */
static int set_inertia(am_sim *sim) {
    const double *p = sim->par;
    now_t *now = &sim->now;
    const double J[3][3] = {{p[P_IXX], -p[P_IXY], -p[P_IXZ]},
                            {-p[P_IXY], p[P_IYY], -p[P_IYZ]},
                            {-p[P_IXZ], -p[P_IYZ], p[P_IZZ]}};
    double n[3][3];
    cross(J[1], J[2], n[0]);
    cross(J[2], J[0], n[1]);
    cross(J[0], J[1], n[2]);
    const double det = dot(J[0], n[0]);
    const double minor = J[0][0] * J[1][1] - J[0][1] * J[1][0];
    if (!(J[0][0] > 0.0 && minor > 0.0 && det > 0.0)) {
        return fail(
            sim, AM_BAD_VALUE,
            "mass.Ixx ... mass.Iyz do not make a positive definite inertia tensor; check the "
            "moments and products");
    }
    memcpy(now->J, J, sizeof J);
    memcpy(now->cg, p + P_X_CG_B, sizeof now->cg);
    now->mass = p[P_MASS];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) now->J_inverse[i][j] = n[j][i] / det;
    }
    return AM_OK;
}

/* A larger one is taken only as the model has it, where it says that there is no limit. */
static int check_sizes(am_sim *sim) {
    const am_entry *parameter = sim->model->entry[AM_PARAMETER];
    for (uint32_t i = 0; i < (uint32_t)sim->model->count[AM_PARAMETER]; i++) {
        if (!(fabs(sim->par[i]) <= LARGEST) && sim->par[i] != parameter[i].value) {
            return bad_parameter(sim, i, "between -1e16 and 1e16");
        }
    }
    return AM_OK;
}

static bool whole(double value, int most) {
    return value >= 0.0 && value <= most && value == floor(value);
}

/* Check the parameters and derive what depends on them; done again after a change. */
static int prepare(am_sim *sim) {
    if (sim->prepared) return AM_OK;
    const double *p = sim->par;
    if (!(p[P_MASS] > 0.0)) return bad_parameter(sim, P_MASS, "positive");
    if (!(p[P_QNH] > 0.0)) return bad_parameter(sim, P_QNH, "positive");
    if (!(p[P_STEP] >= 1e-6)) return bad_parameter(sim, P_STEP, "at least 1e-6 s");
    if (!(p[P_V] >= 0.0)) return bad_parameter(sim, P_V, "zero or positive");
    if (!(fabs(p[P_DELTA_T]) < 100.0)) {
        return bad_parameter(sim, P_DELTA_T, "between -100 and 100 K");
    }
    if (!whole(p[P_EARTH], SPHERE_ROTATING)) {
        return bad_parameter(sim, P_EARTH,
                             "0 (flat), 1 (WGS-84), 2 (sphere at rest) or 3 (rotating sphere)");
    }
    if (!whole(p[P_ENGINE], THRUST_DRIVEN)) {
        return bad_parameter(sim, P_ENGINE, "0 (lever), 1 (N1) or 2 (thrust driven)");
    }
    if (!whole(p[P_CONTROLS], FORCE_DRIVEN)) {
        return bad_parameter(sim, P_CONTROLS,
                             "0 (surfaces), 1 (cockpit positions) or 2 (pilot forces)");
    }
    if (!whole(p[P_RATES], RATES_OF_EARTH)) {
        return bad_parameter(sim, P_RATES, "0 (as gyros show them) or 1 (relative to the Earth)");
    }
    if (!whole(p[P_TRIM], 3)) {
        return bad_parameter(sim, P_TRIM,
                             "0 (none), 1 (seek thrust), 2 (seek throttle) or 3 (on the ground)");
    }
    /* they act at the start only */
    if (!sim->ready) {
        sim->drive = (int)p[P_ENGINE];
        sim->controls = (int)p[P_CONTROLS];
    }
    int (*const check[])(am_sim *) = {check_sizes,  set_inertia, weather_check, fuel_check,
                                      engine_check, gear_check,  control_check};
    for (size_t i = 0; i < sizeof check / sizeof check[0]; i++) {
        const int status = check[i](sim);
        if (status != AM_OK) return status;
    }
    set_standard(&sim->standard);
    set_atmosphere(&sim->atmosphere, p[P_DELTA_T], p[P_QNH]);
    sim->prepared = true;
    return AM_OK;
}

int ready(am_sim *sim) {
    if (!sim->ready) {
        return fail(sim, AM_NOT_READY,
                    "the simulation has not been initialised; call am_initialize first");
    }
    return prepare(sim);
}

int refresh(am_sim *sim) {
    const int status = ready(sim);
    if (status != AM_OK || sim->fresh) return status;
    sim->clock = sim->time;
    sim->part = 1.0;
    derivative(sim, sim->x, sim->u, sim->k);
    set_anchor(sim->x, sim->earth, &sim->now, &sim->anchor);
    sim->fresh = true;
    return AM_OK;
}

/* Velocity relative to the air in body axes, over V. */
static void flow_direction(double alpha, double beta, double to[3]) {
    double sa, ca, sb, cb;
    am_sincos(alpha, &sa, &ca);
    am_sincos(beta, &sb, &cb);
    to[0] = ca * cb;
    to[1] = sb;
    to[2] = sa * cb;
}

/* Pitch attitude for a climb angle over ground, with bank, alpha and beta: Stevens and Lewis
 * (1992) eq. (3.4-2), with the climb angle relative to the air found by iteration when there is
 * wind. */
double start_pitch(const am_sim *sim, double alpha, double beta) {
    const double phi = sim->par[P_PHI];
    const double V = sim->par[P_V];
    double flow[3];
    double theta = 0.0;
    double C[3][3], air[3], wind[3];
    flow_direction(alpha, beta, flow);
    const double a = flow[0];
    const double b = am_sin(phi) * flow[1] + am_cos(phi) * flow[2];
    const double velocity[3] = {V * a, V * flow[1], V * flow[2]};
    double climb = am_sin(sim->par[P_GAMMA]);
    steady_wind(sim, sim->u, sim->par[P_H], wind);
    for (int i = 0; i < 20; i++) {
        const double s = climb * climb;
        const double root = a * a - s + b * b;
        theta = am_atan2(a * b + climb * sqrt(root > 0.0 ? root : 0.0), a * a - s);
        if (wind[0] == 0.0 && wind[1] == 0.0 && wind[2] == 0.0) break;
        euler_matrix(phi, theta, sim->par[P_PSI], C);
        from_body(C, velocity, air);
        const double vn = air[0] + wind[0];
        const double ve = air[1] + wind[1];
        climb = (am_tan(sim->par[P_GAMMA]) * sqrt(vn * vn + ve * ve) + wind[2]) / V;
    }
    return theta;
}

/* State from init.* with the given flow angles and pitch attitude; the submodels settle. */
void start_state(am_sim *sim, double alpha, double beta, double theta) {
    const double *p = sim->par;
    double *x = sim->x;
    double Cn[3][3], flow[3], air[3], wind[3];
    now_t *now = &sim->now;
    place_at(p[P_LAT], p[P_LON], p[P_H], sim->earth, x, now);
    steady_wind(sim, sim->u, p[P_H], wind);
    euler_matrix(p[P_PHI], theta, p[P_PSI], Cn);
    flow_direction(alpha, beta, flow);
    const double velocity[3] = {p[P_V] * flow[0], p[P_V] * flow[1], p[P_V] * flow[2]};
    from_body(Cn, velocity, air);
    for (int i = 0; i < 3; i++) {
        x[3 + i] = (air[0] + wind[0]) * now->north[i] + (air[1] + wind[1]) * now->east[i]
                   + (air[2] + wind[2]) * now->down[i];
        for (int k = 0; k < 3; k++) {
            now->C[k][i] = Cn[k][0] * now->north[i] + Cn[k][1] * now->east[i]
                           + Cn[k][2] * now->down[i];
        }
        x[10 + i] = p[P_P + i];
    }
    matrix_quaternion(now->C, x + 6);
    sim->clock = sim->time;
    sim->part = 1.0;
    weather_start(sim, sim->time);
    fuel_start(sim, sim->time);
    look_around(sim, x, sim->u);
    engine_start(sim, sim->time);
    gear_start(sim, sim->time);
    control_start(sim, sim->time);
    sim->fresh = false;
}

int am_initialize(am_sim *sim, double t) {
    sim->ready = sim->prepared = false;
    sim->text[0] = 0;
    if (!(fabs(t) <= LATEST)) {
        return fail(sim, AM_BAD_ARGUMENT,
                    "the start time is %g s; it must be finite and within 1e10 s", t);
    }
    int status = prepare(sim);
    if (status != AM_OK) return status;
    const double *p = sim->par;
    sim->earth = (int)p[P_EARTH];
    sim->omega = sim->earth == WGS84_EARTH || sim->earth == SPHERE_ROTATING ? EARTH_RATE : 0.0;
    sim->time = t;
    memset(&sim->trim, 0, sizeof sim->trim);
    memset(sim->below, 0, sizeof(double) * sim->model->axes);
    memset(sim->above, 0, sizeof(double) * sim->model->axes);
    start_state(sim, p[P_ALPHA], p[P_BETA], p[P_THETA]);
    if ((status = check_finite(sim, AM_STATE, sim->x)) != AM_OK) return status;
    sim->ready = true;
    if (p[P_TRIM] != 0.0) status = am_trim(sim, (int)p[P_TRIM]);
    sim->ready = status == AM_OK;
    return status;
}

int am_get_state(const am_sim *sim, double *x) {
    memcpy(x, sim->x, sizeof(double) * (size_t)am_state_count(sim->model));
    return AM_OK;
}

int am_set_state(am_sim *sim, const double *x) {
    for (int i = 0; i < am_state_count(sim->model); i++) {
        if (!isfinite(x[i])) return refuse_value(sim, AM_STATE, i, x[i]);
    }
    memcpy(sim->x, x, sizeof(double) * (size_t)am_state_count(sim->model));
    sim->fresh = false;
    return AM_OK;
}

int am_derivative(am_sim *sim, const double *x, const double *u, double *dx) {
    int status = ready(sim);
    if (status != AM_OK) return status;
    sim->fresh = false;
    sim->clock = sim->time;
    sim->part = 1.0;
    derivative(sim, x, u, dx);
    return check_finite(sim, AM_STATE, dx);
}

int am_complete_step(am_sim *sim, double t) {
    const int status = ready(sim);
    if (status != AM_OK) return status;
    if (!(t >= sim->time && t <= LATEST)) {
        return fail(
            sim, AM_BAD_ARGUMENT,
            "a step is completed at %g s, but the simulation stands at %g s; times go on, up to "
            "1e10 s",
            t, sim->time);
    }
    if (t > sim->time) advance_memory(sim, sim->time, t - sim->time, sim->u, sim->u);
    sim->time = t;
    sim->fresh = false;
    refresh(sim);
    count_outside(sim);
    return AM_OK;
}

int am_out_of_range(const am_sim *sim, double *below, double *above) {
    memcpy(below, sim->below, sizeof(double) * sim->model->axes);
    memcpy(above, sim->above, sizeof(double) * sim->model->axes);
    return AM_OK;
}
