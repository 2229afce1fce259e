/* Parameters of the core, and what follows from them. */
#include "prepare.h"

#include "air_data.h"
#include "algebra.h"
#include "control_check.h"
#include "engine.h"
#include "error.h"
#include "fuel.h"
#include "gear_check.h"
#include "separation.h"
#include "terms.h"
#include "weather.h"

#include <math.h>
#include <string.h>

#define LARGEST 1e16 /* of a parameter, so that no product of a few overflows */

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

/* A larger one is taken only as the model has it, where it states that there is no limit. */
static int check_sizes(am_sim *sim) {
    const am_entry *parameter = sim->model->entry[AM_PARAMETER];
    for (uint32_t i = 0; i < (uint32_t)sim->model->count[AM_PARAMETER]; i++) {
        if (!(fabs(sim->par[i]) <= LARGEST) && sim->par[i] != parameter[i].value) {
            return bad_parameter(sim, i, "between -1e16 and 1e16");
        }
    }
    return AM_OK;
}

static bool is_choice(double value, int most) {
    return value >= 0.0 && value <= most && value == floor(value);
}

/* Check the parameters and derive what depends on them; done again after a change. */
int prepare(am_sim *sim) {
    if (sim->prepared) return AM_OK;
    const double *p = sim->par;
    if (!(p[P_MASS] > 0.0)) return bad_parameter(sim, P_MASS, "positive");
    if (!(p[P_QNH] > 0.0)) return bad_parameter(sim, P_QNH, "positive");
    if (!(p[P_STEP] >= 1e-6)) return bad_parameter(sim, P_STEP, "at least 1e-6 s");
    if (!(p[P_V] >= 0.0)) return bad_parameter(sim, P_V, "zero or positive");
    if (!(p[P_PHI_RANGE] >= 0.0)) return bad_parameter(sim, P_PHI_RANGE, "zero or positive");
    if (!(fabs(p[P_DELTA_T]) < 100.0)) {
        return bad_parameter(sim, P_DELTA_T, "between -100 and 100 K");
    }
    if (!is_choice(p[P_EARTH], SPHERE_ROTATING)) {
        return bad_parameter(sim, P_EARTH,
                             "0 (flat), 1 (WGS-84), 2 (sphere at rest) or 3 (rotating sphere)");
    }
    if (!is_choice(p[P_ENGINE], MAP_DRIVEN)) {
        return bad_parameter(sim, P_ENGINE,
                             "0 (lever), 1 (N1), 2 (thrust), 3 (torque), 4 (rpm) or 5 (manifold "
                             "pressure driven)");
    }
    if (!is_choice(p[P_CONTROLS], FORCE_DRIVEN)) {
        return bad_parameter(sim, P_CONTROLS,
                             "0 (surfaces), 1 (cockpit positions) or 2 (pilot forces)");
    }
    if (!is_choice(p[P_RATES], RATES_OF_EARTH)) {
        return bad_parameter(sim, P_RATES, "0 (as gyros show them) or 1 (relative to the Earth)");
    }
    if (!is_choice(p[P_TRIM], 3)) {
        return bad_parameter(sim, P_TRIM,
                             "0 (none), 1 (thrust), 2 (throttle) or 3 (on the ground)");
    }
    /* they act at the start only */
    if (!sim->ready) {
        sim->drive = (int)p[P_ENGINE];
        sim->controls = (int)p[P_CONTROLS];
    }
    list_terms(sim);
    int (*const check[])(am_sim *) = {check_sizes,  set_inertia, weather_check, fuel_check,
                                      engine_check, gear_check,  control_check, separation_check};
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
