/* The moving parts of a control circuit: up to three bodies with springs, dampers, dry friction
 * and stops, joined by cables. All forces and masses are reduced to the travel in the cockpit. */
#ifndef AEROMATCH_LINKAGE_BODIES_H
#define AEROMATCH_LINKAGE_BODIES_H

#include "real.h"

#define LINKAGE_BODIES 3

/* Body 0 is the cockpit end; bodies 1 and 2 are connected to it by one cable each.  Force on a body
 * towards positive travel:
 *
 *     load + load_rate t - stiffness (q - origin) - damping v - friction Sgn(v)
 *     - [body 0] preload Sgn(q - neutral) - stop */
#define LINKAGE(number)                                                         \
    struct {                                                                    \
        number mass[LINKAGE_BODIES], damping[LINKAGE_BODIES];                   \
        number load[LINKAGE_BODIES], load_rate[LINKAGE_BODIES];                 \
        /* negative for a surface that the air drives out */                    \
        number stiffness[LINKAGE_BODIES], origin[LINKAGE_BODIES];               \
        /* in motion; from rest, not smaller */                                 \
        number friction[LINKAGE_BODIES], breakout[LINKAGE_BODIES];              \
        number preload, neutral;                                                \
        /* stops; speed after over speed before the impact */                   \
        number low[LINKAGE_BODIES], high[LINKAGE_BODIES], restitution;          \
        number cable_stiffness, cable_damping;                                  \
        number drive; /* velocity of a driven body 0 */                         \
        int bodies;                                                             \
        bool driven; /* body 0 moves with `drive`, whatever force that takes */ \
    }

#define MOTION(number)                                                                        \
    struct {                                                                                  \
        number q[LINKAGE_BODIES], v[LINKAGE_BODIES];                                          \
        /* mean forces against the motion in the last part of the last step */                \
        number friction[LINKAGE_BODIES], stop[LINKAGE_BODIES];                                \
        number lost[3]; /* energy taken by friction, by dampers and by stops, added up [J] */ \
    }

typedef LINKAGE(real) linkage_t;
typedef MOTION(real) motion_t;

#if LANES == 1
typedef linkage_t one_linkage_t;
typedef motion_t one_motion_t;
#else
typedef LINKAGE(double) one_linkage_t;
typedef MOTION(double) one_motion_t;
#endif

#endif
