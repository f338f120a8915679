/* SPDX-License-Identifier: Apache-2.0
   A wall clock that can be set: CLOCK_REALTIME is off by what the file CLOCK_FILE holds (int64, ns),
   also in the middle of a wait for a time of it, as the kernel has it. For a process and those that
   it starts; the clock of the machine stays as it is: test_clock_jumps.py. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define SECOND 1000000000LL
#define SLICE 10000000LL /* ns, after which a wait looks whether the clock was set */

static volatile int64_t none, *offset = &none;
static int watching = -1; /* the timer that is to be cancelled when the clock is set */
static int64_t watched;

__attribute__((constructor)) static void open_clock(void) {
    const char *path = getenv("CLOCK_FILE");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0) return;
    void *at = mmap(0, sizeof none, PROT_READ, MAP_SHARED, file, 0);
    if (at != MAP_FAILED) offset = at;
    close(file);
}

static int64_t ns(const struct timespec *at) { return at->tv_sec * SECOND + at->tv_nsec; }

static struct timespec time_of(int64_t at) {
    int64_t rest = (at % SECOND + SECOND) % SECOND;
    return (struct timespec){(at - rest) / SECOND, rest};
}

static int64_t real(clockid_t clock) {
    struct timespec now;
    static int (*next)(clockid_t, struct timespec *);
    if (!next) next = dlsym(RTLD_NEXT, "clock_gettime");
    next(clock, &now);
    return ns(&now);
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*next)(clockid_t, struct timespec *);
    if (!next) next = dlsym(RTLD_NEXT, "clock_gettime");
    int result = next(clock, now);
    if (!result && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        *now = time_of(ns(now) + *offset);
    return result;
}

int gettimeofday(struct timeval *now, void *zone) {
    (void)zone;
    struct timespec at = time_of(real(CLOCK_REALTIME) + *offset);
    *now = (struct timeval){at.tv_sec, at.tv_nsec / 1000};
    return 0;
}

time_t time(time_t *now) {
    time_t at = time_of(real(CLOCK_REALTIME) + *offset).tv_sec;
    if (now) *now = at;
    return at;
}

/* Whether a time to wait for is one of the wall clock, and how it stands on the kernel's. */
static int is_of_wall(const struct timespec *until) {
    return llabs(ns(until) - real(CLOCK_REALTIME) - *offset) < llabs(ns(until) - real(CLOCK_MONOTONIC));
}

/* A wait on a condition lasts longer when the clock is set back meanwhile. When it is set forward
   the kernel would end it early: nobody would notice but by a look at the clock, so it is left out,
   for a wait that is cut into pieces could lose what it waits for. */
int pthread_cond_timedwait(pthread_cond_t *cond, pthread_mutex_t *mutex, const struct timespec *until) {
    static int (*next)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    if (!next) next = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
    if (!next) next = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    if (!is_of_wall(until)) return next(cond, mutex, until);
    for (;;) {
        struct timespec at = time_of(ns(until) - *offset);
        int result = next(cond, mutex, &at);
        if (result != ETIMEDOUT || ns(until) <= real(CLOCK_REALTIME) + *offset) return result;
    }
}

/* Other waits look for it now and then: nothing that comes meanwhile is lost. */
#define WAIT(call, timed_out)                                            \
    if (!is_of_wall(until)) return call(until);                          \
    for (;;) {                                                           \
        int64_t now = real(CLOCK_REALTIME), left = ns(until) - *offset - now; \
        struct timespec slice = time_of(now + (left < SLICE ? left : SLICE)); \
        int result = call(&slice);                                       \
        if (left <= SLICE || !(timed_out)) return result;                \
    }

int pthread_mutex_timedlock(pthread_mutex_t *mutex, const struct timespec *until) {
    static int (*next)(pthread_mutex_t *, const struct timespec *);
    if (!next) next = dlsym(RTLD_NEXT, "pthread_mutex_timedlock");
#define LOCK(at) next(mutex, at)
    WAIT(LOCK, result == ETIMEDOUT)
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until) {
    static int (*next)(sem_t *, const struct timespec *);
    if (!next) next = dlsym(RTLD_NEXT, "sem_timedwait");
#define TAKE(at) next(semaphore, at)
    WAIT(TAKE, result && errno == ETIMEDOUT)
}

int timerfd_settime(int file, int flags, const struct itimerspec *value, struct itimerspec *old) {
    static int (*next)(int, int, const struct itimerspec *, struct itimerspec *);
    if (!next) next = dlsym(RTLD_NEXT, "timerfd_settime");
    if (flags & TFD_TIMER_CANCEL_ON_SET) watching = file, watched = *offset;
    return next(file, flags, value, old);
}

ssize_t read(int file, void *to, size_t size) {
    static ssize_t (*next)(int, void *, size_t);
    if (!next) next = dlsym(RTLD_NEXT, "read");
    if (file != watching) return next(file, to, size);
    struct pollfd one = {file, POLLIN, 0};
    while (watched == *offset)
        if (poll(&one, 1, SLICE / 1000000) != 0) return next(file, to, size);
    watched = *offset;
    errno = ECANCELED;
    return -1;
}
