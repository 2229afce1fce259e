/* The section of a block with the validity envelope: tables of regions over model variables.
 *
 * The number of tables and a zero; of each table the number of axes, and of each axis its variable
 * and its number of edges (uint32); the edges (double) from a multiple of 8 on; one byte for each
 * cell, last axis fastest, up to a multiple of 8.  Written by flightmech/envelope/envelope.py. */
#ifndef AEROMATCH_READ_ENVELOPE_H
#define AEROMATCH_READ_ENVELOPE_H

#include "block_reader.h"

/* Region tables of the model; none without the section.  Every lookup is safe afterwards. */
bool read_envelope(reader *r);

#endif
