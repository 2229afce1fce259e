#include "image.h"

#include <stddef.h>
#include <string.h>

#include "model.h"

/* What am_copy copies: everything behind the pointers, free of addresses. */
static const size_t MOVING = offsetof(am_sim, now);

size_t image_size(const am_model *model) { return model->sim_bytes - MOVING; }

void image_save(const am_sim *sim, void *image) { memcpy(image, (const char *)sim + MOVING, image_size(sim->model)); }

void image_restore(am_sim *sim, const void *image) {
    memcpy((char *)sim + MOVING, image, image_size(sim->model));
    sim->text[sizeof sim->text - 1] = 0;
    check_patches(sim); /* these and the cells are the only indices among the bytes */
    settle_cells(sim);
}
