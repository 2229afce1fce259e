/* Packed block to immutable model.  Every number of the block is checked before use: any bytes
 * are safe.  flightmech/simulation/packer.py writes the block; block_reader.h is its format. */
#include "block_reader.h"

#include "allocate.h"
#include "read_catalogue.h"
#include "read_envelope.h"
#include "read_tables.h"
#include "read_terms.h"
#include "processor.h"

#include <math.h>
#include <stdlib.h>

/* One zeroed block of memory for the arrays of the model, carved in order. */
static bool allocate_model(reader *r) {
    am_model *m = r->model;
    m->axes = (uint32_t)r->count[AXES];
    m->bundles = (uint32_t)r->count[BUNDLES];
    m->terms = (uint32_t)r->count[TERMS];
    m->count[AM_INPUT] = (int)r->count[INPUTS];
    m->count[AM_OUTPUT] = (int)r->count[OUTPUTS];
    m->count[AM_PARAMETER] = (int)r->count[PARAMETERS];
    m->count[AM_STATE] = (int)r->count[STATES];
    m->count[AM_VARIABLE] = (int)r->count[VARIABLES];
    m->count[AM_TERM] = (int)m->terms;
    m->count[AM_AXIS] = (int)m->axes;
    for (int kind = AM_INPUT; kind <= AM_AXIS; kind++) {
        if (!(m->entry[kind] = calloc((size_t)m->count[kind] + 1, sizeof(am_entry)))) {
            return refuse_block(r, "model block: no memory");
        }
    }
    m->variable = calloc(r->count[VARIABLES] + 1, sizeof *m->variable);
    m->axis = calloc(m->axes + 1, sizeof *m->axis);
    m->cell = calloc(r->count[POINTS] + 3 * (size_t)m->axes + 1, sizeof *m->cell);
    m->bundle = calloc(m->bundles + 1, sizeof *m->bundle);
    m->packet = calloc(m->bundles + 1, sizeof *m->packet);
    m->bench = calloc(m->axes + 1, sizeof *m->bench);
    m->term = calloc(m->terms + 1, sizeof *m->term);
    m->implicit = calloc(m->terms + 1, sizeof *m->implicit);
    m->late = calloc(m->terms + 1, sizeof *m->late);
    m->power = calloc(m->terms + 1, sizeof *m->power);
    const bool tables = m->variable && m->axis && m->cell && m->bundle && m->packet && m->bench;
    const bool terms = m->term && m->implicit && m->late && m->power;
    return (tables && terms) || refuse_block(r, "model block: no memory");
}

static bool read_geometry(reader *r) {
    const geometry_record *g = r->at[GEOMETRY];
    am_model *m = r->model;
    if (!(isfinite(g->S) && g->S > 0 && isfinite(g->cbar) && g->cbar > 0 && isfinite(g->b)
          && g->b > 0 && isfinite(g->x_ref_mac))) {
        return refuse_block(r, "model block: S, cbar and b must be positive and x_ref_mac finite");
    }
    if (g->force_axes > BODY_AXES) {
        return refuse_block(r, "model block: force axes %u; allowed: 0 stability, 1 wind, 2 body",
                            (unsigned)g->force_axes);
    }
    m->S = g->S;
    m->cbar = g->cbar;
    m->b = g->b;
    m->x_ref_mac = g->x_ref_mac;
    m->force_axes = (int)g->force_axes;
    m->title = string_at(r, g->title);
    m->meta = string_at(r, g->meta);
    if (!m->title || !m->meta) {
        return refuse_block(r, "model block: title or meta lies outside the string table");
    }
    return true;
}

static bool read_block(reader *r, const unsigned char *bytes, size_t n) {
    if (!open_block(r, bytes, n) || !allocate_model(r) || !read_geometry(r)) return false;
    for (int kind = AM_INPUT; kind <= AM_VARIABLE; kind++) {
        if (!read_entries(r, INPUTS + kind, (am_kind)kind)) return false;
    }
    if (!read_items(r) || !find_group_starts(r) || !read_variables(r) || !read_axes(r)
        || !read_bundles(r) || !read_terms(r) || !read_envelope(r)) {
        return false;
    }
    return check_names(r, AM_INPUT, 0) && check_names(r, AM_OUTPUT, 0)
           && check_names(r, AM_STATE, 0)
           && check_names(r, AM_PARAMETER, (size_t)r->model->terms + r->model->powers)
           && check_scales(r) && forget_stages(r);
}

am_model *am_load(const void *bytes, size_t n, char *err, size_t nerr) {
    reader r = {.err = err, .nerr = nerr};
    if (err && nerr) err[0] = 0;
    if (read_block(&r, bytes, n)) {
        r.model->sim_bytes = sim_size(r.model);
        r.model->lanes = lanes_here();
        return r.model;
    }
    am_free(r.model);
    return NULL;
}

void am_free(am_model *model) {
    if (!model) return;
    for (int kind = AM_INPUT; kind <= AM_AXIS; kind++) free(model->entry[kind]);
    free(model->variable);
    free(model->axis);
    free(model->bundle);
    free(model->packet);
    free(model->bench);
    free(model->term);
    free(model->implicit);
    free(model->region);
    free(model->late);
    free(model->power);
    free(model->cell);
    free(model->target_stage);
    free(model->block);
    free(model);
}
