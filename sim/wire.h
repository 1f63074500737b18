/* The wire between host and simulated drives: every frame takes the time of its bits, the lowest identifier goes first, and nothing is
 * interrupted. Between sim.h and whoever plays the host; without it frames take no time. */
#ifndef CR_SIM_WIRE_H
#define CR_SIM_WIRE_H

#include "sim.h"

/* Frames of the host that wait; a controller has 32. */
#define CR_WIRE_HOST_MAX 32

typedef struct cr_wire cr_wire;

/* Purpose  a wire with these drives at the other end, idle. The drives stay the caller's and must outlive it.
 * Units    bit_ns: 1000 at 1 Mbit/s; 0: frames take no time. reaction_ns: from the end of a frame to a drive's answer being ready.
 * Output   null when memory is out. */
cr_wire *cr_wire_create(cr_sim *sim, uint32_t bit_ns, uint32_t reaction_ns, uint64_t now_ns);
void cr_wire_destroy(cr_wire *wire);

/* Purpose  the host hands over a frame; its frames leave in this order.   Output  0; -1 when the queue is full. */
int cr_wire_put(cr_wire *wire, const cr_sim_frame *frame, uint64_t now_ns);

/* Purpose  let time pass until the host has received a frame, or until_ns.
 * Output   1: *frame, whole at *at_ns <= until_ns; 0: nothing came. Call until 0 before going on in time. */
int cr_wire_get(cr_wire *wire, uint64_t until_ns, cr_sim_frame *frame, uint64_t *at_ns);

/* Purpose  bits that this very frame takes, stuff bits of its content and interframe space included.   Source  ISO 11898-1. */
uint32_t cr_wire_bits(const cr_sim_frame *frame);

#endif
