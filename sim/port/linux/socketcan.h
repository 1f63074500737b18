/* The simulated drives on a SocketCAN interface. Linux only. */
#ifndef CR_SIM_SOCKETCAN_H
#define CR_SIM_SOCKETCAN_H

#include "sim.h"

/* Why a run ended badly. */
enum { CR_SIM_RUN_OK = 0, CR_SIM_RUN_INTERFACE = -1, CR_SIM_RUN_SOCKET = -2, CR_SIM_RUN_LOST = -3 };

typedef struct {
    uint64_t dropped_rx; /* frames that the kernel threw away before we read them (SO_RXQ_OVFL) */
    uint64_t failed_tx;  /* frames that the kernel did not take */
    int error_number;    /* errno when the run ended badly */
} cr_sim_run_report;

/* Purpose  serve the bus until SIGINT, SIGTERM or the end of duration_us (0: no end) by the monotonic clock.
 * Output   CR_SIM_RUN_*: no such interface; no socket; interface lost.   Cost  blocks. Wakes every millisecond and per frame.
 * Threads  one run at a time in a process: it takes SIGINT and SIGTERM while it lasts, and gives them back. */
int cr_sim_run_socketcan(cr_sim *sim, const char *interface, uint64_t duration_us, cr_sim_run_report *report);

/* Purpose  microseconds of the monotonic clock: the time that a run hands to the drives. */
uint64_t cr_sim_now_us(void);

#endif
