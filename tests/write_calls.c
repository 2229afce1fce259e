/* Kills the process at one of its calls that change a file or folder below a given folder, or lets
   this call fail.
   Loaded in front of the C library with LD_PRELOAD; tests/write_calls.py sets folder and call. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

static char watched[4096]; /* absolute path of the folder; empty: nothing is watched */
static long last_call;     /* number of the call that is not performed */
static long calls;
static int error_number;   /* errno of the failed call; 0: the process is killed */
static int stays;          /* all later calls fail too */

void kill_at_call(const char *folder, long number) {
    snprintf(watched, sizeof watched, "%s", folder);
    last_call = number;
    calls = 0;
    error_number = 0;
}

/* As `kill_at_call`, but the call fails with `error`; with `later` all calls after it as well.
   Without a call of this number, calls are counted only. */
void fail_at_call(const char *folder, long number, int error, int later) {
    kill_at_call(folder, number);
    error_number = error;
    stays = later;
}

long count_of_calls(void) { return calls; }

/* Count a call for the file or folder `path`, and return the errno of a call that must fail, or 0.
   The process ends here when the count is reached and no error is given. */
static int count_path(const char *path) {
    char full[8192];
    if (!watched[0]) return 0;
    if (path[0] != '/') {
        char here[4096];
        if (!getcwd(here, sizeof here)) return 0;
        snprintf(full, sizeof full, "%s/%.4000s", here, path);
        path = full;
    }
    if (strncmp(path, watched, strlen(watched)) != 0) return 0;
    long number = __sync_add_and_fetch(&calls, 1);
    if (number == last_call && !error_number) kill(getpid(), SIGKILL);
    return number == last_call || (stays && last_call && number > last_call) ? error_number : 0;
}

/* Count a call for an open file, whose path the kernel states in /proc. */
static int count_file(int file) {
    char link[64], path[4096];
    if (!watched[0]) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length < 0) return 0;
    path[length] = 0;
    /* pipes and sockets, "pipe:[7]", are in no folder */
    return path[0] == '/' ? count_path(path) : 0;
}

/* Each wrapper counts the call and passes it on to the function of the C library, or fails. */
#define WRAP(type, name, parameters, arguments, count)            \
    type name parameters {                                        \
        static type(*next) parameters;                            \
        if (!next) next = (type(*) parameters)dlsym(RTLD_NEXT, #name); \
        int error = count;                                        \
        if (error) {                                              \
            errno = error;                                        \
            return -1;                                            \
        }                                                         \
        return next arguments;                                    \
    }

WRAP(ssize_t, write, (int file, const void *data, size_t size), (file, data, size), count_file(file))
WRAP(ssize_t, pwrite, (int file, const void *data, size_t size, off_t at), (file, data, size, at), count_file(file))
WRAP(ssize_t, pwrite64, (int file, const void *data, size_t size, off64_t at), (file, data, size, at), count_file(file))
WRAP(int, fsync, (int file), (file), count_file(file))
WRAP(int, ftruncate, (int file, off_t size), (file, size), count_file(file))
WRAP(int, ftruncate64, (int file, off64_t size), (file, size), count_file(file))
WRAP(int, rename, (const char *from, const char *to), (from, to), count_path(to))
WRAP(int, renameat2, (int a, const char *from, int b, const char *to, unsigned flags), (a, from, b, to, flags), count_path(to))
WRAP(int, link, (const char *from, const char *to), (from, to), count_path(to))
WRAP(int, unlink, (const char *path), (path), count_path(path))
WRAP(int, mkdir, (const char *path, mode_t mode), (path, mode), count_path(path))
WRAP(int, rmdir, (const char *path), (path), count_path(path))
WRAP(int, chmod, (const char *path, mode_t mode), (path, mode), count_path(path))

#define WRAP_OPEN(name)                                                       \
    int name(const char *path, int flags, ...) {                              \
        static int (*next)(const char *, int, ...);                           \
        if (!next) next = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, #name); \
        va_list rest;                                                         \
        va_start(rest, flags);                                                \
        mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
        va_end(rest);                                                         \
        int error = 0;                                                        \
        if (flags & (O_WRONLY | O_RDWR | O_CREAT)) error = count_path(path);  \
        if (error) {                                                          \
            errno = error;                                                    \
            return -1;                                                        \
        }                                                                     \
        return next(path, flags, mode);                                       \
    }

WRAP_OPEN(open)
WRAP_OPEN(open64)
