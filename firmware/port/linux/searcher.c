#include "searcher.h"

#include <errno.h>
#include <stdint.h>
#include <sys/eventfd.h>
#include <unistd.h>

/* Lookups between two looks at `done`: some 20 us. */
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
    s->wake = eventfd(0u, EFD_CLOEXEC);
    return s->wake >= 0 && pthread_create(&s->thread, NULL, run, s) == 0 ? 0 : -1;
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
