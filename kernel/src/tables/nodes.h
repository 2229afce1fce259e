/* Nodes, scales and offsets of single tables as parameters of a simulation. */
#ifndef AEROMATCH_NODES_H
#define AEROMATCH_NODES_H

#include "simulation.h"

/* Apply the changes to the tables of a stage that have just been looked up. */
void apply_patches(am_sim *sim, int stage);

/* Set or get a parameter beyond the catalogue; AM_BAD_INDEX when there is none. */
int set_table_parameter(am_sim *sim, uint32_t index, double value);
int get_table_parameter(const am_sim *sim, uint32_t index, double *value);

/* Index of node.*, table.* or offset.*; -1 when there is none. */
int find_table_parameter(const am_model *m, const char *name);

/* After bytes from outside: drop changes whose index would lead out of the model. */
void check_patches(am_sim *sim);

#endif
