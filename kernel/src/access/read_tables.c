/* Axes and tables of a block, checked so that a look-up needs no check. */
#include "read_tables.h"

#include "error.h"
#include "packets.h"

#include <math.h>
#include <string.h>

static bool check_points(reader *r, uint32_t i, const double *p, uint32_t count) {
    const char *name = r->model->entry[AM_AXIS][i].name;
    for (uint32_t k = 0; k < count; k++) {
        if (!(fabs(p[k]) < FARTHEST)) {
            return refuse_block(
                r, "model block: axis %u (%s) has a breakpoint that is not finite or beyond %g",
                (unsigned)i, name, FARTHEST);
        }
        if (k == 0) continue;
        if (!(p[k] > p[k - 1])) {
            return refuse_block(r, "model block: axis %u (%s) does not rise at point %u",
                                (unsigned)i, name, (unsigned)k);
        }
        if (!(1.0 / (p[k] - p[k - 1]) < FARTHEST)) {
            return refuse_block(
                r, "model block: axis %u (%s) has a step at point %u that is too small",
                (unsigned)i, name, (unsigned)k);
        }
    }
    return true;
}

/* The smallest number above x. */
static double next_above(double x) {
    uint64_t bits;
    if (x == 0.0) return 0x1p-1074;
    memcpy(&bits, &x, sizeof bits);
    bits += x > 0.0 ? 1 : (uint64_t)-1;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Fills count + 3 cells. */
static void lay_cells(const double *p, uint32_t count, bool linear, cell_t *to) {
    const uint32_t last = count - 1;
    const double first_rise = last ? 1.0 / (p[1] - p[0]) : 0.0;
    const double last_rise = last ? 1.0 / (p[last] - p[last - 1]) : 0.0;
    const double end = last ? 1.0 : 0.0;
    to[0] = (cell_t){-FARTHEST, p[0], linear ? first_rise : 0.0, 0.0};
    for (uint32_t k = 0; k < last; k++) {
        to[1 + k] = (cell_t){p[k], p[k], 1.0 / (p[k + 1] - p[k]), 0.0};
    }
    to[count] = (cell_t){p[last], p[last], 0.0, end};
    to[count + 1] = (cell_t){next_above(p[last]), p[last], linear ? last_rise : 0.0, end};
    to[count + 2] = (cell_t){.from = FARTHEST};
}

static void group_axes(am_model *m) {
    uint32_t n = 0;
    for (int stage = 0; stage < STAGES; stage++) {
        m->first_bench[stage] = n;
        for (uint32_t i = m->first_axis[stage]; i < m->first_axis[stage + 1]; i++) {
            const uint32_t k = (i - m->first_axis[stage]) % 4;
            bench_t *bench = &m->bench[k ? n - 1 : n++];
            if (k == 0)
                *bench = (bench_t){.axis = {UINT32_MAX, UINT32_MAX, UINT32_MAX, UINT32_MAX}};
            bench->variable[k] = m->axis[i].variable;
            bench->axis[k] = i;
            m->axis[i].fraction = 4 * (n - 1) + k;
        }
    }
    m->first_bench[STAGES] = n;
}

bool read_axes(reader *r) {
    am_model *m = r->model;
    const axis_record *record = r->at[AXES];
    const double *points = r->at[POINTS];
    uint32_t stage = 0;
    uint32_t next = 0;
    for (uint32_t i = 0; i < m->axes; i++) {
        if (record[i].variable >= r->count[VARIABLES]) {
            return refuse_block(r, "model block: axis %u has no variable", (unsigned)i);
        }
        const uint32_t code = m->variable[record[i].variable];
        const uint32_t count = record[i].count;
        const uint32_t first = record[i].first;
        am_entry *e = &m->entry[AM_AXIS][i];
        *e = m->entry[AM_VARIABLE][record[i].variable];
        if (count == 0 || first != next || count > r->count[POINTS] - first) {
            return refuse_block(r, "model block: axis %u (%s) has breakpoints outside the block",
                                (unsigned)i, e->name);
        }
        next += count;
        const double *p = points + first;
        if (!check_points(r, i, p, count)) return false;
        if (record[i].stage < stage || record[i].stage >= STAGES) {
            return refuse_block(r, "model block: axes are not sorted by stage");
        }
        while (stage < record[i].stage) m->first_axis[++stage] = i;
        if (is_implicit(code)) {
            return refuse_block(
                r, "model block: %s cannot be a table axis; it may be a regressor only", e->name);
        }
        if (!known_in(r, record[i].variable, stage)
            || (is_coefficient(code) && stage >= STAGE_HINGE)) {
            return refuse_block(r, "model block: %s is not yet known where a table needs it",
                                e->name);
        }
        cell_t *cell = m->cell + first + 3 * (size_t)i;
        lay_cells(p, count, record[i].linear != 0, cell);
        m->axis[i] = (axis_t){cell, count + 2, count, code, 0};
        e->low = p[0];
        e->high = p[count - 1];
        e->value = 0.0;
        e->flags = record[i].linear ? AM_LINEAR : 0;
    }
    while (stage < STAGES) m->first_axis[++stage] = m->axes;
    group_axes(m);
    return true;
}

static uint64_t mark_of(const am_model *m, uint32_t stage, uint32_t axis) {
    const uint32_t fraction = m->axis[axis].fraction - 4 * m->first_bench[stage];
    return 1ull << fraction % (4 * MARKED_BENCHES);
}

/* Axes and nodes of a bundle of a stage. */
static bool read_bundle(reader *r, uint32_t i, uint32_t stage) {
    const am_model *m = r->model;
    const bundle_record *b = (const bundle_record *)r->at[BUNDLES] + i;
    bundle_t *to = &m->bundle[i];
    size_t doubles = b->width;
    to->axes = b->axes;
    to->width = b->width;
    to->marks = ALL_AXES;
    for (uint32_t k = b->axes; k-- > 0;) {
        if (b->axis[k] < m->first_axis[stage] || b->axis[k] >= m->first_axis[stage + 1]) {
            return refuse_block(r,
                                "model block: bundle %u refers to an axis that is not in its stage",
                                (unsigned)i);
        }
        const uint32_t count = m->axis[b->axis[k]].count;
        to->axis[k] = b->axis[k];
        to->marks |= mark_of(m, stage, b->axis[k]);
        to->stride[k] = count > 1 ? doubles : 0;
        if (doubles > r->count[NODES] / count) {
            return refuse_block(r, "model block: bundle %u has nodes outside the block",
                                (unsigned)i);
        }
        doubles *= count;
    }
    if (b->first > r->count[NODES] || doubles > r->count[NODES] - b->first) {
        return refuse_block(r, "model block: bundle %u has nodes outside the block", (unsigned)i);
    }
    to->first = (size_t)b->first;
    return true;
}

bool read_bundles(reader *r) {
    am_model *m = r->model;
    const bundle_record *record = r->at[BUNDLES];
    uint32_t stage = 0;
    uint32_t slot = 1;
    m->node = r->at[NODES];
    r->first_slot[0] = slot;
    if (r->count[NODES] > UINT32_MAX) return refuse_block(r, "model block: too many nodes");
    for (uint32_t i = 0; i < m->bundles; i++) {
        const bundle_record *b = &record[i];
        if (b->axes > MAX_AXES || b->width == 0 || b->width > MOST) {
            return refuse_block(r, "model block: bundle %u has a wrong number of axes or tables",
                                (unsigned)i);
        }
        if (b->stage < stage || b->stage >= STAGES) {
            return refuse_block(r, "model block: bundles are not sorted by stage");
        }
        while (stage < b->stage) {
            m->first_bundle[++stage] = i;
            r->first_slot[stage] = slot;
        }
        if (!read_bundle(r, i, stage)) return false;
        /* a look-up writes up to SPILL values beyond the last table */
        m->bundle[i].slot = slot + SPILL * i;
        slot += b->width;
        if (slot > MOST) return refuse_block(r, "model block: too many tables");
    }
    while (stage < STAGES) {
        m->first_bundle[++stage] = m->bundles;
        r->first_slot[stage] = slot;
    }
    m->slots = slot + SPILL * m->bundles;
    make_packets(m);
    if (!all_finite(r->at[NODES], r->count[NODES])) {
        return refuse_block(r, "model block: a table node is not finite");
    }
    return true;
}
