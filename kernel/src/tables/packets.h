/* Tables four at a time: which stand together, and the corners of their cells. */
#ifndef AEROMATCH_PACKETS_H
#define AEROMATCH_PACKETS_H

#include "simulation.h"

/* The packets of a model whose axes and bundles are known. */
void make_packets(am_model *m);

/* Corners of the packets of a stage that an axis of `moved` leads through, in the cells of their
 * bundles.  One whose corners are all zero is zero until it moves on. */
void pack_corners(am_sim *sim, int stage, uint64_t moved);

#endif
