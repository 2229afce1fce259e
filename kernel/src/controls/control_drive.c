/* What drives the control circuits.
 *
 *     mode.controls 0   recorded surfaces drive; travel and the force that holds them follow
 *                   1   recorded cockpit positions drive; beyond order 2 cables move the surfaces
 *                   2   recorded pilot forces drive
 *
 * The circuits are stiff and set-valued and so live in the memory: before every step of the
 * rigid body they go from t to t + h in sub-steps (linkage.c).  The load over the step is linear
 * in time and in travel: from the derivative at t, which the step needs anyway, one at the state
 * that an Euler step predicts for t + h, and a difference along the travel.  So the coupling
 * with the flight is of second order.  The derivative takes the deflection linearly between both
 * ends of the step.
 *
 * Modes 1 and 2 start at rest.  In mode 2 the circuit starts at the deflection of the trim; the
 * force that holds it there and the recorded force differ by trim.F_*, which stays added, up to
 * *.trim_limit, less what dry friction holds: the share *.trim_friction of it. */
#include "control_drive.h"

#include "algebra.h"

/* Biases that the core adds to the deflection of a control. */
real control_bias(const flight_t *sim, int control) {
    return sim->par[P_BIAS_DELTA_E + control] + sim->trim.delta[control];
}

/* What the air sees beyond the deflection of the linkage. */
real circuit_offset(const flight_t *sim, uint32_t item) {
    if (sim->controls == SURFACE_DRIVEN) return (real)0.0;
    return control_bias(sim, circuit_control(sim->model, item))
           - memory_of(sim, G_CIRCUIT, item)[D_OFFSET];
}

real cockpit_travel(const flight_t *sim, uint32_t item, const real *u) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    return clamp(input_of(sim, u, G_CIRCUIT, item)[U_CIRCUIT_TRAVEL], p[P_CIRCUIT_LOW],
                 p[P_CIRCUIT_HIGH]);
}

void set_rigid(real *q, real s) {
    for (int i = 0; i < LINKAGE_BODIES; i++) q[i] = s;
}

bool rigid_drive(const flight_t *sim, uint32_t item) {
    return sim->controls == POSITION_DRIVEN && circuit_bodies(par_of(sim, G_CIRCUIT, item)) == 1;
}

/* A circuit whose bodies move by their own equations. */
bool circuit_moves(const flight_t *sim, uint32_t item) {
    return sim->controls != SURFACE_DRIVEN && !rigid_drive(sim, item);
}

real control_deflection(const flight_t *sim, const real *u, int control) {
    for (uint32_t i = 0; i < circuits(sim); i++) {
        if (circuit_control(sim->model, i) != control) continue;
        const real *d = memory_of(sim, G_CIRCUIT, i);
        real q[LINKAGE_BODIES];
        set_rigid(q, cockpit_travel(sim, i, u));
        if (rigid_drive(sim, i)) return control_of_travel(sim, i, q);
        return d[D_FROM] + sim->part * (d[D_TO] - d[D_FROM]) - d[D_OFFSET];
    }
    return u[control];
}

/* Travel of the cockpit end of a circuit that is driven, mode 0 or 1. */
real driven_travel(const flight_t *sim, uint32_t item, const real *u) {
    if (sim->controls == POSITION_DRIVEN) return cockpit_travel(sim, item, u);
    return recorded_travel(sim, item, u);
}

real pilot_force(const flight_t *sim, uint32_t item, const real *u) {
    return input_of(sim, u, G_CIRCUIT, item)[U_CIRCUIT_FORCE]
           + par_of(sim, G_CIRCUIT, item)[P_CIRCUIT_BIAS_FORCE]
           + memory_of(sim, G_CIRCUIT, item)[D_TRIM_FORCE];
}
