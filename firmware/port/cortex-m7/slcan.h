/* CAN frames as the text of serial adapters (slcan): `tIIILDD...`, ended by a carriage return. Only what a loop with classical frames
 * and 11-bit identifiers needs; no registers. Source: LAWICEL CAN232 manual, 2.3; drivers/net/can/slcan of Linux reads and writes it. */
#ifndef CORTEX_SLCAN_H
#define CORTEX_SLCAN_H

#include "servo.h"

/* The longest line: t, 3 of the identifier, 1 of the length, 16 of data, the end. */
#define SLCAN_LINE_MAX 22u

/* All zero before the first character. */
typedef struct {
    char line[SLCAN_LINE_MAX];
    uint32_t used;    /* of it; SLCAN_LINE_MAX: longer than any line of ours, the rest of it is skipped */
    uint32_t open;    /* 1: the other end has opened the channel (O), and not closed it (C) */
    uint32_t refused; /* lines that began as a frame and were none */
} slcan;

/* Purpose  a frame as text.   Shapes  out[SLCAN_LINE_MAX], not ended by zero.   Output  characters; 0 when the frame is none: an
 *          identifier above 0x7ff or more than 8 bytes. */
uint32_t slcan_write(const cr_frame *frame, char *out);

/* Purpose  the next character that came. Lines of other kinds are passed over.   Output  1: *frame is whole; 0: not yet. */
int slcan_read(slcan *in, char character, cr_frame *frame);

#endif
