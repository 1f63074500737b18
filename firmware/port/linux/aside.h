/* What goes on beside the loop: the file, the text and the commands, a thread each, so that a disk or a terminal that does not answer
 * holds up nothing else. The loop hands over through rings and atomics and never waits. */
#ifndef CREASED_ASIDE_H
#define CREASED_ASIDE_H

#include "keeper.h"
#include "servo.h"

#include <pthread.h>
#include <stdatomic.h>

#define ASIDE_RING_RECORDS 8192u /* 8 s at 1 kHz: how long the disk may stall */
#define ASIDE_NEWS_RECORDS 64u   /* changes of mode that the text side may be behind */
#define ASIDE_TEXT_MAX 600

enum { ASIDE_FILE, ASIDE_TEXT, ASIDE_COMMANDS, ASIDE_THREADS };

typedef struct {
    cr_record_ring *ring, *news;
    int file;  /* descriptor of the record; -1: none */
    int quiet; /* 1: no line when the mode changes */
    keeper keep;
    atomic_uint commands; /* CR_COMMAND_* since last taken */
    atomic_uint beats;    /* ticks of the loop */
    atomic_int quit, done;
    atomic_int write_errno;              /* why the record ended early; 0: it did not */
    atomic_uint unwritten;               /* records lost to that */
    atomic_int file_is_out, text_is_out; /* the threads have nothing left */
    atomic_int complained;               /* 1: `complaint` waits for the text side */
    char complaint[128];
    char last[ASIDE_TEXT_MAX], last_error[ASIDE_TEXT_MAX]; /* set before done */
    uint32_t told_mode, told_faults;                       /* of the loop's side */
    pthread_t threads[ASIDE_THREADS];
} aside;

/* Purpose  memory for the rings, and the threads, with the priority of whoever calls: before the loop takes a higher one.
 * Output   0; -1: memory or threads are out. */
int aside_start(aside *a);

/* Purpose  the record of a tick.   Threads  the loop's.   Cost  one copy, two when the mode changed. Never waits. */
void aside_take(aside *a, const cr_record *record);

/* Purpose  the end: everything out, but no longer than the patience of each side (5 s for the file, 1 s for the text).
 * Output   0; -1: a thread is stuck, the caller must leave by _exit. */
int aside_finish(aside *a);

#endif
