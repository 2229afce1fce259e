/* Look-up of a stage: where its axes stand, four at a time, then its tables. */
#ifndef AEROMATCH_LOCATE_H
#define AEROMATCH_LOCATE_H

#include "interpolate.h"
#include "nodes.h"
#include "quads.h"
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
 * before.  anew: all corners have to be packed. */
static inline uint64_t locate(am_sim *sim, int stage, bool anew) {
    const am_model *m = sim->model;
    const double *var = sim->var;
    const uint32_t first = m->first_bench[stage];
    const stand_t *stand = sim->stand + first;
    double *fraction = sim->fraction + 4 * (size_t)first;
    uint64_t changed = 0;
    uint64_t moved = 0;
    uint32_t shift = 0;
    uint32_t lost = 0; /* axes whose variable is no number, which makes one of no zero */
    for (const bench_t *bench = m->bench + first, *end = m->bench + m->first_bench[stage + 1];
         bench < end; bench++, stand++, fraction += 4) {
        const uint32_t *v = bench->variable;
        four x = {var[v[0]], var[v[1]], var[v[2]], var[v[3]]};
        if (FOUR_BITS((x >= AT(stand->from)) & (x < AT(stand->to))) != 15) {
            moved |= (uint64_t)move_bench(sim, (uint32_t)(bench - m->bench), (double *)&x) << shift;
            lost |= FOUR_BITS(x != x);
        }
        const four part = AT(stand->start) + (x - AT(stand->point)) * AT(stand->per_step);
        changed |= (uint64_t)FOUR_BITS((four_counts)part != *(const four_counts *)fraction)
                   << shift;
        PUT(fraction) = part;
        shift = (shift + 4) % (4 * MARKED_BENCHES);
    }
    if (lost) sim->unknown |= 1u << stage;
    if (anew || lost) moved = ALL_AXES;
    if (moved) {
        find_corners(sim, stage);
        pack_corners(sim, stage, moved);
    }
    return changed | moved;
}

static inline void look_up_stage(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    const bool anew = sim->unknown >> stage & 1;
    if (m->first_bundle[stage] == m->first_bundle[stage + 1]) return;
    if (anew) {
        for (uint32_t i = m->first_bench[stage]; i < m->first_bench[stage + 1]; i++) {
            sim->stand[i].from[0] = INFINITY; /* to be found */
        }
        sim->unknown &= ~(1u << stage);
    }
    uint64_t changed = locate(sim, stage, anew);
    /* patches change the values of the slots in place */
    if (sim->patches) changed |= ALL_AXES;
    if (changed) interpolate_stage(sim, stage, changed);
    if (sim->patches) apply_patches(sim, stage);
}

#endif
