/* The CAN controller as the loop sees it: frames out, frames in, nothing waits. One file of the port implements it: fdcan.c for an
 * STM32H7, an500.c with slcan.c for the UART of an emulated board. All calls from the clock's interrupt, but can_start. */
#ifndef CORTEX_CAN_H
#define CORTEX_CAN_H

#include "servo.h"

#define CAN_BITRATE 1000000u

/* Purpose  on the bus, classical frames with 11-bit identifiers.   Output  0; -1: the controller does not answer. */
int can_start(void);

/* Purpose  one frame to be sent, after those before it.   Output  0; -1: no room, the frame is not sent. */
int can_send(const cr_frame *frame);

/* Purpose  the oldest frame that came.   Output  1: *frame; 0: none. */
int can_receive(cr_frame *frame);

/* Purpose  whether the controller has left the bus since last asked; it is brought back then. */
int can_was_off(void);

/* Purpose  frames that came and found no room, in total. */
uint32_t can_lost(void);

/* Purpose  off the bus at once, in the middle of a frame if need be. */
void can_stop(void);

#endif
