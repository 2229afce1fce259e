/* What the pilot feels: the force that holds or moves each circuit, and its parts. */
#include "control_outputs.h"

#include "algebra.h"
#include "control_drive.h"

#include <string.h>

/* Inertia, dampers and friction on a body of a circuit that is driven, against its motion. */
static real resistance(const linkage_t *c, const real *d, int i, real friction) {
    return c->mass[i] * d[D_ACCELERATION + i] + c->damping[i] * d[D_RATE + i] + friction;
}

/* Bodies of a driven circuit: their friction, and in mode 0 the cockpit end and the rates of the
 * other bodies. */
static void complete(const flight_t *sim, const linkage_t *c, const loads_t *at, real *d) {
    const bool surfaces = sim->controls == SURFACE_DRIVEN;
    for (int i = 0; i < c->bodies; i++) {
        if (surfaces) {
            d[D_RATE + i] = d[D_RATE];
            d[D_ACCELERATION + i] = d[D_ACCELERATION];
        }
        if (surfaces || i == 0) {
            d[D_FRICTION + i] = c->friction[i] * sign_of(d[D_RATE + i]);
            d[D_STOP + i] = 0.0;
        }
    }
    if (!surfaces || c->bodies == 1) return;
    real stretch = 0.0;
    for (int i = 1; i < c->bodies; i++) {
        stretch += (resistance(c, d, i, d[D_FRICTION + i]) - at->on[i]) / c->cable_stiffness
                   / (c->bodies - 1);
    }
    d[D_TRAVEL] += stretch;
}

static void write_circuit(flight_t *sim, uint32_t item, real *y) {
    const real *p = par_of(sim, G_CIRCUIT, item);
    real d[D_PER_CIRCUIT];
    real *to = output_of(sim, y, G_CIRCUIT, item);
    linkage_t c;
    loads_t at;
    memcpy(d, memory_of(sim, G_CIRCUIT, item), sizeof d);
    circuit_masses(sim, item, &c);
    if (!circuit_moves(sim, item)) set_rigid(d + D_TRAVEL, driven_travel(sim, item, sim->u));
    to[Y_CIRCUIT_DEFLECTION] = control_of_travel(sim, item, d + D_TRAVEL);
    to[Y_CIRCUIT_SYMMETRIC] = symmetric_deflection(sim, item, d + D_TRAVEL);
    circuit_loads(sim, item, sim->x, sim->u, d + D_TRAVEL, circuit_offset(sim, item), &at);
    real force = pilot_force(sim, item, sim->u);
    real friction = 0.0;
    real stop = 0.0;
    if (sim->controls != FORCE_DRIVEN) {
        complete(sim, &c, &at, d);
        force = p[P_CIRCUIT_PRELOAD] * sign_of(d[D_TRAVEL] - circuit_neutral(sim, item, sim->u));
        for (int i = 0; i < c.bodies; i++) {
            force += resistance(&c, d, i, d[D_FRICTION + i]) - at.on[i];
        }
        if (sim->controls == SURFACE_DRIVEN) {
            force += p[P_CIRCUIT_STIFFNESS] * (d[D_TRAVEL] - driven_travel(sim, item, sim->u));
        }
    }
    for (int i = 0; i < c.bodies; i++) {
        friction += d[D_FRICTION + i];
        stop += d[D_STOP + i];
    }
    to[Y_CIRCUIT_TRAVEL] = d[D_TRAVEL];
    to[Y_CIRCUIT_RATE] = d[D_RATE];
    to[Y_CIRCUIT_FORCE] = force;
    to[Y_CIRCUIT_HINGE_MOMENT] = at.hinge_moment;
    to[Y_CIRCUIT_F_AER] = at.aero;
    to[Y_CIRCUIT_F_G] = at.mass;
    to[Y_CIRCUIT_F_NOSE] = at.nose;
    to[Y_CIRCUIT_F_COUL] = friction;
    to[Y_CIRCUIT_F_STOP] = stop;
    to[Y_CIRCUIT_TRIM_FORCE] = d[D_TRIM_FORCE];
}

void control_outputs(flight_t *sim, real *y) {
    for (uint32_t i = 0; i < circuits(sim); i++) write_circuit(sim, i, y);
}
