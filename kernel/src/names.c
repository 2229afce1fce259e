/* The names this library can compute. */
#include "model.h"

#include <string.h>

#define AM_NAME(code, name) name,
static const char *const INPUTS[] = {AM_INPUT_LIST(AM_NAME)};
static const char *const OUTPUTS[] = {AM_OUTPUT_LIST(AM_NAME)};
static const char *const PARAMETERS[] = {AM_PARAMETER_LIST(AM_NAME)};
static const char *const VARIABLES[] = {AM_VARIABLE_LIST(AM_NAME)};
static const char *const ENGINE_INPUTS[] = {AM_ENGINE_INPUT_LIST(AM_NAME)};
static const char *const ENGINE_OUTPUTS[] = {AM_ENGINE_OUTPUT_LIST(AM_NAME)};
static const char *const ENGINE_PARAMETERS[] = {AM_ENGINE_PARAMETER_LIST(AM_NAME)};
static const char *const ENGINE_VARIABLES[] = {AM_ENGINE_VARIABLE_LIST(AM_NAME)};

typedef struct {
    const char *const *fixed, *const *per_engine;
    int n_fixed, n_per_engine;
} list_t;

#define LENGTH(a) ((int)(sizeof(a) / sizeof(a)[0]))
#define LIST(a) {a, ENGINE_##a, LENGTH(a), LENGTH(ENGINE_##a)}
static const list_t LISTS[] = {LIST(INPUTS), LIST(OUTPUTS), LIST(PARAMETERS), LIST(VARIABLES)};

static bool known_kind(am_kind kind) { return (int)kind >= AM_INPUT && (int)kind <= AM_VARIABLE; }

int known_count(am_kind kind, bool per_engine) {
    if (!known_kind(kind)) return 0;
    return per_engine ? LISTS[kind].n_per_engine : LISTS[kind].n_fixed;
}

const char *am_known(am_kind kind, int i) {
    if (!known_kind(kind) || i < 0) return NULL;
    const list_t *list = &LISTS[kind];
    if (i < list->n_fixed) return list->fixed[i];
    return i < list->n_fixed + list->n_per_engine ? list->per_engine[i - list->n_fixed] : NULL;
}

int am_format(void) { return AM_FORMAT; }

const char *am_title(const am_model *model) { return model->title; }

const char *am_meta(const am_model *model) { return model->meta; }

static bool catalogued(am_kind kind) { return (int)kind >= AM_INPUT && (int)kind <= AM_AXIS; }

int am_count(const am_model *model, am_kind kind) { return catalogued(kind) ? model->count[kind] : 0; }

int am_entry_at(const am_model *model, am_kind kind, int i, am_entry *entry) {
    if (!catalogued(kind) || i < 0 || i >= model->count[kind]) return AM_BAD_INDEX;
    *entry = model->entry[kind][i];
    return AM_OK;
}

int am_find(const am_model *model, am_kind kind, const char *name) {
    for (int i = 0; i < am_count(model, kind); i++)
        if (strcmp(model->entry[kind][i].name, name) == 0) return i;
    return -1;
}

int am_state_count(const am_model *model) { return RIGID_STATES + (int)model->engines; }
