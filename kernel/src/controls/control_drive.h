/* What drives the control circuits, and the deflection that follows. */
#ifndef AEROMATCH_CONTROL_DRIVE_H
#define AEROMATCH_CONTROL_DRIVE_H

#include "control_loads.h"
#include "simulation.h"

static inline uint32_t circuits(const am_sim *sim) { return items(sim->model, G_CIRCUIT); }

/* A circuit without cables whose travel is recorded: it has no motion of its own. */
bool rigid_drive(const am_sim *sim, uint32_t item);

/* A circuit whose bodies move by their own equations. */
bool circuit_moves(const am_sim *sim, uint32_t item);

/* Bias and trim on top of the deflection of a control, and what the air sees of them beyond the
 * deflection of the linkage. [rad] */
double control_bias(const am_sim *sim, int control);
double circuit_offset(const am_sim *sim, uint32_t item);

/* Recorded travel of the cockpit control inside its stops; that of a driven circuit in
 * mode.controls 0 or 1. [m or rad] */
double cockpit_travel(const am_sim *sim, uint32_t item, const double *u);
double driven_travel(const am_sim *sim, uint32_t item, const double *u);

/* All bodies at the same travel. */
void set_rigid(double *q, double s);

/* Force of the pilot with its bias and what the trim added. [N or N m] */
double pilot_force(const am_sim *sim, uint32_t item, const double *u);

/* Deflection of a control that its circuit moves, without bias. [rad] */
double control_deflection(const am_sim *sim, const double *u, int control);

/* Deflection of a control in the air: recorded or from its circuit, with bias and trim. [rad] */
static inline double applied(const am_sim *sim, const double *u, int control) {
    const bool driven = control <= U_DELTA_R && sim->controls != SURFACE_DRIVEN;
    const double deflection = driven ? control_deflection(sim, u, control) : u[control];
    return biased_deflection(sim, deflection, control);
}

#endif
