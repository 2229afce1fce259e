/* Sections of a block with names: entries, items, variables. */
#ifndef AEROMATCH_READ_CATALOGUE_H
#define AEROMATCH_READ_CATALOGUE_H

#include "block_reader.h"

/* Each reads or checks one part; false after a refusal. */
bool read_entries(reader *r, int section, am_kind kind);
bool read_items(reader *r);
bool find_group_starts(reader *r); /* where the names of each group begin */
bool read_variables(reader *r);
/* all but the last `beyond` are those of the groups */
bool check_names(reader *r, am_kind kind, size_t beyond);
bool check_scales(reader *r);
bool forget_stages(reader *r);

#endif
