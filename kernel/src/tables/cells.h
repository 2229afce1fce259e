/* Where the axes of tables stand: cells and the corners that belong to them. */
#ifndef AEROMATCH_CELLS_H
#define AEROMATCH_CELLS_H

#include "flight.h"

/* Cell of an axis that holds x; any x, NaN in cell 0. */
uint32_t find_cell(const axis_t *axis, double x);

/* Move the axes of a bench to the cells that hold x, which come within reach; one bit for each axis
 * whose cell is another than before. */
uint32_t move_bench(am_sim *sim, uint32_t bench, double x[4]);

/* First node of the present cell of every bundle of a stage. */
void find_corners(am_sim *sim, int stage);

/* First nodes of all bundles for cells that came from outside; a cell that is not there becomes the
 * first. */
void restore_cells(am_sim *sim);

/* Cells of the start of a run: inside the range of every table. */
void reset_cells(am_sim *sim);

#endif
