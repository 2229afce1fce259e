/* Region tables of a block, checked so that a look-up needs no check. */
#include "read_envelope.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_TABLES 64u

typedef struct {
    const unsigned char *bytes;
    size_t at, size;
} place_t;

static const void *take(place_t *from, size_t n, size_t width) {
    const size_t room = from->size - from->at;
    if (n > room / width) return NULL;
    const size_t bytes = (n * width + 7) / 8 * 8;
    if (bytes > room) return NULL;
    const void *found = from->bytes + from->at;
    from->at += bytes;
    return found;
}

static bool rise(const double *edge, size_t n) {
    for (size_t i = 0; i < n; i++) {
        if (!isfinite(edge[i]) || (i && !(edge[i] > edge[i - 1]))) return false;
    }
    return true;
}

/* Axes of a table: words are its number of axes, then variable and number of edges of each. */
static bool read_axes_of(reader *r, place_t *from, const uint32_t *words, region_table_t *to) {
    for (uint32_t k = 0; k < to->axes; k++) {
        const uint32_t variable = words[1 + 2 * k];
        to->edges[k] = words[2 + 2 * k];
        if (variable >= r->count[VARIABLES] || is_implicit(r->model->variable[variable])) {
            return refuse_block(r, "model block: a region table has an unknown axis");
        }
        to->variable[k] = r->model->variable[variable];
        const double *edge = take(from, to->edges[k], sizeof(double));
        if (!edge || !rise(edge, to->edges[k])) {
            return refuse_block(r, "model block: the edges of a region table do not rise");
        }
        to->edge[k] = edge;
    }
    return true;
}

static bool read_region_table(reader *r, place_t *from, region_table_t *to) {
    const uint32_t *words = take(from, 1, sizeof(uint32_t));
    if (!words || words[0] > MAX_REGION_AXES) {
        return refuse_block(r, "model block: a region table has too many axes");
    }
    to->axes = words[0];
    from->at -= 8; /* the axes follow the number without a gap */
    words = take(from, 1 + 2 * (size_t)to->axes, sizeof(uint32_t));
    if (!words) return refuse_block(r, "model block: region tables outside the block");
    if (!read_axes_of(r, from, words, to)) return false;
    size_t cells = 1;
    for (uint32_t k = 0; k < to->axes; k++) {
        if (cells > from->size / ((size_t)to->edges[k] + 1)) {
            return refuse_block(r, "model block: region tables outside the block");
        }
        cells *= (size_t)to->edges[k] + 1;
    }
    to->cell = take(from, cells, 1);
    return to->cell || refuse_block(r, "model block: region tables outside the block");
}

bool read_envelope(reader *r) {
    am_model *m = r->model;
    const bool exists = r->count[ENVELOPE] > 0;
    if (m->items[G_ENVELOPE] != (exists ? 1u : 0u)) {
        return refuse_block(r, "model block: an envelope needs its section and its outputs");
    }
    if (!exists) return true;
    place_t from = {r->at[ENVELOPE], 0, r->count[ENVELOPE]};
    const uint32_t *head = take(&from, 2, sizeof(uint32_t));
    if (!head || head[0] > MOST_TABLES) {
        return refuse_block(r, "model block: too many region tables");
    }
    m->region = calloc((size_t)head[0] + 1, sizeof *m->region);
    if (!m->region) return refuse_block(r, "model block: no memory");
    for (m->regions = 0; m->regions < head[0]; m->regions++) {
        if (!read_region_table(r, &from, m->region + m->regions)) return false;
    }
    return true;
}
