/* Look-up of a stage: where its axes stand, four at a time, then its tables. */
#ifndef AEROMATCH_LOCATE_H
#define AEROMATCH_LOCATE_H

#include "interpolate.h"
#include "nodes.h"
#include "packets.h"
#include "cells.h"

/* One bit of each of four truth values; AVX has an instruction for it. */
static inline uint32_t four_bits(four_counts yes) {
#ifdef AGAIN
    return (uint32_t)__builtin_ia32_movmskpd256((four)yes);
#else
    return (uint32_t)((yes[0] & 1) | (yes[1] & 2) | (yes[2] & 4) | (yes[3] & 8));
#endif
}

static inline four variables_of(const am_sim *sim, const bench_t *bench) {
    const double *var = sim->var;
    const uint32_t *v = bench->variable;
    return (four){var[v[0]], var[v[1]], var[v[2]], var[v[3]]};
}

static inline four_counts within_cells(const stand_t *stand, four x) {
    return (x >= AT(stand->from)) & (x < AT(stand->to));
}

static inline four fractions_of(const stand_t *stand, four x) {
    return AT(stand->start) + (x - AT(stand->point)) * AT(stand->per_step);
}

/* Of a stage some axis of which has left its cell, or of which nothing is known (anew): the cells,
 * and the fractions in them; returns the marks of all that may stand elsewhere than before. */
__attribute__((noinline)) static uint64_t move_on(am_sim *sim, int stage, bool anew) {
    const am_model *m = sim->model;
    uint64_t left = 0;
    uint64_t moved = 0;
    uint32_t lost = 0; /* axes whose variable is not a number */
    uint32_t shift = 0;
    for (uint32_t i = m->first_bench[stage]; i < m->first_bench[stage + 1]; i++) {
        four x = variables_of(sim, &m->bench[i]);
        if (anew || four_bits(within_cells(&sim->stand[i], x)) != 15) {
            moved |= (uint64_t)move_bench(sim, i, (double *)&x) << shift;
            left |= 15ull << shift;
            lost |= four_bits(x != x);
            PUT(sim->fraction + 4 * (size_t)i) = fractions_of(&sim->stand[i], x);
        }
        shift = (shift + 4) % (4 * MARKED_BENCHES);
    }
    sim->unknown &= ~(1u << stage);
    if (lost) sim->unknown |= 1u << stage;
    if (lost || anew) moved = ALL_AXES;
    if (moved) {
        find_corners(sim, stage);
        pack_corners(sim, stage, moved);
    }
    return left | moved;
}

/* Where the axes of a stage stand; returns the marks of those that stand elsewhere than before. */
static inline uint64_t locate_axes(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    const uint32_t first = m->first_bench[stage];
    const stand_t *stand = sim->stand + first;
    double *fraction = sim->fraction + 4 * (size_t)first;
    four_counts within = ~(four_counts){0};
    uint64_t changed = 0;
    uint32_t shift = 0;
    for (const bench_t *bench = m->bench + first, *end = m->bench + m->first_bench[stage + 1];
         bench < end; bench++, stand++, fraction += 4) {
        const four x = variables_of(sim, bench);
        const four part = fractions_of(stand, x);
        within &= within_cells(stand, x);
        changed |= (uint64_t)four_bits((four_counts)part != *(const four_counts *)fraction)
                   << shift;
        PUT(fraction) = part;
        shift = (shift + 4) % (4 * MARKED_BENCHES);
    }
    const bool anew = sim->unknown >> stage & 1;
    if (four_bits(within) != 15 || anew) changed |= move_on(sim, stage, anew);
    return changed;
}

static inline void look_up_stage(am_sim *sim, int stage) {
    const am_model *m = sim->model;
    if (m->first_bundle[stage] == m->first_bundle[stage + 1]) return;
    uint64_t changed = locate_axes(sim, stage);
    /* patches change the values of the slots in place */
    if (sim->patches) changed |= ALL_AXES;
    if (changed) interpolate_stage(sim, stage, changed);
    if (sim->patches) apply_patches(sim, stage);
}

#endif
