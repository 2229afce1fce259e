/* The aero model alone, for many rows of variables. */
#include "block.h"

#include "look_up.h"
#include "tables_avx2.h"
#include "terms.h"

#include <stdlib.h>

#define FEW 16 /* rows for which a block is not worth it */

static void *allocate_block(block_t *b, const am_sim *sim) {
    const am_model *m = sim->model;
    const size_t columns = 1 + (size_t)m->count[AM_VARIABLE] + m->axes + m->slots + m->terms;
    double *at = malloc((columns * ROWS + m->slots + SPILL) * sizeof(double)
                        + (size_t)m->axes * ROWS * sizeof(uint32_t)
                        + m->total[AM_VARIABLE] * sizeof(double *));
    if (!at) return NULL;
    b->sim = sim;
    b->one = at;
    b->variable = b->one + ROWS;
    b->fraction = b->variable + ROWS * (size_t)m->count[AM_VARIABLE];
    b->slot = b->fraction + ROWS * (size_t)m->axes;
    b->term = b->slot + ROWS * (size_t)m->slots;
    b->row = b->term + ROWS * (size_t)m->terms;
    b->column = (const double **)(b->row + m->slots + SPILL);
    b->node = (uint32_t *)(b->column + m->total[AM_VARIABLE]);
    for (int r = 0; r < ROWS; r++) b->one[r] = b->slot[r] = 1.0; /* slot 0 */
    for (uint32_t i = 0; i < m->total[AM_VARIABLE]; i++) b->column[i] = b->one;
    for (int i = 0; i < m->count[AM_VARIABLE]; i++) {
        b->column[m->variable[i]] = column_of(b->variable, (uint32_t)i);
    }
    return at;
}

/* ---- row by row: few of them, or changed nodes ----------------------------------------------- */

static void evaluate_row(am_sim *sim, const double *v, double *coefficients, double *terms) {
    const am_model *m = sim->model;
    for (int i = 0; i < m->count[AM_VARIABLE]; i++) sim->var[m->variable[i]] = v[i];
    for (int stage = 0; stage < STAGES; stage++) look_up(sim, stage);
    if (coefficients) memset(coefficients, 0, COEFFICIENTS * sizeof *coefficients);
    for (uint32_t i = 0; i < m->terms; i++) {
        const double value = term_value(sim, i);
        const uint32_t target = m->term[i].target;
        if (coefficients && target < COEFFICIENTS) coefficients[target] += value;
        if (terms) terms[i] = value;
    }
}

static void evaluate_rows(const block_t *b, size_t rows, const double *v, double *coefficients,
                          double *terms) {
    if (has_avx2(b->sim->model)) evaluate_avx2(b, rows, v, coefficients, terms);
    else evaluate_block(b, rows, v, coefficients, terms);
}

int am_evaluate(am_sim *sim, size_t n, const double *v, double *coefficients, double *terms) {
    const am_model *m = sim->model;
    const size_t nv = (size_t)m->count[AM_VARIABLE];
    block_t block;
    void *memory = n < FEW || sim->patches ? NULL : allocate_block(&block, sim);
    sim->fresh = sim->off_ground = false;
    for (size_t k = 0; k < n; k += memory ? ROWS : 1) {
        double *c = coefficients ? coefficients + k * COEFFICIENTS : NULL;
        double *t = terms ? terms + k * m->terms : NULL;
        if (memory) evaluate_rows(&block, n - k < ROWS ? n - k : ROWS, v + k * nv, c, t);
        else evaluate_row(sim, v + k * nv, c, t);
    }
    free(memory);
    return AM_OK;
}
