/* Refusals, and calls that a phase does not allow. */
#include "guard.h"

#include <stdarg.h>
#include <stdio.h>

int fmu_refuse(const fmu *f, const char *format, ...) {
    char text[1024];
    va_list arguments;
    if (!f) return FMU_ERROR;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    f->logger.report(&f->logger, FMU_ERROR, text);
    return FMU_ERROR;
}

int demand(const fmu *f, int allowed, const char *what) {
    static const char *const phases[] = {
        "instantiated", "in configuration mode", "in initialization mode",
        "in step mode", "in event mode",         "in continuous-time mode",
        "terminated",   "stopped by an error"};
    if (!f) return FMU_ERROR;
    return allowed ? FMU_OK
                   : fmu_refuse(f, "%s is not allowed while the instance is %s", what,
                                phases[f->phase]);
}
