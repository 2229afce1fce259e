/* Controls that only the tables know, such as the body flaps of a lifting body: an input each,
 * which is the model variable of the same name.  The item is "body_flap.deflection". */
#ifndef AEROMATCH_DEVICE_NAMES_H
#define AEROMATCH_DEVICE_NAMES_H

#define AM_DEVICE_INPUTS(X) X(U_DEVICE, "device.*")
#define AM_DEVICE_OUTPUTS(X)
#define AM_DEVICE_PARAMETERS(X)
#define AM_DEVICE_STATES(X)
#define AM_DEVICE_VARIABLES(X) X(A_DEVICE, "device.*", STAGE_ENGINE)
#define AM_DEVICE_TARGETS(X)

#define D_PER_DEVICE 0
#define W_PER_DEVICE 0

#endif
