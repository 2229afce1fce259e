/* Validity envelope, names: how far flights support the model at the present state. */
#ifndef AEROMATCH_ENVELOPE_NAMES_H
#define AEROMATCH_ENVELOPE_NAMES_H

#define AM_ENVELOPE_INPUTS(X)
#define AM_ENVELOPE_OUTPUTS(X) \
    X(Y_ENVELOPE_REGION, "envelope.region") \
    X(Y_ENVELOPE_AXIS, "envelope.axis")
#define AM_ENVELOPE_PARAMETERS(X)
#define AM_ENVELOPE_STATES(X)
#define AM_ENVELOPE_VARIABLES(X)
#define AM_ENVELOPE_TARGETS(X)

#define D_PER_ENVELOPE 0
#define W_PER_ENVELOPE 0

#endif
