/* Look-up of a stage: where its axes stand, four at a time, then its tables. */
#ifndef AEROMATCH_LOCATE_H
#define AEROMATCH_LOCATE_H

#include "interpolate.h"
#include "nodes.h"
#include "table.h"

#include <math.h>

/* One bit of each of four truth values; a unit for a processor that has an instruction for it
 * defines its own. */
#ifndef FOUR_BITS
static inline uint32_t four_bits(four_counts yes) {
    return (uint32_t)((yes[0] & 1) | (yes[1] & 2) | (yes[2] & 4) | (yes[3] & 8));
}
#define FOUR_BITS four_bits
#endif

/* Cells and fractions of the axes of a stage; returns the marks of those that stand elsewhere than
 * before. */
static inline uint64_t locate(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    const double *var = sim->var;
    const uint32_t first = m->first_bench[stage];
    const stand_t *stand = sim->stand + first;
    double *fraction = sim->fraction + 4 * (size_t)first;
    uint64_t changed = 0;
    uint64_t moved = 0;
    uint32_t shift = 0;
    for (const bench_t *bench = m->bench + first, *end = m->bench + m->first_bench[stage + 1];
         bench < end; bench++, stand++, fraction += 4) {
        const uint32_t *v = bench->variable;
        four x = {var[v[0]], var[v[1]], var[v[2]], var[v[3]]};
        if (FOUR_BITS((x >= AT(stand->from)) & (x < AT(stand->to))) != 15) {
            moved |= (uint64_t)move_bench(sim, (uint32_t)(bench - m->bench), (double *)&x) << shift;
        }
        const four part = AT(stand->start) + (x - AT(stand->point)) * AT(stand->per_step);
        changed |= (uint64_t)FOUR_BITS((four_counts)part != *(const four_counts *)fraction)
                   << shift;
        PUT(fraction) = part;
        shift = shift < 4 * (MARKED_BENCHES - 1) ? shift + 4 : 0;
    }
    if (moved) find_corners(sim, stage);
    return changed | moved;
}

static inline void look_up_stage(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    uint64_t changed = 0;
    if (m->first_bundle[stage] == m->first_bundle[stage + 1]) return;
    if (sim->unknown >> stage & 1) {
        for (uint32_t i = m->first_bench[stage]; i < m->first_bench[stage + 1]; i++) {
            sim->stand[i].from[0] = INFINITY; /* to be found */
        }
        sim->unknown &= ~(1u << stage);
        changed = ALL_AXES;
    }
    changed |= locate(sim, stage);
    /* patches change the values of the slots in place */
    if (sim->patches) changed |= ALL_AXES;
    if (changed) interpolate_stage(sim, stage, changed);
    if (sim->patches) apply_patches(sim, stage);
}

#endif
