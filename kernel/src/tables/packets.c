/* Tables four at a time: which stand together, and the corners of their cells.
 *
 * A wide bundle makes packets by itself.  Those of one to three tables share packets with others
 * of as many axes: a packet costs the same whether one of its tables is of use or four.  Most
 * tables over the height over ground are zero out of ground effect; they stand together, so that a
 * flight up there passes over them. */
#include "packets.h"

#include <string.h>

#define WIDE 4 /* tables of a bundle that is not shared out */

static uint32_t corners_of(uint32_t axes) { return 4u << axes; }

/* ---- layout of a model ----------------------------------------------------------------------- */

static bool over_ground(const am_model *m, const bundle_t *bundle) {
    for (uint32_t k = 0; k < bundle->axes; k++) {
        if (m->axis[bundle->axis[k]].variable == A_H_AGL) return true;
    }
    return false;
}

static void set_fractions_of(const am_model *m, const bundle_t *bundle, uint32_t place,
                             packet_t *to) {
    for (uint32_t k = 0; k < bundle->axes; k++) {
        to->fraction[k][place] = m->axis[bundle->axis[k]].fraction;
    }
}

static void put_table(const am_model *m, uint32_t b, uint32_t table, packet_t *to) {
    const bundle_t *bundle = &m->bundle[b];
    to->marks |= bundle->marks;
    to->bundle[to->tables] = b;
    to->table[to->tables] = table;
    to->slot[to->tables] = bundle->slot + table;
    set_fractions_of(m, bundle, to->tables++, to);
}

/* Places without a table: what stands there is written beyond the first bundle. */
static void fill_up(const am_model *m, packet_t *packet) {
    const bundle_t *first = &m->bundle[packet->bundle[0]];
    for (uint32_t i = packet->tables; i < 4; i++) {
        set_fractions_of(m, first, i, packet);
        packet->slot[i] = first->slot + first->width + i - packet->tables;
    }
}

/* How many packets and corners there are so far. */
typedef struct {
    uint32_t packets, corners;
} laid_t;

static packet_t *new_packet(am_model *m, uint32_t axes, uint32_t vectors, laid_t *laid) {
    packet_t *packet = &m->packet[laid->packets++];
    packet->corner = laid->corners;
    packet->vectors = vectors;
    laid->corners += corners_of(axes) * (vectors ? vectors : 1);
    return packet;
}

static bool is_wide(const bundle_t *bundle) { return bundle->axes == 0 || bundle->width >= WIDE; }

/* Bundles that are not shared out. */
static void lay_wide(am_model *m, uint32_t stage, uint32_t axes, laid_t *laid) {
    for (uint32_t i = m->first_bundle[stage]; i < m->first_bundle[stage + 1]; i++) {
        const bundle_t *bundle = &m->bundle[i];
        if (bundle->axes != axes || !is_wide(bundle)) continue;
        packet_t *packet = new_packet(m, axes, (bundle->width + 3) / 4, laid);
        put_table(m, i, 0, packet);
        fill_up(m, packet);
    }
}

/* The others, or those of them over the height over ground. */
static void lay_mixed(am_model *m, uint32_t stage, uint32_t axes, bool ground, laid_t *laid) {
    packet_t *packet = NULL;
    for (uint32_t i = m->first_bundle[stage]; i < m->first_bundle[stage + 1]; i++) {
        const bundle_t *bundle = &m->bundle[i];
        if (bundle->axes != axes || is_wide(bundle) || over_ground(m, bundle) != ground) continue;
        for (uint32_t t = 0; t < bundle->width; t++) {
            if (!packet || packet->tables == 4) packet = new_packet(m, axes, 0, laid);
            put_table(m, i, t, packet);
            if (packet->tables < 4) fill_up(m, packet);
        }
    }
}

void make_packets(am_model *m) {
    laid_t laid = {0, 0};
    for (uint32_t stage = 0; stage < STAGES; stage++) {
        for (uint32_t axes = 0; axes <= MAX_AXES; axes++) {
            m->first_packet[stage * WAYS + 2 * axes] = laid.packets;
            lay_mixed(m, stage, axes, false, &laid);
            lay_mixed(m, stage, axes, true, &laid);
            m->first_packet[stage * WAYS + 2 * axes + 1] = laid.packets;
            lay_wide(m, stage, axes, &laid);
        }
    }
    m->first_packet[STAGES * WAYS] = laid.packets;
    m->corners = laid.corners;
}

/* ---- corners of a simulation ----------------------------------------------------------------- */

/* The nodes at all corners of a cell, first axis first, into every fourth place. */
static void pack_table(const bundle_t *bundle, const double *node, double *to) {
    size_t offset[1 << MAX_AXES] = {0};
    for (uint32_t k = 0; k < bundle->axes; k++) {
        for (uint32_t i = 1u << k; i-- > 0;) {
            offset[2 * i + 1] = offset[i] + bundle->stride[k];
            offset[2 * i] = offset[i];
        }
    }
    for (uint32_t i = 0; i < 1u << bundle->axes; i++) to[4 * i] = node[offset[i]];
}

static void pack_packet(const am_sim *sim, const packet_t *packet, double *to) {
    const am_model *m = sim->model;
    if (packet->vectors) {
        const bundle_t *bundle = &m->bundle[packet->bundle[0]];
        const double *node = m->node + sim->corner[packet->bundle[0]];
        for (uint32_t t = 0; t < bundle->width; t++) {
            pack_table(bundle, node + t, to + t / 4 * corners_of(bundle->axes) + t % 4);
        }
        return;
    }
    for (uint32_t i = 0; i < packet->tables; i++) {
        const uint32_t b = packet->bundle[i];
        pack_table(&m->bundle[b], m->node + sim->corner[b] + packet->table[i], to + i);
    }
}

/* No bit is set: what is found between such nodes is zero itself. */
static bool all_zero(const double *corner, uint32_t n) {
    uint64_t bits = 0;
    for (uint32_t i = 0; i < n; i++) {
        uint64_t one;
        memcpy(&one, corner + i, sizeof one);
        bits |= one;
    }
    return bits == 0;
}

static void make_zero(am_sim *sim, const packet_t *packet) {
    for (uint32_t i = 0; i < 4 * packet->vectors; i++) sim->slot[packet->slot[0] + i] = 0.0;
    for (uint32_t i = 0; i < 4; i++) sim->slot[packet->slot[i]] = 0.0;
}

void pack_corners(am_sim *sim, int stage, uint64_t moved) {
    const am_model *m = sim->model;
    const uint32_t *first = m->first_packet + (uint32_t)stage * WAYS;
    for (uint32_t way = 0; way < WAYS; way++) {
        for (uint32_t i = first[way]; i < first[way + 1]; i++) {
            const packet_t *packet = &m->packet[i];
            double *corner = sim->packed + packet->corner;
            if (!(packet->marks & moved)) continue;
            pack_packet(sim, packet, corner);
            /* values are changed in place by patches, and have to be found anew then */
            const uint32_t n = corners_of(way / 2) * (packet->vectors ? packet->vectors : 1);
            sim->wake[i] = all_zero(corner, n) ? ALL_AXES : packet->marks;
            if (sim->wake[i] == ALL_AXES) make_zero(sim, packet);
        }
    }
}
