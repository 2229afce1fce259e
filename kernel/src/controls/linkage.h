/* The moving parts of a control circuit: up to three bodies with springs, dampers, dry friction
 * and stops, joined by cables. Knows nothing of aircraft; control.c fills it for a step.  All
 * forces and masses are reduced to the travel in the cockpit. */
#ifndef AEROMATCH_LINKAGE_H
#define AEROMATCH_LINKAGE_H

#include "real.h"

#define LINKAGE_BODIES 3

/* Body 0 is the cockpit end; bodies 1 and 2 are connected to it by one cable each.  Force on a body
 * towards positive travel:
 *
 *     load + load_rate t - stiffness (q - origin) - damping v - friction Sgn(v)
 *     - [body 0] preload Sgn(q - neutral) - stop */
typedef struct {
    int bodies;
    real mass[LINKAGE_BODIES], damping[LINKAGE_BODIES];
    real load[LINKAGE_BODIES], load_rate[LINKAGE_BODIES];
    /* negative for a surface that the air drives out */
    real stiffness[LINKAGE_BODIES], origin[LINKAGE_BODIES];
    /* in motion; from rest, not smaller */
    real friction[LINKAGE_BODIES], breakout[LINKAGE_BODIES];
    real preload, neutral;
    /* stops; speed after over speed before the impact */
    real low[LINKAGE_BODIES], high[LINKAGE_BODIES], restitution;
    real cable_stiffness, cable_damping;
    bool driven; /* body 0 moves with the velocity `drive`, whatever force that takes */
    real drive;
} linkage_t;

typedef struct {
    real q[LINKAGE_BODIES], v[LINKAGE_BODIES];
    /* mean forces against the motion in the last part of the last step */
    real friction[LINKAGE_BODIES], stop[LINKAGE_BODIES];
    real lost[3]; /* energy taken by friction, by dampers and by stops, added up [J] */
} motion_t;

/* Move by h in `parts` equal sub-steps. */
void linkage_advance(const linkage_t *linkage, motion_t *motion, double h, int parts);

#endif
