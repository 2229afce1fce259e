#include "image.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "engine.h"
#include "error.h"
#include "nodes.h"
#include "simulation.h"
#include "cells.h"
#include "weather.h"

/* What am_copy copies: everything behind the pointers, free of addresses. */
static const size_t MOVING = offsetof(am_sim, now);

uint64_t image_layout(void) { return (uint64_t)AM_FORMAT << 32 | sizeof(am_sim); }

size_t image_size(const am_model *model) { return model->sim_bytes - MOVING; }

void image_save(const am_sim *sim, void *image) {
    memcpy(image, (const char *)sim + MOVING, image_size(sim->model));
}

/* A byte that is neither 0 nor 1 is not a bool. */
static bool truth(const bool *stored) {
    unsigned char byte;
    memcpy(&byte, stored, 1);
    return byte == 1;
}

static bool valid(const am_sim *sim) {
    const am_model *m = sim->model;
    const bool finite = all_finite(&sim->omega, 1)
                        && all_finite(sim->par, (size_t)m->count[AM_PARAMETER])
                        && all_finite(sim->u, (size_t)m->count[AM_INPUT])
                        && all_finite(sim->x, (size_t)am_state_count(m))
                        && all_finite(sim->memory, m->memories);
    return finite && sim->earth >= FLAT_EARTH && sim->earth <= SPHERE_ROTATING
           && fabs(sim->time) <= LATEST && weather_memory_valid(sim) && engine_memory_valid(sim);
}

int image_restore(am_sim *sim, const void *image) {
    memcpy((char *)sim + MOVING, image, image_size(sim->model));
    sim->text[sizeof sim->text - 1] = 0;
    sim->ready = truth(&sim->ready);
    sim->prepared = sim->fresh = sim->anchored = sim->off_ground = sim->windy = false;
    check_patches(sim); /* these and the cells are the only indices among the bytes */
    restore_cells(sim);
    return valid(sim) ? 0 : -1;
}

size_t image_memories(const am_model *model) { return model->memories; }

const double *image_memory(const am_sim *sim, size_t *n) {
    /* circuits stand last */
    *n = sim->controls == SURFACE_DRIVEN ? sim->model->first_memory[G_CIRCUIT]
                                         : sim->model->memories;
    return sim->memory;
}
