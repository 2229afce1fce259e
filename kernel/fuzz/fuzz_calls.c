/* libFuzzer: functions of kernel.h in any order with any numbers, on models that Python
 * compiled. */
#include "drive.h"

#include <stdlib.h>

enum { MOST_CALLS = 40 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t n) {
    static am_model *model[MODELS];
    for (int k = 0; k < MODELS && !model[k]; k++) model[k] = model_of_folder(k);
    bytes_t bytes = {data, n};
    const am_model *m = model[take_byte(&bytes) % MODELS];
    am_sim *sim = am_new(m);
    if (!sim) return 0;
    if (take_byte(&bytes) % 4) { /* most flights begin as they should */
        am_set_parameter(sim, am_find(m, AM_PARAMETER, "init.V"), 80.0);
        am_initialize(sim, 0.0);
    }
    for (int k = 0; k < MOST_CALLS && bytes.left; k++) call_kernel(m, sim, &bytes);
    am_delete(sim);
    return 0;
}
