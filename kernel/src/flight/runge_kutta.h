/* Classical Runge-Kutta with a fixed step. */
#ifndef AEROMATCH_RUNGE_KUTTA_H
#define AEROMATCH_RUNGE_KUTTA_H

#include "earth.h"
#include "four.h"
#include "sixdof.h"

static inline void blend(const am_model *m, const real *u0, const real *u1, double s, real *u) {
    const int n = m->count[AM_INPUT];
    int i = 0;
#if LANES == 1
    for (; i + 4 <= n; i += 4) PUT(u + i) = AT(u0 + i) + (AT(u1 + i) - AT(u0 + i)) * s;
#endif
    for (; i < n; i++) u[i] = u0[i] + (u1[i] - u0[i]) * s;
}

/* Rates of the rigid body have just been stored one by one, so that vectors of them would wait;
 * those of the submodels behind them are older. */
#define CORE_STATES (X_R + 1)

static inline void advance(int n, const real *restrict x, double h, const real *restrict dx,
                           real *restrict to) {
    int i = 0;
    for (; i < CORE_STATES; i++) to[i] = x[i] + h * dx[i];
#if LANES == 1
    for (; i + 4 <= n; i += 4) PUT(to + i) = AT(x + i) + h * AT(dx + i);
#endif
    for (; i < n; i++) to[i] = x[i] + h * dx[i];
}

/* x + h (k1 + 2 k2 + 2 k3 + k4) / 6 */
static inline void combine(int n, const real *restrict x, double h, const real *restrict k1,
                           real *restrict to) {
    const real *k2 = k1 + n;
    const real *k3 = k2 + n;
    const real *k4 = k3 + n;
    const double sixth = h / 6.0;
    int i = 0;
    for (; i < CORE_STATES; i++) to[i] = x[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
#if LANES == 1
    for (; i + 4 <= n; i += 4) {
        PUT(to + i) = AT(x + i)
                      + sixth * (AT(k1 + i) + 2.0 * (AT(k2 + i) + AT(k3 + i)) + AT(k4 + i));
    }
#endif
    for (; i < n; i++) to[i] = x[i] + sixth * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
}

static inline void slope(flight_t *sim, double t, double h, double part, const real *x,
                         const real *u, real *k) {
    sim->part = part;
    sim->clock = t + part * h;
    derivative(sim, x, u, k);
}

/* Inputs at a part of u0 ... u1; u0 itself when they are held. */
static inline const real *inputs_at(const flight_t *sim, const real *u0, const real *u1, double s,
                                    real *u) {
    if (u0 == u1) return u0;
    blend(sim->model, u0, u1, s, u);
    return u;
}

/* Parameters of this step, functions of the unit that includes it (one_step.c or laned_flight.h):
 * whether the last call left the derivative at the inputs u; the discrete part of the submodels
 * from t to t + h; the slope at the start of a step in k; steps outside the tables. */
static mask_t HOOK(can_reuse)(const flight_t *sim, const real *u);
static void HOOK(advance_parts)(flight_t *sim, double t, double h, const real *u0, const real *u1);
static void HOOK(first_slope)(flight_t *sim, double t, double h, const real *u, mask_t reuse);
static void HOOK(count_steps_outside)(flight_t *sim, mask_t counts);

/* Leaves the new state in x_work; s0 ... s1 is the part of u0 ... u1 that this step from t
 * covers. */
static inline void runge_kutta(flight_t *sim, double t, double h, const real *u0, const real *u1,
                               double s0, double s1) {
    const am_model *m = sim->model;
    const int n = am_state_count(m);
    real *k1 = sim->k;
    real *k2 = k1 + n;
    real *k3 = k2 + n;
    real *k4 = k3 + n;
    real *x = sim->x;
    real *to = sim->x_work;
    const real *u_end = inputs_at(sim, u0, u1, s1, sim->u_end);
    const real *u = inputs_at(sim, u0, u1, s0, sim->u_work);
    /* cells of the start of the step: circuits that move look at its end */
    const mask_t reuse = HOOK(can_reuse)(sim, u);
    HOOK(count_steps_outside)(sim, reuse);
    /* the discrete part goes first: it stands still in the derivatives of this step */
    HOOK(advance_parts)(sim, t, h, u, u_end);
    /* the first slope, unless the last call left it */
    HOOK(first_slope)(sim, t, h, u, reuse);
    HOOK(count_steps_outside)(sim, NOT(reuse));
    sim->anchored = sim->earth != FLAT_EARTH;
    /* two slopes at the middle, one at the end */
    u = inputs_at(sim, u0, u1, 0.5 * (s0 + s1), sim->u_work);
    advance(n, x, 0.5 * h, k1, to);
    slope(sim, t, h, 0.5, to, u, k2);
    advance(n, x, 0.5 * h, k2, to);
    slope(sim, t, h, 0.5, to, u, k3);
    advance(n, x, h, k3, to);
    slope(sim, t, h, 1.0, to, u_end, k4);
    sim->anchored = false;
    sim->last_power[0] = 0.0; /* a power from the anchor does not hold beyond the step */
    combine(n, x, h, k1, to);
}

#endif
