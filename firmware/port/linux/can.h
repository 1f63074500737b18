/* A SocketCAN interface as the servo sees it: frames out at once, frames in without waiting longer than said, losses counted. */
#ifndef CREASED_CAN_H
#define CREASED_CAN_H

#include "servo.h"

#define CAN_TEXT_MAX 200

typedef struct {
    int fd;
    uint32_t drops;   /* frames that the kernel threw away before they were read (SO_RXQ_OVFL), in total */
    uint32_t bus_off; /* 1: the controller left the bus, or the interface went down, since last asked */
    uint32_t off;     /* 1: it has not come back yet */
} can_port;

/* Purpose  open an interface for the servo's identifiers, and check its bit rate where it has one (vcan has none).
 * Output   0, or -1 and one line in error: no such interface, down, of another bit rate, no permission. */
int can_open(can_port *port, const char *interface, uint32_t bitrate, char error[CAN_TEXT_MAX]);
void can_close(can_port *port);

/* Purpose  send all frames in order.   Output  0, or -1 when one was not taken. Never waits. While the controller is off the bus
 *          nothing is handed to it: the kernel empties the queue at bus-off, and what came after would leave late. */
int can_send(can_port *port, const cr_tx *tx);

/* Purpose  one frame, waiting until `until_ns` of CLOCK_MONOTONIC (0: not at all).   Output  1: a frame; 0: none; error frames are
 *          turned into bus_off. */
int can_receive(can_port *port, uint64_t until_ns, cr_frame *frame);

/* Purpose  bit rate in an RTM_NEWLINK message of the kernel.   Shapes  message[size].   Output  bit/s; 0 when it has none. */
uint32_t can_bitrate_of(const void *message, size_t size);

/* CLOCK_MONOTONIC. */
uint64_t can_now_ns(void);

#endif
