/* Mass properties of the moment.
 *
 * mass.* are those of the aircraft with init.fuel in the tanks; what has been burnt since is
 * subtracted:
 *
 *     m = m0 - dm
 *     m c = m0 c0 - dS
 *     J + m [c] = J0 + m0 [c0] - dI             [c]: parallel-axis term of c
 *
 * S and I are the first and second moments of the fuel about the moment reference point: those
 * of a mass point at fuel.x, y, z plus the tables over `fuel`.  For point tanks drained one
 * after the other or in proportion both are piecewise linear in the fuel, so that tables hold
 * them exactly.  Tanks with a state each are mass points too; mass.* are then those with
 * mass.tank.*.fuel in them, and the start has init.tank.*.fuel.  The momentum of the fuel that
 * moves to the engines is neglected. */
#include "fuel.h"

#include "algebra.h"
#include "error.h"
#include "feed.h"
#include "terms.h"

#include <string.h>

/* S: x y z; I: xx yy zz xy xz yz, products as integrals of xy dm and so on */
enum { S = 0, I = 3, MOMENTS = 9 };

/* Adds m times the second moments of a point at r. */
static void add_point(real m, const real r[3], real moment[6]) {
    const real xx = r[0] * r[0];
    const real yy = r[1] * r[1];
    const real zz = r[2] * r[2];
    moment[0] += m * (yy + zz);
    moment[1] += m * (xx + zz);
    moment[2] += m * (xx + yy);
    moment[3] += m * (r[0] * r[1]);
    moment[4] += m * (r[0] * r[2]);
    moment[5] += m * (r[1] * r[2]);
}

static void fuel_moments(flight_t *sim, real fuel, real moment[MOMENTS]) {
    const real *p = par_of(sim, G_FUEL, 0);
    const real *r = p + P_FUEL_X;
    const real *table = sum_of(sim, G_FUEL, 0) + T_MOMENT_X;
    var_of(sim, G_FUEL, 0)[A_FUEL] = fuel;
    evaluate_stage(sim, STAGE_MASS);
    for (int k = 0; k < 3; k++) moment[S + k] = fuel * r[k];
    for (int k = 0; k < 6; k++) moment[I + k] = 0.0;
    add_point(fuel, r, moment + I);
    for (int k = 0; k < MOMENTS; k++) moment[k] += table[k];
}

/* Those of tanks with a state each, which hold so much; returns its sum. */
static real tank_moments(const flight_t *sim, const real held[MAX_ITEMS], real moment[MOMENTS]) {
    real all = 0.0;
    for (int k = 0; k < MOMENTS; k++) moment[k] = 0.0;
    for (uint32_t i = 0; i < items(sim->model, G_TANK); i++) {
        const real *r = par_of(sim, G_TANK, i) + P_TANK_X;
        all += held[i];
        for (int k = 0; k < 3; k++) moment[S + k] += held[i] * r[k];
        add_point(held[i], r, moment + I);
    }
    return all;
}

/* Tensor and its inverse from moments and products, both symmetric to the last bit; false when it
 * is not positive definite. */
static mask_t set_tensor(now_r *now, const real i[6]) {
    const real J[3][3] = {{i[0], -i[3], -i[4]}, {-i[3], i[1], -i[5]}, {-i[4], -i[5], i[2]}};
    real n[3][3];
    cross(J[1], J[2], n[0]);
    cross(J[2], J[0], n[1]);
    cross(J[0], J[1], n[2]);
    const real det = dot(J[0], n[0]);
    memcpy(now->J, J, sizeof J);
    for (int r = 0; r < 3; r++) {
        for (int c = r; c < 3; c++) now->J_inverse[r][c] = now->J_inverse[c][r] = n[c][r] / det;
    }
    return (J[0][0] > 0.0) & (J[0][0] * J[1][1] - J[0][1] * J[1][0] > 0.0) & (det > 0.0);
}

/* Mass properties when `burnt` is gone of the fuel with the moments `start`, the rest has `moment`.
 */
static mask_t set_rest(flight_t *sim, real burnt, const real start[MOMENTS],
                       const real moment[MOMENTS]) {
    const real *p = sim->par;
    const real *cg0 = p + P_X_CG_B;
    now_r *now = &sim->now;
    real inertia[6];
    now->mass = p[P_MASS] - burnt;
    for (int k = 0; k < 3; k++) {
        now->cg[k] = cg0[k] - (start[S + k] - moment[S + k] - burnt * cg0[k]) / now->mass;
    }
    for (int k = 0; k < 6; k++) inertia[k] = p[P_IXX + k] - (start[I + k] - moment[I + k]);
    add_point(p[P_MASS], cg0, inertia);
    add_point(-now->mass, now->cg, inertia);
    return set_tensor(now, inertia) & (now->mass > 0.0);
}

/* Mass properties with `fuel` on board; not in the way of models without. */
__attribute__((noinline)) static mask_t set_mass(flight_t *sim, real fuel) {
    real moment[MOMENTS];
    const real burnt = par_of(sim, G_FUEL, 0)[P_FUEL_START] - fuel;
    fuel_moments(sim, fuel, moment);
    return set_rest(sim, burnt, memory_of(sim, G_FUEL, 0), moment);
}

/* Mass properties with `held` in the tanks. */
static mask_t set_tanks(flight_t *sim, const real held[MAX_ITEMS]) {
    real moment[MOMENTS];
    const real *start = memory_of(sim, G_TANKS, 0);
    const real fuel = tank_moments(sim, held, moment);
    work_of(sim, G_TANKS, 0)[W_FUEL] = fuel;
    return set_rest(sim, start[MOMENTS] - fuel, start, moment);
}

static inline real in_tank(const flight_t *sim, const real *x, uint32_t i) {
    return larger(state_of(sim, x, G_TANK, i)[X_TANK], 0.0);
}

__attribute__((noinline)) static void mass_with_tanks(flight_t *sim, const real *x) {
    real held[MAX_ITEMS];
    for (uint32_t i = 0; i < items(sim->model, G_TANK); i++) held[i] = in_tank(sim, x, i);
    set_tanks(sim, held);
}

void mass_now(flight_t *sim, const real *x) {
    if (items(sim->model, G_FUEL)) set_mass(sim, larger(state_of(sim, x, G_FUEL, 0)[X_FUEL], 0.0));
    else if (items(sim->model, G_TANK)) mass_with_tanks(sim, x);
}

#if ORIGINAL

static int no_inertia(am_sim *sim, const char *parameters) {
    return fail(
        sim, AM_BAD_VALUE,
        "without its fuel the aircraft has no positive definite inertia; check %s, mass.*",
        parameters);
}

/* What a parameter of the tanks states for each. */
static void list_contents(const am_sim *sim, uint32_t code, double held[MAX_ITEMS]) {
    for (uint32_t i = 0; i < items(sim->model, G_TANK); i++) {
        held[i] = par_of(sim, G_TANK, i)[code];
    }
}

static int tanks_check(am_sim *sim) {
    double held[MAX_ITEMS] = {0.0};
    double empty[MAX_ITEMS] = {0.0};
    for (uint32_t i = 0; i < items(sim->model, G_TANK); i++) {
        const uint32_t first = place(sim->model, AM_PARAMETER, G_TANK, i);
        const double *p = par_of(sim, G_TANK, i);
        if (!(p[P_TANK_CAPACITY] > 0.0)) {
            return bad_parameter(sim, first + P_TANK_CAPACITY, "positive");
        }
        for (uint32_t code = P_TANK_START; code <= P_TANK_WEIGHED; code++) {
            if (p[code] >= 0.0 && p[code] <= p[P_TANK_CAPACITY]) continue;
            return bad_parameter(sim, first + code, "between zero and the capacity of the tank");
        }
    }
    int status = feeds_check(sim);
    if (status == AM_OK) status = transfers_check(sim);
    if (status != AM_OK) return status;
    double *start = memory_of(sim, G_TANKS, 0);
    list_contents(sim, P_TANK_WEIGHED, held);
    start[MOMENTS] = tank_moments(sim, held, start);
    if (!(start[MOMENTS] < sim->par[P_MASS])) {
        return fail(sim, AM_BAD_VALUE,
                    "mass.tank.*.fuel have a sum of %g kg, mass.mass is %g kg; it includes them",
                    start[MOMENTS], sim->par[P_MASS]);
    }
    if (!set_tanks(sim, empty)) return no_inertia(sim, "mass.tank.*, tank.*");
    list_contents(sim, P_TANK_START, held);
    set_tanks(sim, held);
    return AM_OK;
}

int fuel_check(am_sim *sim) {
    if (items(sim->model, G_TANK)) return tanks_check(sim);
    if (!items(sim->model, G_FUEL)) return AM_OK;
    const uint32_t start = place(sim->model, AM_PARAMETER, G_FUEL, 0) + P_FUEL_START;
    const double fuel = sim->par[start];
    if (!(fuel >= 0.0 && fuel < sim->par[P_MASS])) {
        return bad_parameter(sim, start, "zero or positive, and less than mass.mass");
    }
    fuel_moments(sim, fuel, memory_of(sim, G_FUEL, 0));
    if (!set_mass(sim, 0.0)) return no_inertia(sim, "init.fuel, fuel.*");
    set_mass(sim, fuel);
    return AM_OK;
}

void fuel_start(am_sim *sim) {
    if (items(sim->model, G_FUEL)) {
        rate_of(sim, sim->x, G_FUEL, 0)[X_FUEL] = par_of(sim, G_FUEL, 0)[P_FUEL_START];
    }
    for (uint32_t i = 0; i < items(sim->model, G_TANK); i++) {
        rate_of(sim, sim->x, G_TANK, i)[X_TANK] = par_of(sim, G_TANK, i)[P_TANK_START];
    }
}

#endif

static inline mask_t fuel_on_board(const flight_t *sim, const real *x) {
    return items(sim->model, G_FUEL) ? state_of(sim, x, G_FUEL, 0)[X_FUEL] > 0.0 : everywhere(true);
}

mask_t fuel_left(const flight_t *sim, uint32_t engine, const real *x, const real *u) {
    return items(sim->model, G_TANK) ? fuel_fed(sim, engine, x, u) : fuel_on_board(sim, x);
}

void burn_fuel(const flight_t *sim, const real *x, real flow, real *dx) {
    if (items(sim->model, G_FUEL)) {
        rate_of(sim, dx, G_FUEL, 0)[X_FUEL] = PICK(fuel_on_board(sim, x), -flow, 0.0);
    }
}

_Static_assert(Y_TANKS_FUEL == Y_FUEL && Y_TANKS_IYZ == Y_IYZ, "one order of both groups");

static void mass_outputs(const now_r *now, real fuel, real *to) {
    to[Y_FUEL] = fuel;
    for (int k = 0; k < 3; k++) {
        to[Y_X_CG_B + k] = now->cg[k];
        to[Y_IXX + k] = now->J[k][k];
    }
    to[Y_IXY] = -now->J[0][1];
    to[Y_IXZ] = -now->J[0][2];
    to[Y_IYZ] = -now->J[1][2];
}

void fuel_outputs(const flight_t *sim, real *y) {
    const am_model *m = sim->model;
    if (items(m, G_FUEL)) {
        mass_outputs(&sim->now, var_of(sim, G_FUEL, 0)[A_FUEL], output_of(sim, y, G_FUEL, 0));
    }
    if (!items(m, G_TANK)) return;
    mass_outputs(&sim->now, work_of(sim, G_TANKS, 0)[W_FUEL], output_of(sim, y, G_TANKS, 0));
    for (uint32_t i = 0; i < items(m, G_TANK); i++) {
        output_of(sim, y, G_TANK, i)[Y_TANK] = in_tank(sim, sim->x, i);
    }
    for (uint32_t i = 0; i < items(m, G_TRANSFER); i++) {
        output_of(sim, y, G_TRANSFER, i)[Y_TRANSFER] = work_of(sim, G_TRANSFER, i)[W_TRANSFER];
    }
}
