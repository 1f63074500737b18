#include "searcher.h"

#include <errno.h>
#include <sched.h>
#include <stdint.h>
#include <sys/eventfd.h>
#include <unistd.h>

/* Lookups between two looks at `done`: tens of microseconds, hundreds where one step is long. */
#define SLICE_WORK 64u

static void *run(void *argument) {
    searcher *s = argument;
    uint64_t poses;
    while (!atomic_load(&s->done)) {
        if (cr_servo_search(s->servo, SLICE_WORK) > 0u) {
            continue;
        }
        while (read(s->wake, &poses, sizeof poses) < 0 && errno == EINTR) {
            /* a signal is the loop's */
        }
    }
    return NULL;
}

int searcher_start(searcher *s, cr_servo *servo) {
    s->servo = servo;
    const struct sched_param normal = {.sched_priority = 0};
    pthread_attr_t how;
    s->wake = eventfd(0u, EFD_CLOEXEC);
    if (s->wake < 0 || pthread_attr_init(&how) != 0) {
        return -1;
    }
    int error = pthread_attr_setinheritsched(&how, PTHREAD_EXPLICIT_SCHED);
    error |= pthread_attr_setschedpolicy(&how, SCHED_OTHER);
    error |= pthread_attr_setschedparam(&how, &normal);
    error = error != 0 ? error : pthread_create(&s->thread, &how, run, s);
    (void)pthread_attr_destroy(&how);
    return error == 0 ? 0 : -1;
}

void searcher_wake(searcher *s) {
    const uint64_t one = 1u;
    while (write(s->wake, &one, sizeof one) < 0 && errno == EINTR) {
        /* again */
    }
}

void searcher_end(searcher *s) {
    atomic_store(&s->done, 1);
    searcher_wake(s);
    pthread_join(s->thread, NULL);
    close(s->wake);
}
