#include "fdcan.h"

#define CCCR_INIT (1u << 0)
#define CCCR_CCE (1u << 1)
#define PSR_BUS_OFF (1u << 7)
#define IR_RX0_LOST (1u << 3)
/* Frames that no filter names go to FIFO 0 when their identifier is short; long ones and remote frames are refused. */
#define GFC_SHORT_DATA_ONLY (0u << 4 | 2u << 2 | 1u << 1 | 1u << 0)
#define TXFQS_FULL (1u << 21)
#define TX_AT (FDCAN_RX_FRAMES * FDCAN_FRAME_WORDS * 4u) /* bytes from the start of the RAM */
#define WORD0_XTD (1u << 30)
#define WORD0_RTR (1u << 29)
#define SHORT_ID_SHIFT 18u
#define LENGTH_SHIFT 16u

uint32_t fdcan_bit_timing(uint32_t clock_Hz, uint32_t bitrate) {
    uint32_t best = 0u, best_off = UINT32_MAX;
    for (uint32_t quanta = 25u; quanta >= 8u && bitrate > 0u; quanta--) {
        const uint32_t prescaler = clock_Hz / (bitrate * quanta);
        if (prescaler == 0u || prescaler > 512u || prescaler * bitrate * quanta != clock_Hz) {
            continue;
        }
        const uint32_t after = (quanta + 4u) / 8u; /* of the sample point: an eighth, rounded */
        const uint32_t off = 8u * after > quanta ? 8u * after - quanta : quanta - 8u * after;
        if (off < best_off) {
            best_off = off;
            best = (after - 1u) << 25 | (prescaler - 1u) << 16 | (quanta - 2u - after) << 8 | (after - 1u);
        }
    }
    return best;
}

static int wait_for(const fdcan *can, uint32_t bit, uint32_t wanted) {
    for (uint32_t i = 0; i < FDCAN_PATIENCE; i++) {
        if ((can->registers[FDCAN_CCCR] & bit) == wanted) {
            return 0;
        }
    }
    return -1;
}

int fdcan_start(fdcan *can, uint32_t clock_Hz, uint32_t bitrate) {
    volatile uint32_t *r = can->registers;
    const uint32_t timing = fdcan_bit_timing(clock_Hz, bitrate);
    can->lost = 0u;
    r[FDCAN_CCCR] = CCCR_INIT;
    if (timing == 0u || wait_for(can, CCCR_INIT, CCCR_INIT) != 0) {
        return -1;
    }
    r[FDCAN_CCCR] = CCCR_INIT | CCCR_CCE; /* everything else zero: classical frames, retransmission on */
    for (uint32_t i = 0; i < FDCAN_RAM_WORDS; i++) {
        can->ram[i] = 0u; /* the RAM has parity, so that reading what was never written is an error */
    }
    r[FDCAN_NBTP] = timing;
    r[FDCAN_GFC] = GFC_SHORT_DATA_ONLY;
    r[FDCAN_SIDFC] = 0u;
    r[FDCAN_XIDFC] = 0u;
    r[FDCAN_RXF0C] = FDCAN_RX_FRAMES << 16;        /* at the start of the RAM; what finds it full is lost, and told */
    r[FDCAN_RXESC] = 0u;                           /* 8 bytes of data */
    r[FDCAN_TXBC] = FDCAN_TX_FRAMES << 24 | TX_AT; /* a FIFO: frames leave in the order they came */
    r[FDCAN_TXESC] = 0u;
    r[FDCAN_TXEFC] = 0u;
    r[FDCAN_IE] = 0u;
    r[FDCAN_IR] = 0xffffffffu;
    r[FDCAN_CCCR] = 0u;
    return wait_for(can, CCCR_INIT, 0u);
}

int fdcan_send(fdcan *can, const cr_frame *frame) {
    const uint32_t status = can->registers[FDCAN_TXFQS];
    const int off = (can->registers[FDCAN_PSR] & PSR_BUS_OFF) != 0u; /* set until the way back is done */
    if (off || (status & TXFQS_FULL) != 0u || frame->size > 8u) {
        return -1;
    }
    const uint32_t slot = status >> 16 & 0x1fu;
    volatile uint32_t *at = can->ram + TX_AT / 4u + (size_t)slot * FDCAN_FRAME_WORDS;
    at[0] = (uint32_t)(frame->id & 0x7ffu) << SHORT_ID_SHIFT;
    at[1] = (uint32_t)frame->size << LENGTH_SHIFT;
    for (uint32_t w = 0; w < 2u; w++) {
        const uint8_t *d = frame->data + (size_t)4u * w;
        at[2u + w] = (uint32_t)d[0] | (uint32_t)d[1] << 8 | (uint32_t)d[2] << 16 | (uint32_t)d[3] << 24;
    }
    can->registers[FDCAN_TXBAR] = 1u << slot;
    return 0;
}

/* Takes the oldest frame; 1 when it is one for the loop. */
static int take(fdcan *can, uint32_t slot, cr_frame *frame) {
    const volatile uint32_t *at = can->ram + (size_t)slot * FDCAN_FRAME_WORDS;
    const uint32_t word0 = at[0], length = at[1] >> LENGTH_SHIFT & 0xfu, data[2] = {at[2], at[3]};
    can->registers[FDCAN_RXF0A] = slot;
    frame->id = (uint16_t)(word0 >> SHORT_ID_SHIFT & 0x7ffu);
    frame->size = (uint8_t)(length < 8u ? length : 8u); /* a classical frame may say 9 to 15 and mean 8 */
    frame->flags = 0u;
    for (uint32_t i = 0; i < 8u; i++) {
        frame->data[i] = (uint8_t)(data[i / 4u] >> 8u * (i % 4u));
    }
    return (word0 & (WORD0_XTD | WORD0_RTR)) == 0u;
}

int fdcan_receive(fdcan *can, cr_frame *frame) {
    volatile uint32_t *r = can->registers;
    if ((r[FDCAN_IR] & IR_RX0_LOST) != 0u) {
        r[FDCAN_IR] = IR_RX0_LOST;
        can->lost++;
    }
    for (uint32_t i = 0; i < FDCAN_RX_FRAMES; i++) {
        const uint32_t status = r[FDCAN_RXF0S];
        if ((status & 0x7fu) == 0u) {
            return 0;
        }
        if (take(can, status >> 8 & 0x3fu, frame)) {
            return 1;
        }
    }
    return 0;
}

int fdcan_was_off(fdcan *can) {
    if ((can->registers[FDCAN_PSR] & PSR_BUS_OFF) == 0u || (can->registers[FDCAN_CCCR] & CCCR_INIT) == 0u) {
        return 0;
    }
    can->registers[FDCAN_TXBCR] = 0xffffffffu; /* torques and SYNC of before: none of them may leave now */
    can->registers[FDCAN_CCCR] = 0u;           /* the block stops itself at bus-off; this starts the way back */
    return 1;
}

void fdcan_stop(fdcan *can) { can->registers[FDCAN_CCCR] = CCCR_INIT; }
