/* What drives the control circuits, and the deflection that follows. */
#ifndef AEROMATCH_CONTROL_DRIVE_H
#define AEROMATCH_CONTROL_DRIVE_H

#include "control_loads.h"
#include "flight.h"

static inline uint32_t circuits(const flight_t *sim) { return items(sim->model, G_CIRCUIT); }

/* A circuit without cables whose travel is recorded: it has no motion of its own. */
bool rigid_drive(const flight_t *sim, uint32_t item);

/* A circuit whose bodies move by their own equations. */
bool circuit_moves(const flight_t *sim, uint32_t item);

/* Bias and trim on top of the deflection of a control, and what the air sees of them beyond the
 * deflection of the linkage. [rad] */
real control_bias(const flight_t *sim, int control);
real circuit_offset(const flight_t *sim, uint32_t item);

/* Recorded travel of the cockpit control inside its stops; that of a driven circuit in
 * mode.controls 0 or 1. [m or rad] */
real cockpit_travel(const flight_t *sim, uint32_t item, const real *u);
real driven_travel(const flight_t *sim, uint32_t item, const real *u);

/* All bodies at the same travel. */
void set_rigid(real *q, real s);

/* Force of the pilot with its bias and what the trim added. [N or N m] */
real pilot_force(const flight_t *sim, uint32_t item, const real *u);

/* Deflection of a control that its circuit moves, without bias. [rad] */
real control_deflection(const flight_t *sim, const real *u, int control);

/* Deflection of a control in the air: recorded or from its circuit, with bias and trim. [rad] */
static inline real applied(const flight_t *sim, const real *u, int control) {
    const bool driven = control <= U_DELTA_R && sim->controls != SURFACE_DRIVEN;
    const real deflection = driven ? control_deflection(sim, u, control) : u[control];
    return biased_deflection(sim, deflection, control);
}

/* Travel that belongs to the recorded deflection of a control, mode.controls 0. [m or rad] */
static inline real recorded_travel(const flight_t *sim, uint32_t item, const real *u) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    const int control = circuit_control(sim->model, item);
    const real delta = biased_deflection(sim, u[control], control);
    return control == U_DELTA_A ? delta / p[P_CIRCUIT_GEARING] : surface_travel(p, delta);
}

#endif
