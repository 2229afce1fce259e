/* The motion of the moving parts of a control circuit.  Knows nothing of aircraft; control_step.c
 * fills it for a step. */
#ifndef AEROMATCH_LINKAGE_H
#define AEROMATCH_LINKAGE_H

#include "linkage_bodies.h"

#define MOST_PARTS 1e6 /* sub-steps of one step */

static inline int sub_steps(double h, double longest) {
    const double parts = ceil(h / longest - 1e-9);
    return (int)(parts < 1.0 ? 1.0 : parts > MOST_PARTS ? MOST_PARTS : parts);
}

/* Move by h in `parts` equal sub-steps, and one of them, of length h, that starts at t. */
void linkage_advance(const one_linkage_t *linkage, one_motion_t *motion, double h, int parts);
void linkage_part(const one_linkage_t *linkage, one_motion_t *motion, double t, double h);

#endif
