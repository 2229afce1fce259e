/* The first-order lag of toy.c, which does harm at a place that its guid names: in instantiation, initialisation, a step, or the end. */
#define _GNU_SOURCE
#define fmi2Instantiate toy_instantiate
#define fmi2ExitInitializationMode toy_exit_initialization
#define fmi2DoStep toy_step
#define fmi2GetReal toy_get
#define fmi2Terminate toy_terminate
#define fmi2FreeInstance toy_free
#include "toy.c"
#undef fmi2Instantiate
#undef fmi2ExitInitializationMode
#undef fmi2DoStep
#undef fmi2GetReal
#undef fmi2Terminate
#undef fmi2FreeInstance

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/stat.h>
#include <unistd.h>

static int is(const char *kind, const char *name) { return !strcmp(kind, name); }
static void hang(void) {
    for (;;) usleep(10000);
}
static volatile int depth;
static int deeper(int n) {
    volatile char frame[4096];
    frame[n % 4096] = (char)n;
    depth += deeper(n + 1) + frame[0];
    return depth;
}
static void *fault(void *nothing) {
    raise(SIGSEGV);
    return nothing;
}
/* a process that keeps all pipes open for a minute, in the session of its parent or in one of its own */
static void leave_behind(int own_session) {
    if (fork()) return;
    if (own_session) setsid();
    sleep(600);
    _exit(0);
}
static void write_everywhere(const char *bytes, size_t size) {
    for (int handle = 3; handle < 16; handle++) {
        struct stat about;
        if (!fstat(handle, &about) && (S_ISFIFO(about.st_mode) || S_ISSOCK(about.st_mode)))
            if (write(handle, bytes, size) < 0) continue;
    }
}

static void harm(const char *kind) {
    if (is(kind, "segv")) raise(SIGSEGV);
    if (is(kind, "abort")) abort();
    if (is(kind, "fpe")) raise(SIGFPE);
    if (is(kind, "ill")) raise(SIGILL);
    if (is(kind, "bus")) raise(SIGBUS);
    if (is(kind, "kill")) raise(SIGKILL);
    if (is(kind, "alarm")) raise(SIGALRM);
    if (is(kind, "stop")) raise(SIGSTOP);
    if (is(kind, "exit")) exit(0);
    if (is(kind, "exit7")) _exit(7);
    if (is(kind, "hang")) hang();
    if (is(kind, "spin"))
        for (volatile double x = 1.0; x > 0.0;) x += 1.0;
    if (is(kind, "stack")) deeper(1);
    if (is(kind, "thread")) {
        pthread_t other;
        pthread_create(&other, NULL, fault, NULL);
        pthread_join(other, NULL);
    }
    if (is(kind, "free")) {
        char *volatile block = malloc(64);
        free(block);
        free(block);
    }
    if (is(kind, "memory"))
        for (;;) {
            char *volatile block = malloc(1 << 24);
            if (!block) abort();
            block[0] = 1;
        }
    if (is(kind, "exec")) execl("/bin/sh", "sh", "-c", "exit 5", (char *)NULL);
    if (is(kind, "fork_segv") || is(kind, "leave_segv")) {
        leave_behind(is(kind, "leave_segv"));
        raise(SIGSEGV);
    }
    if (is(kind, "fork_hang") || is(kind, "leave_hang")) {
        leave_behind(is(kind, "leave_hang"));
        hang();
    }
    if (is(kind, "fork_exit")) {
        leave_behind(0);
        _exit(0);
    }
    if (is(kind, "flood"))
        for (;;) fputs("all work and no play makes a dull model\n", stderr);
    if (is(kind, "flood_out")) {
        char line[4096];
        memset(line, 'x', sizeof line);
        for (;;)
            if (write(1, line, sizeof line) < 0) hang();
    }
    if (is(kind, "disk")) {
        const int file = open(getenv("BAD_FILE"), O_CREAT | O_WRONLY, 0600);
        char block[4096];
        memset(block, 'x', sizeof block);
        while (write(file, block, sizeof block) > 0) continue;
        raise(errno == EFBIG ? SIGABRT : SIGSEGV);
    }
    if (is(kind, "garbage")) {
        write_everywhere("this is no reply at all, but it is long enough to be the head of one", 68);
        hang();
    }
    if (is(kind, "forged")) { /* the head of a reply to another job */
        char head[32] = "aeroFMU1";
        head[8] = 99;
        write_everywhere(head, sizeof head);
        hang();
    }
    if (is(kind, "huge")) { /* the head of a reply of 16 EB */
        char head[32] = "aeroFMU1\1";
        memset(head + 24, 0x7f, 8);
        write_everywhere(head, sizeof head);
        hang();
    }
    if (is(kind, "pickle")) { /* what unpickling would run: os.system("touch $BAD_FILE") */
        char text[512];
        const int size = snprintf(text, sizeof text, "cos\nsystem\n(S'touch %s'\ntR.", getenv("BAD_FILE"));
        write_everywhere(text, (size_t)size);
        hang();
    }
    if (is(kind, "closed"))
        for (int handle = 0; handle < 64; handle++) close(handle);
}

/* "i:" in instantiation, "x:" in initialisation, "e:" in the end; else in a step */
static const char *at(const char *kind, const char *place) { return strncmp(kind, place, 2) ? "" : kind + 2; }

API void *fmi2Instantiate(const char *name, int type, const char *guid, const char *place, const void **callbacks, int visible, int logging) {
    harm(at(guid, "i:"));
    return is(guid, "i:null") ? NULL : toy_instantiate(name, type, guid, place, callbacks, visible, logging);
}
API int fmi2ExitInitializationMode(void *c) {
    harm(at(((toy_t *)c)->kind, "x:"));
    return is(((toy_t *)c)->kind, "x:error") ? 3 : toy_exit_initialization(c);
}
API int fmi2DoStep(void *c, double t, double h, int no_set) {
    const char *kind = ((toy_t *)c)->kind;
    if (t > 0.5) {
        harm(kind);
        if (is(kind, "discard")) return 2;
        if (is(kind, "fatal")) return 4;
        if (is(kind, "odd")) return 77;
    }
    return toy_step(c, t, h, no_set);
}
API int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *value) {
    const int found = toy_get(c, vr, n, value);
    if (is(((toy_t *)c)->kind, "inf"))
        for (size_t i = 0; i < n; i++) value[i] = INFINITY;
    return is(((toy_t *)c)->kind, "no_outputs") ? 3 : found;
}
API int fmi2Terminate(void *c) { return is(((toy_t *)c)->kind, "e:error") ? 3 : toy_terminate(c); }
API void fmi2FreeInstance(void *c) {
    harm(at(((toy_t *)c)->kind, "e:"));
    toy_free(c);
}
