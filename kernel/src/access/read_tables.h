/* Sections of a block with numbers: axes, bundles of tables. */
#ifndef AEROMATCH_READ_TABLES_H
#define AEROMATCH_READ_TABLES_H

#include "block_reader.h"

/* Each reads one section into the model; false after a refusal. */
bool read_axes(reader *r);
bool read_bundles(reader *r);

#endif
