/* Nodes, scales and offsets of single tables as parameters of a simulation: the model stays as
 * it is and is shared.
 *
 * A change of a node moves the value of its table by the change times the weight of the node in
 * the present cell, which is what interpolation in a changed table gives.  Index of a parameter:
 * catalogued ones first, then the nodes in the order of the block, then scale and offset of
 * every table. */
#include "nodes.h"

#include "error.h"

#include <stdlib.h>
#include <string.h>

enum { SCALE, OFFSET, PER_SLOT };

static uint32_t listed_parameters(const am_model *m) { return (uint32_t)m->count[AM_PARAMETER]; }

/* The bundle whose tables write a slot; the number of bundles for a gap, which no table does. */
static uint32_t bundle_of_slot(const am_model *m, uint32_t slot) {
    uint32_t i = 0;
    while (i < m->bundles && slot >= m->bundle[i].slot + m->bundle[i].width) i++;
    return i < m->bundles && slot >= m->bundle[i].slot ? i : m->bundles;
}

static uint32_t node_count(const am_model *m, const bundle_t *bundle) {
    uint32_t n = bundle->width;
    for (uint32_t k = 0; k < bundle->axes; k++) n *= m->axis[bundle->axis[k]].count;
    return n;
}

static uint32_t stage_of_bundle(const am_model *m, uint32_t bundle) {
    uint32_t stage = 0;
    while (bundle >= m->first_bundle[stage + 1]) stage++;
    return stage;
}

/* What a parameter index beyond the catalogue means; false when there is no such parameter. */
static bool decode(const am_model *m, uint32_t index, patch_t *patch) {
    if (index < listed_parameters(m)) return false;
    uint32_t rest = index - listed_parameters(m);
    for (uint32_t b = 0; b < m->bundles; b++) {
        const bundle_t *bundle = &m->bundle[b];
        const uint32_t n = node_count(m, bundle);
        if (rest >= n) {
            rest -= n;
            continue;
        }
        *patch = (patch_t){
            .index = index, .kind = PATCH_NODE, .stage = stage_of_bundle(m, b), .bundle = b};
        patch->slot = bundle->slot + rest % bundle->width;
        rest /= bundle->width;
        for (uint32_t k = bundle->axes; k-- > 0; rest /= m->axis[bundle->axis[k]].count) {
            patch->at[k] = rest % m->axis[bundle->axis[k]].count;
        }
        return true;
    }
    if (rest >= PER_SLOT * (m->slots - 1)) return false;
    const uint32_t slot = 1 + rest / PER_SLOT;
    const uint32_t b = bundle_of_slot(m, slot);
    if (b == m->bundles) return false;
    *patch = (patch_t){.index = index,
                       .kind = rest % PER_SLOT == SCALE ? PATCH_SCALE : PATCH_OFFSET,
                       .slot = slot,
                       .bundle = b};
    patch->stage = stage_of_bundle(m, b);
    return true;
}

static double node_value(const am_model *m, const patch_t *patch) {
    const bundle_t *bundle = &m->bundle[patch->bundle];
    size_t at = bundle->first + patch->slot - bundle->slot;
    for (uint32_t k = 0; k < bundle->axes; k++) at += patch->at[k] * bundle->stride[k];
    return m->node[at];
}

static double unchanged(const am_model *m, const patch_t *patch) {
    return patch->kind == PATCH_NODE    ? node_value(m, patch)
           : patch->kind == PATCH_SCALE ? 1.0
                                        : 0.0;
}

int set_table_parameter(am_sim *sim, uint32_t index, double value) {
    patch_t patch;
    if (!decode(sim->model, index, &patch)) {
        return fail(sim, AM_BAD_INDEX, "there is no parameter %u", (unsigned)index);
    }
    patch.value = patch.kind == PATCH_NODE ? value - node_value(sim->model, &patch) : value;
    uint32_t i = 0;
    while (i < sim->patches && sim->patch[i].index != index) i++;
    if (i == MAX_PATCHES) {
        return fail(
            sim, AM_BAD_VALUE,
            "more than %d nodes, scales and offsets of tables are changed in one simulation; "
            "compile a database with them",
            MAX_PATCHES);
    }
    if (i == sim->patches) sim->patches++;
    /* nodes before scales before offsets, whatever the order of the calls */
    for (; i > 0 && sim->patch[i - 1].kind > patch.kind; i--) sim->patch[i] = sim->patch[i - 1];
    sim->patch[i] = patch;
    return AM_OK;
}

int get_table_parameter(const am_sim *sim, uint32_t index, double *value) {
    patch_t patch;
    if (!decode(sim->model, index, &patch)) return AM_BAD_INDEX;
    *value = unchanged(sim->model, &patch);
    for (uint32_t i = 0; i < sim->patches; i++) {
        if (sim->patch[i].index == index) {
            *value = sim->patch[i].value + (patch.kind == PATCH_NODE ? *value : 0.0);
        }
    }
    return AM_OK;
}

/* After bytes from outside: no index may lead out of the model. */
void check_patches(am_sim *sim) {
    patch_t patch;
    if (sim->patches > MAX_PATCHES) sim->patches = 0;
    for (uint32_t i = 0; i < sim->patches; i++) {
        if (decode(sim->model, sim->patch[i].index, &patch)) {
            patch.value = sim->patch[i].value;
            sim->patch[i] = patch;
        } else {
            sim->patches = i;
        }
    }
}

static double weight(const am_sim *sim, const patch_t *patch) {
    const bundle_t *bundle = &sim->model->bundle[patch->bundle];
    double w = 1.0;
    for (uint32_t k = 0; k < bundle->axes; k++) {
        const uint32_t cell = lower_node(&sim->model->axis[bundle->axis[k]],
                                         sim->cell[bundle->axis[k]]);
        const double f = sim->fraction[sim->model->axis[bundle->axis[k]].fraction];
        w *= patch->at[k] == cell ? 1.0 - f : patch->at[k] == cell + 1 ? f : 0.0;
    }
    return w;
}

void apply_patches(am_sim *sim, int stage) {
    for (uint32_t i = 0; i < sim->patches; i++) {
        const patch_t *patch = &sim->patch[i];
        if (patch->stage != (uint32_t)stage) continue;
        double *value = &sim->slot[patch->slot];
        if (patch->kind == PATCH_NODE) *value += patch->value * weight(sim, patch);
        else if (patch->kind == PATCH_SCALE) *value *= patch->value;
        else *value += patch->value;
    }
}

/* ---- names: node.CL.basic[3,1], node.CL.gear.K1[0]; table.CL.basic and offset.CL.gear.K1 ----- */

/* The slot of a table named <coefficient>.<contribution>, .K1 or .K2 behind it for a factor;
 * *rest is what follows. */
static uint32_t slot_named(const am_model *m, const char *name, const char **rest) {
    const am_entry *scale = m->entry[AM_PARAMETER] + m->total[AM_PARAMETER];
    for (uint32_t i = 0; i < m->terms; i++) {
        const char *term = scale[i].name + strlen("term.");
        const size_t n = strlen(term);
        if (strncmp(name, term, n) != 0) continue;
        const char *after = name + n;
        const bool K1 = strncmp(after, ".K1", 3) == 0;
        const bool K2 = strncmp(after, ".K2", 3) == 0;
        *rest = K1 || K2 ? after + 3 : after;
        if (**rest == 0 || **rest == '[') {
            return K1 ? m->term[i].K1 : K2 ? m->term[i].K2 : m->term[i].T;
        }
    }
    return 0;
}

static int node_named(const am_model *m, uint32_t slot, const char *rest) {
    const uint32_t b = bundle_of_slot(m, slot);
    const bundle_t *bundle = &m->bundle[b];
    uint32_t first = listed_parameters(m);
    uint32_t node = 0;
    for (uint32_t i = 0; i < b; i++) first += node_count(m, &m->bundle[i]);
    for (uint32_t k = 0; k < bundle->axes; k++) {
        const uint32_t count = m->axis[bundle->axis[k]].count;
        char *end;
        if (*rest != (k ? ',' : '[') || rest[1] < '0' || rest[1] > '9') return -1;
        const unsigned long at = strtoul(rest + 1, &end, 10);
        if (at >= count) return -1;
        node = node * count + (uint32_t)at;
        rest = end;
    }
    if (strcmp(rest, bundle->axes ? "]" : "") != 0) return -1;
    return (int)(first + node * bundle->width + (slot - bundle->slot));
}

int find_table_parameter(const am_model *m, const char *name) {
    static const char *const KIND[] = {"node.", "table.", "offset."};
    int kind = 0;
    while (kind < 3 && strncmp(name, KIND[kind], strlen(KIND[kind])) != 0) kind++;
    if (kind == 3) return -1;
    const char *rest;
    const uint32_t slot = slot_named(m, name + strlen(KIND[kind]), &rest);
    if (slot == 0) return -1;
    if (kind == 0) return node_named(m, slot, rest);
    if (*rest) return -1;
    uint32_t first = listed_parameters(m);
    for (uint32_t i = 0; i < m->bundles; i++) first += node_count(m, &m->bundle[i]);
    return (int)(first + PER_SLOT * (slot - 1) + (kind == 1 ? SCALE : OFFSET));
}
