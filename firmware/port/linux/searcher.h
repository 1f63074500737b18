/* The search for contact in a thread of its own: whatever a scene takes, the period does not wait for it. It keeps a normal priority: in a scene that takes
 * all of a processor it must neither starve the file of the record nor make the kernel hold back real-time threads, the loop among them. */
#ifndef CREASED_SEARCHER_H
#define CREASED_SEARCHER_H

#include "servo.h"

#include <pthread.h>
#include <stdatomic.h>

typedef struct {
    cr_servo *servo;
    int wake; /* eventfd: a pose is there */
    atomic_int done;
    pthread_t thread;
} searcher;

/* Purpose  the thread, at normal priority whoever calls.   Output  0; -1: no thread or no descriptor. */
int searcher_start(searcher *s, cr_servo *servo);

/* Purpose  after a tick: its pose wants contact.   Threads  the loop's.   Cost  one write, which never waits. */
void searcher_wake(searcher *s);

/* Purpose  the end of the thread, within one slice. */
void searcher_end(searcher *s);

#endif
