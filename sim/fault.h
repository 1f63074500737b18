/* The fault table: what happens to frames and drives in which tick. Internal to the simulator. */
#ifndef CR_SIM_FAULT_H
#define CR_SIM_FAULT_H

#include "sim.h"

typedef struct {
    cr_sim_fault rows[CR_SIM_FAULTS_MAX];
    uint32_t count;
    uint64_t done; /* times a row acted */
} cr_fault_table;

/* What becomes of one frame. */
typedef struct {
    uint32_t copies;      /* 0 lost, 1, 2 twice */
    uint32_t delay_ticks; /* of every copy */
    uint32_t late;        /* 1: after the other frames of its tick */
} cr_fault_fate;

/* Purpose  replace the table.   Output  0; -1 when a row has an unknown kind, axis or direction, or count is too large. */
int cr_fault_set(cr_fault_table *table, const cr_sim_fault *rows, size_t count);

/* Purpose  the fate of a frame between one drive and the bus; a corrupting row changes its bytes. */
cr_fault_fate cr_fault_pass(cr_fault_table *table, uint32_t tick, uint32_t axis, uint32_t direction,
                            cr_sim_frame *frame);

/* Purpose  the row of that kind that acts on a drive in this tick.   Output  null when there is none; counted when there is. */
const cr_sim_fault *cr_fault_find(cr_fault_table *table, uint32_t tick, uint32_t axis, cr_sim_fault_kind kind);

#endif
