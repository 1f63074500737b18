/* Who starts the machine, or the program, anew when the loop hangs: a watchdog device (Linux watchdog API) and the service manager
 * (sd_notify's protocol, without its library). Both hear of the loop only while it ticks. One thread. */
#ifndef CREASED_KEEPER_H
#define CREASED_KEEPER_H

#include <stdint.h>

#define KEEPER_TEXT_MAX 300
/* How often a watchdog device is told; the shortest of them wait a second. */
#define KEEPER_EVERY_NS 100000000u

typedef struct {
    int watchdog, notify;          /* file descriptors; -1: none */
    uint64_t told_ns, notified_ns; /* last time */
    uint64_t notify_every_ns;      /* 0: the manager does not watch */
    uint32_t beats;                /* of the loop, when last told */
    uint32_t notified_beats;
    int ready; /* 1: READY=1 is said */
} keeper;

/* Purpose  open what is there. `path`: of the watchdog; empty: none. NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID come from the
 *          environment, as systemd sets them; a manager that does not answer is no error.
 * Output   0; -1 and one line in error: the watchdog cannot be opened. */
int keeper_open(keeper *k, const char *path, char error[KEEPER_TEXT_MAX]);

/* Purpose  tell both that the loop is alive, when it is time and `beats` (ticks so far) has grown. Never waits. To be called every
 *          50 ms or so. */
void keeper_beat(keeper *k, uint32_t beats, uint64_t now_ns);

/* Purpose  the loop ends as asked: the manager hears STOPPING=1, the watchdog the letter that disarms it. */
void keeper_close(keeper *k);

#endif
