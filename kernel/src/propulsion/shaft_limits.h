/* Bounds of what turns with a propeller. */
#ifndef AEROMATCH_SHAFT_LIMITS_H
#define AEROMATCH_SHAFT_LIMITS_H

/* below it a power makes the torque that it makes at this speed [rad s-1] */
#define SLOW_SHAFT 1.0
/* time in which a stop takes up what moves into it [s] */
#define STOP_TIME 0.02
/* at it a switch among the inputs is on */
#define SWITCHED 0.5

#endif
