/* The state at the start, from init.*. */
#include "start.h"

#include "algebra.h"
#include "axes.h"
#include "control_step.h"
#include "earth.h"
#include "elementary.h"
#include "engine.h"
#include "fuel.h"
#include "gear.h"
#include "separation.h"
#include "sixdof.h"
#include "weather.h"

#include <math.h>

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
        const double before = climb;
        climb = (am_tan(sim->par[P_GAMMA]) * sqrt(vn * vn + ve * ve) + wind[2]) / V;
        if (climb == before) break; /* it has settled to the last bit */
    }
    return theta;
}

/* Both separation points at their steady value for the flow angles and body rates of the state. */
void start_separation(am_sim *sim) {
    if (!separates(sim)) return;
    double *state = rate_of(sim, sim->x, G_SEPARATION, 0);
    state[X_SEPARATION_LEFT] = state[X_SEPARATION_RIGHT] = 1.0;
    /* sets the flow and what the tables of the separation may depend on: neither depends on X */
    derivative(sim, sim->x, sim->u, sim->k);
    state[X_SEPARATION_LEFT] = steady_separation(sim, -1.0, false);
    state[X_SEPARATION_RIGHT] = steady_separation(sim, 1.0, false);
}

/* State from init.* with the given flow angles and pitch attitude; the submodels start
 * in equilibrium. */
void start_state(am_sim *sim, double alpha, double beta, double theta) {
    const double *p = sim->par;
    double *x = sim->x;
    double Cn[3][3], flow[3], air[3], wind[3];
    now_t *now = &sim->now;
    /* position, velocity over ground (air-relative velocity plus wind), attitude, body rates */
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
    /* submodels in the order in which they need one another */
    weather_start(sim, sim->time);
    fuel_start(sim);
    set_flight_condition(sim, x, sim->u);
    engine_start(sim, sim->time);
    gear_start(sim);
    control_start(sim);
    start_separation(sim);
    sim->fresh = false;
}
