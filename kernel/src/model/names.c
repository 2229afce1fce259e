/* The names this library can compute. */
#include "names.h"

#include <stdio.h>
#include <string.h>

typedef struct {
    const char *pattern;
    int stage;
} name_t;

#define AM_NAME(code, name) {name, 0},
#define AM_NAME_STAGED(code, name, stage) {name, stage},
#define AM_NAMES(group, lists, word)                                                             \
    static const name_t lists##_INPUTS[] = {AM_##lists##_INPUTS(AM_NAME){NULL, 0}};              \
    static const name_t lists##_OUTPUTS[] = {AM_##lists##_OUTPUTS(AM_NAME){NULL, 0}};            \
    static const name_t lists##_PARAMETERS[] = {AM_##lists##_PARAMETERS(AM_NAME){NULL, 0}};      \
    static const name_t lists##_STATES[] = {AM_##lists##_STATES(AM_NAME){NULL, 0}};              \
    static const name_t lists##_VARIABLES[] = {AM_##lists##_VARIABLES(AM_NAME_STAGED){NULL, 0}}; \
    static const name_t lists##_TARGETS[] = {AM_##lists##_TARGETS(AM_NAME_STAGED){NULL, 0}};
AM_GROUP_LIST(AM_NAMES)

/* in the order of the kinds: AM_INPUT, AM_OUTPUT, AM_PARAMETER, AM_STATE, AM_VARIABLE, AM_TARGET */
#define AM_ROW(group, lists, word)                          \
    {lists##_INPUTS, lists##_OUTPUTS,   lists##_PARAMETERS, \
     lists##_STATES, lists##_VARIABLES, lists##_TARGETS},
static const name_t *const NAMES[GROUPS][NAMED_KINDS] = {AM_GROUP_LIST(AM_ROW)};

#define LENGTH(a) (uint32_t)(sizeof(a) / sizeof(a)[0] - 1)
#define AM_LENGTHS(group, lists, word)                                              \
    {LENGTH(lists##_INPUTS), LENGTH(lists##_OUTPUTS),   LENGTH(lists##_PARAMETERS), \
     LENGTH(lists##_STATES), LENGTH(lists##_VARIABLES), LENGTH(lists##_TARGETS)},
static const uint32_t SIZES[GROUPS][NAMED_KINDS] = {AM_GROUP_LIST(AM_LENGTHS)};

#define AM_WORD(group, lists, word) word,
static const char *const WORDS[GROUPS] = {AM_GROUP_LIST(AM_WORD)};

#define AM_MEMORY(group, lists, word) D_PER_##lists,
static const uint32_t MEMORY[GROUPS] = {AM_GROUP_LIST(AM_MEMORY)};

#define AM_WORK(group, lists, word) W_PER_##lists,
static const uint32_t WORK[GROUPS] = {AM_GROUP_LIST(AM_WORK)};

uint32_t group_size(int kind, int group) { return SIZES[group][kind]; }

const char *group_pattern(int kind, int group, uint32_t code) {
    return code < SIZES[group][kind] ? NAMES[group][kind][code].pattern : NULL;
}

int pattern_stage(int kind, int group, uint32_t code) { return NAMES[group][kind][code].stage; }

uint32_t memory_size(int group) { return MEMORY[group]; }

uint32_t work_size(int group) { return WORK[group]; }

void item_name(char to[NAME_SIZE], const char *pattern, const char *item) {
    const char *star = strchr(pattern, '*');
    if (star) snprintf(to, NAME_SIZE, "%.*s%s%s", (int)(star - pattern), pattern, item, star + 1);
    else snprintf(to, NAME_SIZE, "%s", pattern);
}

/* The i-th name over all groups: its group and code; false past the end. */
static bool known_at(int kind, int i, int *group, uint32_t *code) {
    if (kind < 0 || kind >= NAMED_KINDS || i < 0) return false;
    for (*group = 0; *group < GROUPS; (*group)++) {
        *code = (uint32_t)i;
        if (*code < SIZES[*group][kind]) return true;
        i -= (int)SIZES[*group][kind];
    }
    return false;
}

const char *am_known(am_kind kind, int i) {
    int group;
    uint32_t code;
    return known_at((int)kind, i, &group, &code) ? NAMES[group][kind][code].pattern : NULL;
}

const char *am_known_group(am_kind kind, int i) {
    int group;
    uint32_t code;
    return known_at((int)kind, i, &group, &code) ? WORDS[group] : NULL;
}

int am_known_stage(am_kind kind, int i) {
    int group;
    uint32_t code;
    return known_at((int)kind, i, &group, &code) ? NAMES[group][kind][code].stage : -1;
}

const char *am_group(int i) { return i >= 0 && i < GROUPS ? WORDS[i] : NULL; }
