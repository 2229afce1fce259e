/* Files of the unpacked FMU. */
#ifndef AEROMATCH_RESOURCE_H
#define AEROMATCH_RESOURCE_H

#include <stddef.h>

/* Turn a file URI (file:///a%20b, file:/a, file://host/share) into a native path; 0, or -1 when
 * it is not a file URI or is too long. */
int resource_path(const char *uri, char *path, size_t n);

/* Read a whole file with one fread; path is UTF-8 on every system.  NULL: *why states what went
 * wrong.  Free the bytes. */
unsigned char *resource_read(const char *path, size_t *n, const char **why);

#endif
