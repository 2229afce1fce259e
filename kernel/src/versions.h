/* What the processor decides: see versions.c. */
#ifndef AEROMATCH_VERSIONS_H
#define AEROMATCH_VERSIONS_H

#include <stddef.h>

struct am_sim;
typedef struct block block_t;

typedef struct {
    void (*interpolate)(struct am_sim *sim, int stage);
    void (*evaluate)(const block_t *block, size_t rows, const double *v, double *coefficients,
                     double *terms);
} versions_t;

versions_t best_versions(void);

/* avx2.c */
void interpolate_avx2(struct am_sim *sim, int stage);
void evaluate_avx2(const block_t *block, size_t rows, const double *v, double *coefficients,
                   double *terms);

#endif
