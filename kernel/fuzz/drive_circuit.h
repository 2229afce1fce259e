/* The free motion of a control circuit, chosen by bytes. */
#ifndef AEROMATCH_DRIVE_CIRCUIT_H
#define AEROMATCH_DRIVE_CIRCUIT_H

#include "drive_choices.h"

/* A circuit of any size and constants is followed or refused. */
void call_circuit(bytes_t *bytes);

#endif
