/* The terms of a block. */
#ifndef AEROMATCH_READ_TERMS_H
#define AEROMATCH_READ_TERMS_H

#include "block_reader.h"

/* Read the terms and lay them out for evaluation; false after a refusal. */
bool read_terms(reader *r);

#endif
