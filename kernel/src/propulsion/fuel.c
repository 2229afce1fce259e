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
 * them exactly.  The momentum of the fuel that moves to the engines is neglected. */
#include "fuel.h"

#include "algebra.h"
#include "error.h"
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

/* Mass properties with `fuel` in the tanks. */
static mask_t set_mass(flight_t *sim, real fuel) {
    const real *p = sim->par;
    const real *cg0 = p + P_X_CG_B;
    const real *start = memory_of(sim, G_FUEL, 0);
    const real burnt = par_of(sim, G_FUEL, 0)[P_FUEL_START] - fuel;
    now_r *now = &sim->now;
    real moment[MOMENTS], inertia[6];
    fuel_moments(sim, fuel, moment);
    now->mass = p[P_MASS] - burnt;
    for (int k = 0; k < 3; k++) {
        now->cg[k] = cg0[k] - (start[S + k] - moment[S + k] - burnt * cg0[k]) / now->mass;
    }
    for (int k = 0; k < 6; k++) inertia[k] = p[P_IXX + k] - (start[I + k] - moment[I + k]);
    add_point(p[P_MASS], cg0, inertia);
    add_point(-now->mass, now->cg, inertia);
    return set_tensor(now, inertia) & (now->mass > 0.0);
}

void mass_now(flight_t *sim, const real *x) {
    if (items(sim->model, G_FUEL)) set_mass(sim, larger(state_of(sim, x, G_FUEL, 0)[X_FUEL], 0.0));
}

#if ORIGINAL

int fuel_check(am_sim *sim) {
    if (!items(sim->model, G_FUEL)) return AM_OK;
    const uint32_t start = place(sim->model, AM_PARAMETER, G_FUEL, 0) + P_FUEL_START;
    const double fuel = sim->par[start];
    if (!(fuel >= 0.0 && fuel < sim->par[P_MASS])) {
        return bad_parameter(sim, start, "zero or positive, and less than mass.mass");
    }
    fuel_moments(sim, fuel, memory_of(sim, G_FUEL, 0));
    if (!set_mass(sim, 0.0)) {
        return fail(
            sim, AM_BAD_VALUE,
            "without its fuel the aircraft has no positive definite inertia; check init.fuel, "
            "fuel.*, mass.*");
    }
    set_mass(sim, fuel);
    return AM_OK;
}

void fuel_start(am_sim *sim) {
    if (items(sim->model, G_FUEL)) {
        rate_of(sim, sim->x, G_FUEL, 0)[X_FUEL] = par_of(sim, G_FUEL, 0)[P_FUEL_START];
    }
}

#endif

mask_t fuel_left(const flight_t *sim, const real *x) {
    return items(sim->model, G_FUEL) ? state_of(sim, x, G_FUEL, 0)[X_FUEL] > 0.0 : everywhere(true);
}

void burn_fuel(const flight_t *sim, const real *x, real flow, real *dx) {
    if (items(sim->model, G_FUEL)) {
        rate_of(sim, dx, G_FUEL, 0)[X_FUEL] = PICK(fuel_left(sim, x), -flow, 0.0);
    }
}

void fuel_outputs(const flight_t *sim, real *y) {
    if (!items(sim->model, G_FUEL)) return;
    const now_r *now = &sim->now;
    real *to = output_of(sim, y, G_FUEL, 0);
    to[Y_FUEL] = var_of(sim, G_FUEL, 0)[A_FUEL];
    for (int k = 0; k < 3; k++) {
        to[Y_X_CG_B + k] = now->cg[k];
        to[Y_IXX + k] = now->J[k][k];
    }
    to[Y_IXY] = -now->J[0][1];
    to[Y_IXZ] = -now->J[0][2];
    to[Y_IYZ] = -now->J[1][2];
}
