/* The loops over tables (locate.h, block.h) exist twice: for any processor of the platform, and for
 * x86-64 with AVX2 (tables_avx2.c).  Both do the same operations on the same numbers: the results
 * have the same bits. */
#include "look_up.h"

#include "locate.h"
#include "tables_avx2.h"

void look_up(am_sim *sim, int stage) {
    if (has_avx2(sim->model)) look_up_avx2(sim, stage);
    else look_up_stage(sim, stage);
}
