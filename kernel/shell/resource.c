#include "resource.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#endif

static int hex(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

/* Whether the text begins with "file:"; the scheme of a URI may be in capitals (RFC 3986). */
static int is_file_uri(const char *text) {
    static const char scheme[] = "file:";
    for (size_t i = 0; scheme[i]; i++) {
        if ((text[i] | 0x20) != (scheme[i] | 0x20)) return 0;
    }
    return 1;
}

/* What follows the scheme, from the first character of the path on. */
static const char *skip_host(const char *from) {
    if (strncmp(from, "///", 3) == 0) from += 2;
    else if (strncmp(from, "//localhost/", 12) == 0) from += 11;
#ifdef _WIN32
    if (from[0] == '/' && from[1] && from[2] == ':') from++; /* /C:/folder */
#endif
    return from;
}

int resource_path(const char *location, char *path, size_t n) {
    const int encoded = is_file_uri(location);
    const char *from = encoded ? skip_host(location + 5) : location;
    size_t k = 0;
    /* a path of another scheme is not on this machine */
    if (!encoded && strstr(location, "://")) return -1;
    for (; *from; from++) {
        char c = *from;
        if (encoded && c == '%') {
            int high = hex(from[1]);
            int low = high < 0 ? -1 : hex(from[2]);
            if (low < 0) return -1;
            c = (char)(16 * high + low);
            from += 2;
        }
        if (!c || k + 1 >= n) return -1;
        path[k++] = c;
    }
    path[k] = 0;
    return k ? 0 : -1;
}

static FILE *open_utf8(const char *path) {
#ifdef _WIN32
    wchar_t wide[4096];
    if (!MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, wide, 4096)) return NULL;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}

unsigned char *resource_read(const char *path, size_t *n, const char **why) {
    unsigned char *bytes = NULL;
    long size = -1;
    FILE *file = open_utf8(path);
    *why = "it cannot be opened";
    if (!file) return NULL;
    if (fseek(file, 0, SEEK_END) == 0) size = ftell(file);
    if (size >= 0 && fseek(file, 0, SEEK_SET) == 0) bytes = malloc((size_t)size + 1);
    *why = "it cannot be read";
    if (bytes && fread(bytes, 1, (size_t)size, file) != (size_t)size) {
        free(bytes);
        bytes = NULL;
    }
    fclose(file);
    if (bytes) *n = (size_t)size;
    return bytes;
}
