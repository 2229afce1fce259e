/* An instance brought to where it can be read. */
#include "readiness.h"

#include "guard.h"
#include "replay.h"

int initialize_instance(fmu *f) {
    f->fresh = 0;
    if (replay_waiting(f)) am_set_inputs(f->sim, f->replay.u);
    if (am_initialize(f->sim, f->start) != AM_OK) {
        return fmu_refuse(f, "initialisation failed: %s", am_error(f->sim));
    }
    f->time = f->start;
    f->moving = 0;
    f->initialized = 1;
    return FMU_OK;
}

int demand_initialized(fmu *f, const char *what) {
    if (demand(f, f->phase > FMU_CONFIGURING, what)) return FMU_ERROR;
    return f->phase == FMU_INITIALIZING && !f->initialized ? initialize_instance(f) : FMU_OK;
}

int refresh_outputs(fmu *f) {
    if (f->fresh) return FMU_OK;
    if (demand_initialized(f, "reading an output")) return FMU_ERROR;
    if (am_outputs(f->sim, f->y) != AM_OK) {
        return fmu_refuse(f, "outputs cannot be computed: %s", am_error(f->sim));
    }
    f->fresh = 1;
    return FMU_OK;
}
