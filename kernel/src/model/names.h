/* The names this library can compute, group by group. */
#ifndef AEROMATCH_NAMES_H
#define AEROMATCH_NAMES_H

#include "model.h"

/* Pattern of a name, a star in place of the item; NULL past the last code of the group. */
const char *group_pattern(int kind, int group, uint32_t code);

/* Number of names that one item of a group has. */
uint32_t group_size(int kind, int group);

/* Stage of a variable (first that may use it) or target (that evaluates it). */
int pattern_stage(int kind, int group, uint32_t code);

/* Write the pattern with the name of the item in place of the star. */
void item_name(char to[NAME_SIZE], const char *pattern, const char *item);

/* Doubles of the discrete memory, and of the results of the last derivative, of one item. */
uint32_t memory_size(int group);
uint32_t work_size(int group);

#endif
