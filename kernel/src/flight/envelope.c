/* Region of the present state: the worst of all region tables at the variables of the model. */
#include "envelope.h"

#if LANES == 1
#define LANE(x, l) (x)
#else
#define LANE(x, l) ((x)[l])
#endif

/* Cell of x among rising edges; a value on an edge belongs to the cell above it. */
static uint32_t region_cell(const double *edge, uint32_t edges, double x) {
    uint32_t low = 0;
    uint32_t high = edges;
    while (low < high) {
        const uint32_t middle = (low + high) / 2;
        if (edge[middle] <= x) low = middle + 1;
        else high = middle;
    }
    return low;
}

static unsigned region_byte(const region_table_t *table, const real *var, int lane) {
    size_t cell = 0;
    (void)lane;
    for (uint32_t k = 0; k < table->axes; k++) {
        const double x = LANE(var[table->variable[k]], lane);
        size_t cells = (size_t)table->edges[k] + 1;
        cell = cell * cells + region_cell(table->edge[k], table->edges[k], x);
    }
    return table->cell[cell];
}

void envelope_outputs(const flight_t *sim, real *y) {
    const am_model *m = sim->model;
    if (!items(m, G_ENVELOPE)) return;
    real *to = y + place(m, AM_OUTPUT, G_ENVELOPE, 0);
    for (int l = 0; l < LANES; l++) {
        unsigned region = 0;
        unsigned axis = 0;
        for (uint32_t i = 0; i < m->regions; i++) {
            const unsigned byte = region_byte(m->region + i, sim->var, l);
            const unsigned own = byte & REGION_MASK;
            /* the first table with the worst region names the axis, if it knows one */
            if (own > region || (own == region && own && !axis)) axis = byte >> REGION_BITS;
            if (own > region) region = own;
        }
        LANE(to[Y_ENVELOPE_REGION], l) = (double)region;
        LANE(to[Y_ENVELOPE_AXIS], l) = (double)axis;
    }
}
