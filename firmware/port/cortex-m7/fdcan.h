/* FDCAN of an STM32H7 (Bosch M_CAN), by its registers. The block to drive is an argument, so that a test can hand in plain memory.
 * Source: ST RM0433 rev 8, chapter 56. */
#ifndef CORTEX_FDCAN_H
#define CORTEX_FDCAN_H

#include "servo.h"

/* Words of the register block and of the message RAM that this driver uses. */
#define FDCAN_REGISTER_WORDS 64u
#define FDCAN_RX_FRAMES 64u
#define FDCAN_TX_FRAMES 32u
#define FDCAN_FRAME_WORDS 4u
#define FDCAN_RAM_WORDS ((FDCAN_RX_FRAMES + FDCAN_TX_FRAMES) * FDCAN_FRAME_WORDS)

/* Register offsets, in words. */
enum {
    FDCAN_CCCR = 0x18 / 4,
    FDCAN_NBTP = 0x1C / 4,
    FDCAN_PSR = 0x44 / 4,
    FDCAN_IR = 0x50 / 4,
    FDCAN_IE = 0x54 / 4,
    FDCAN_GFC = 0x80 / 4,
    FDCAN_SIDFC = 0x84 / 4,
    FDCAN_XIDFC = 0x88 / 4,
    FDCAN_RXF0C = 0xA0 / 4,
    FDCAN_RXF0S = 0xA4 / 4,
    FDCAN_RXF0A = 0xA8 / 4,
    FDCAN_RXESC = 0xBC / 4,
    FDCAN_TXBC = 0xC0 / 4,
    FDCAN_TXFQS = 0xC4 / 4,
    FDCAN_TXESC = 0xC8 / 4,
    FDCAN_TXBAR = 0xD0 / 4,
    FDCAN_TXBCR = 0xD4 / 4,
    FDCAN_TXEFC = 0xF0 / 4
};

typedef struct {
    volatile uint32_t *registers;
    volatile uint32_t *ram;
    uint32_t lost;
} fdcan;

/* Purpose  value of NBTP for a bit rate: 8 to 25 quanta a bit, sampled at 87.5 % of it or as near as the quanta allow (CiA 301).
 * Units    Hz, bit/s.   Output  0: the clock is no multiple that fits. */
uint32_t fdcan_bit_timing(uint32_t clock_Hz, uint32_t bitrate);

/* Purpose  configure and join the bus: every data frame with an 11-bit identifier is taken, all else refused by the hardware.
 * Output   0; -1: no bit timing, or the block does not follow within FDCAN_PATIENCE reads. */
int fdcan_start(fdcan *can, uint32_t clock_Hz, uint32_t bitrate);
#define FDCAN_PATIENCE 100000u

/* Purpose  queue one frame.   Output  0; -1: no room, or the block is off the bus: what is queued then would leave when it is no
 *          longer true. */
int fdcan_send(fdcan *can, const cr_frame *frame);
int fdcan_receive(fdcan *can, cr_frame *frame);
/* Purpose  1 when the block left the bus (bus-off). What it had not sent is cancelled, and it is told to come back, which takes 128
 *          idle sequences. */
int fdcan_was_off(fdcan *can);
void fdcan_stop(fdcan *can);

#endif
