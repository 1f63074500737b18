/* What the two files of the bus manager share: identifiers, byte order, the frame to fill. Internal to bus.c and sdo.c. */
#ifndef CR_BUS_PARTS_H
#define CR_BUS_PARTS_H

#include "servo/servo_stages.h"

#define NODE_HOST 0x01u
#define NODE_FIRST 0x11u
#define MODE_CYCLIC_TORQUE 10u
#define MS_NS 1000000ull

/* The wrist comes with every second SYNC, from the drive of this axis. */
#define WRIST_PERIODS 2u
#define WRIST_AXIS 2u

/* Identifiers of SPEC.md "Frames": function codes of CiA 301; EMCY moved below the cyclic frames. */
enum {
    ID_NMT = 0x000,
    ID_SYNC = 0x080,
    ID_EMCY_DEFAULT = 0x080, /* + node, until 0x1014 is written */
    ID_TORQUE = 0x181,
    ID_STATE = 0x180, /* + node */
    ID_WRIST = 0x194,
    ID_CONTROL = 0x200, /* + node */
    ID_SDO_ANSWER = 0x580,
    ID_SDO_REQUEST = 0x600,
    ID_EMCY = 0x680,
    ID_HEARTBEAT = 0x700
};

static inline uint16_t get_u16(const uint8_t *at) { return (uint16_t)(at[0] | (uint32_t)at[1] << 8); }
static inline uint32_t get_u32(const uint8_t *at) { return get_u16(at) | (uint32_t)get_u16(at + 2) << 16; }
static inline void put_u16(uint8_t *at, uint32_t value) {
    at[0] = (uint8_t)(value & 0xffu);
    at[1] = (uint8_t)(value >> 8 & 0xffu);
}
static inline void put_u32(uint8_t *at, uint32_t value) {
    put_u16(at, value & 0xffffu);
    put_u16(at + 2, value >> 16);
}

/* Purpose  a frame without data at the end of tx; the last one is replaced when tx is full.   Output  the frame, to be filled. */
cr_frame *cr_bus_add_frame(cr_tx *tx, uint32_t id, uint8_t size);

/* Purpose  a fault that one drive is the reason of. */
void cr_bus_raise(cr_bus *bus, uint32_t fault, uint32_t axis);

/* ------------------------------------------------------------------------------------------------- set-up by SDO */

/* Purpose  the next request, when one is due.   Output  at most one frame more in tx. */
void cr_sdo_send(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns, cr_servo_counters *counters, cr_tx *tx);

/* Purpose  what a drive answered.
 * Errors   CR_FAULT_SDO: it refused; CR_FAULT_MISMATCH: it is another drive, or did not keep what was written. Details in bus. */
void cr_sdo_receive(const cr_bus_config *config, cr_bus *bus, uint32_t axis, const cr_frame *frame,
                    cr_servo_counters *counters);

/* Purpose  a request without an answer is given up; after SDO_TRIES of them CR_FAULT_SDO. */
void cr_sdo_check(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns);

#endif
