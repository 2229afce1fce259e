/* Outputs at the present state and inputs. */
#include "outputs.h"

#include "air_data.h"
#include "algebra.h"
#include "earth.h"
#include "elementary_real.h"
#include "envelope.h"
#include "parts.h"
#include "separation.h"

#if LANES == 1
#include "control_outputs.h"
#include "error.h"
#include "once_avx2.h"
#include "prepare.h"
#include "sixdof.h"
#endif

#include <string.h>

#if LANES == 1

static double one_steps_outside(const am_sim *sim) {
    double steps = 0.0;
    for (uint32_t i = 0; i < sim->model->axes; i++) steps += sim->below[i] + sim->above[i];
    return steps;
}

static void one_part_outputs(am_sim *sim, double *y) {
    weather_outputs(sim, y);
    fuel_outputs(sim, y);
    engine_outputs(sim, y);
    gear_outputs(sim, y);
    control_outputs(sim, y);
    separation_outputs(sim, y);
}

#endif

static void attitude_outputs(const now_r *now, real *y) {
    const real n = dot(now->C[0], now->north);
    const real e = dot(now->C[0], now->east);
    const real d = dot(now->C[0], now->down);
    y[Y_PHI] = ATAN2(dot(now->C[1], now->down), dot(now->C[2], now->down));
    y[Y_THETA] = ATAN2(-d, root(n * n + e * e));
    y[Y_PSI] = ATAN2(e, n);
}

static void ground_outputs(flight_t *sim, real *y) {
    now_r *now = &sim->now;
    const real *v = sim->x + 3;
    locate_angles(sim, sim->x, now);
    y[Y_H] = now->h;
    y[Y_H_AGL] = sim->var[A_H_AGL];
    y[Y_LAT] = now->lat;
    y[Y_LON] = now->lon;
    y[Y_VN] = dot(v, now->north);
    y[Y_VE] = dot(v, now->east);
    y[Y_VD] = dot(v, now->down);
    y[Y_HDOT] = -y[Y_VD];
    y[Y_GAMMA] = ATAN2(-y[Y_VD], root(y[Y_VN] * y[Y_VN] + y[Y_VE] * y[Y_VE]));
}

void write_outputs(flight_t *sim, real *y) {
    const now_r *now = &sim->now;
    y[Y_V] = now->V;
    y[Y_V_CAS] = calibrated_airspeed(now->mach, now->p);
    y[Y_MACH] = now->mach;
    y[Y_QBAR] = now->qbar;
    y[Y_ALPHA] = now->alpha;
    y[Y_BETA] = now->beta;
    y[Y_U] = now->u;
    y[Y_V_BODY] = now->v;
    y[Y_W] = now->w;
    y[Y_ALPHA_DOT] = now->alpha_dot;
    y[Y_BETA_DOT] = now->beta_dot;
    for (int i = 0; i < 3; i++) {
        y[Y_P + i] = sim->x[10 + i];
        y[Y_P_DOT + i] = now->angular[i];
        y[Y_AX + i] = now->F[i] / now->mass;
        y[Y_TRIM_DELTA_E + i] = sim->trim.delta[i];
    }
    y[Y_NZ] = -y[Y_AZ] / G0;
    attitude_outputs(now, y);
    ground_outputs(sim, y);
    memcpy(y + Y_CL, now->c, sizeof now->c);
    y[Y_RHO] = now->rho;
    y[Y_P_STATIC] = now->p;
    y[Y_TEMPERATURE] = now->T;
    y[Y_H_BARO] = pressure_altitude(&sim->standard, now->p);
    y[Y_MASS] = now->mass;
    for (int i = 0; i <= U_DELTA_D; i++) y[Y_APPLIED_DELTA_E + i] = applied(sim, sim->u, i);
    y[Y_TRIM_ALPHA] = sim->trim.alpha;
    y[Y_TRIM_BETA] = sim->trim.beta;
    y[Y_TRIM_THRUST] = sim->trim.thrust;
    y[Y_TRIM_THROTTLE] = sim->trim.throttle;
    memcpy(y + Y_TRIM_U_DOT, sim->trim.residual, sizeof sim->trim.residual);
    y[Y_OUT_OF_RANGE] = HOOK(steps_outside)(sim);
    earth_outputs(sim, y);
    envelope_outputs(sim, y);
    HOOK(part_outputs)(sim, y);
}

#if LANES == 1

int refresh(am_sim *sim) {
    const int status = ready(sim);
    if (status != AM_OK || sim->fresh) return status;
    sim->clock = sim->time;
    sim->part = 1.0;
    best_derivative(sim, sim->x, sim->u, sim->k);
    keep_anchor(sim, sim->x);
    sim->fresh = true;
    return AM_OK;
}

int am_outputs(am_sim *sim, double *y) {
    const int status = refresh(sim);
    if (status != AM_OK) return status;
    write_outputs(sim, y);
    return check_finite(sim, AM_OUTPUT, y);
}

#endif
