/* Life of an instance. */
#include "guard.h"

#include "image.h"
#include "replay.h"
#include "resource.h"
#include "sha256.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int allocate(fmu *f) {
    f->inputs = (size_t)am_count(f->model, AM_INPUT);
    f->outputs = (size_t)am_count(f->model, AM_OUTPUT);
    f->parameters = (size_t)am_count(f->model, AM_PARAMETER);
    f->states = (size_t)am_state_count(f->model);
    if (!(f->sim = am_new(f->model))) return FMU_ERROR;
    f->u0 = calloc(3 * f->inputs + f->outputs + 2 * f->states + image_memories(f->model),
                   sizeof(double));
    if (!f->u0 || replay_resize(f, 1)) return FMU_ERROR;
    f->u1 = f->u0 + f->inputs;
    f->slopes = f->u1 + f->inputs;
    f->y = f->slopes + f->inputs;
    f->x = f->y + f->outputs;
    f->dx = f->x + f->states;
    f->memory = f->dx + f->states;
    return FMU_OK;
}

static am_model *load(const char *resources, const char *token, char digest[65], char *text,
                      size_t ntext) {
    static const char file[] = "model.bin";
    char path[4096];
    const char *why;
    size_t size = 0;
    /* room for a slash and the name of the file */
    if (!resources || resource_path(resources, path, sizeof path - sizeof file - 1) != 0) {
        snprintf(text, ntext,
                 "the resource location %.80s is neither a path nor a file URI, or is too long; "
                 "give the resources folder of the unpacked FMU, as a path or as "
                 "file:///<folder>/resources",
                 resources && *resources ? resources : "(none)");
        return NULL;
    }
    size_t n = strlen(path);
    if (path[n - 1] != '/' && path[n - 1] != '\\') path[n++] = '/';
    memcpy(path + n, file, sizeof file);
    unsigned char *bytes = resource_read(path, &size, &why);
    if (!bytes) {
        snprintf(text, ntext, "%.800s: %s; unpack the whole FMU before it is instantiated", path,
                 why);
        return NULL;
    }
    sha256_hex(bytes, size, digest);
    am_model *model = am_load(bytes, size, text, ntext);
    free(bytes);
    if (model && (!token || strcmp(token, digest) != 0)) {
        snprintf(text, ntext,
                 "token %.80s does not belong to model.bin, whose SHA-256 is %s; the FMU is mixed "
                 "from two, write it anew",
                 token ? token : "(none)", digest);
        am_free(model);
        model = NULL;
    }
    return model;
}

fmu *fmu_open(const char *resources, const char *token, fmu_kind kind, const fmu_logger *logger) {
    char text[1024] = "no memory";
    fmu *f = calloc(1, sizeof *f);
    if (f) {
        f->logger = *logger;
        f->kind = kind;
        f->model = load(resources, token, f->token, text, sizeof text);
        if (f->model && allocate(f) == FMU_OK) return f;
        if (f->model) snprintf(text, sizeof text, "no memory for an instance");
    }
    logger->report(logger, FMU_ERROR, text);
    fmu_close(f);
    return NULL;
}

void fmu_close(fmu *f) {
    if (!f) return;
    if (f->sim) am_delete(f->sim);
    if (f->model) am_free(f->model);
    free(f->u0);
    free(f->replay.t);
    free(f);
}

int fmu_reset(fmu *f) {
    if (!f) return FMU_ERROR;
    am_sim *sim = am_new(f->model);
    if (!sim || replay_resize(f, 1)) {
        if (sim) am_delete(sim);
        return fmu_refuse(f, "no memory for a reset");
    }
    am_delete(f->sim);
    f->sim = sim;
    memset(f->slopes, 0, f->inputs * sizeof(double));
    f->fresh = f->initialized = 0;
    f->start = f->time = 0.0;
    f->phase = FMU_CREATED;
    return FMU_OK;
}
