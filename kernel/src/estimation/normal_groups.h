/* The groups of residuals of a trajectory (am_add_residuals), compiled like normal_sums.h. */
#ifndef AEROMATCH_NORMAL_GROUPS_H
#define AEROMATCH_NORMAL_GROUPS_H

#include "kernel.h"
#include "normal_sums.h"
#include "path_steps.h"

/* Samples whose sums stay in the cache while one group after the other is added to them. */
enum { TOGETHER = 128 };

/* The end of the part of a group, from `from`, that belongs to samples before `end`. */
static size_t end_of_part(const am_residual_group *group, size_t from, size_t end) {
    if (!group->k) return group->count < end ? group->count : end;
    while (from < group->count && (size_t)group->k[from] < end) from++;
    return from;
}

static void add_groups(const am_normal *e, size_t samples, const am_residual_group *group,
                       int groups) {
    size_t done[AM_MOST_GROUPS] = {0};
    for (size_t first = 0; first < samples; first += TOGETHER) {
        const bool last = first + TOGETHER >= samples;
        for (int i = 0; i < groups; i++) {
            const am_residual_group *g = group + i;
            const size_t from = done[i];
            done[i] = last ? g->count : end_of_part(g, from, first + TOGETHER);
            if (from == done[i]) continue;
            if (g->k) add_readings(e, g, from, done[i]);
            else if (g->drive) add_path_steps(e, g, from, done[i]);
            else add_steps(e, g, from, done[i]);
        }
    }
}

#endif
