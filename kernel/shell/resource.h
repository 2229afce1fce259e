/* Files of the unpacked FMU. */
#ifndef AEROMATCH_RESOURCE_H
#define AEROMATCH_RESOURCE_H

#include <stddef.h>

/* Write the native path of a location: a file URI (file:///a%20b, file:/a, file://host/share), as
 * FMI 2.0 has it, or a path, as FMI 3.0 has it.  Importers of either give both.  0, or -1 when it
 * is neither or too long. */
int resource_path(const char *location, char *path, size_t n);

/* Read a whole file with one fread; path is UTF-8 on every system.  NULL: *why states what went
 * wrong.  Free the bytes. */
unsigned char *resource_read(const char *path, size_t *n, const char **why);

#endif
