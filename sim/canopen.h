/* A CANopen node as CiA 301 has it: NMT, SDO server, PDOs, SYNC, heartbeat both ways, EMCY. Internal to the simulator.
 * Written for the simulated drives alone: it shares no code with the firmware's bus manager. */
#ifndef CR_SIM_CANOPEN_H
#define CR_SIM_CANOPEN_H

#include "sim.h"

/* Entries of the object dictionary; dictionary.h must have as many. */
#define CR_OD_ENTRIES 98
#define CR_OUTBOX_MAX 64
#define CR_EMCY_MAX 8
#define CR_PDOS 2

enum { CR_OD_READ = 1, CR_OD_WRITE = 2, CR_OD_RPDO = 4, CR_OD_TPDO = 8, CR_OD_SIGNED = 16 };

typedef struct {
    uint16_t index;
    uint8_t sub, bits, flags;
    uint32_t value[CR_SIM_AXES];
    int64_t low, high;
} cr_od_entry;

enum { CR_NMT_INITIALISING = 0, CR_NMT_STOPPED = 4, CR_NMT_OPERATIONAL = 5, CR_NMT_PRE_OPERATIONAL = 127 };

/* Error codes of CiA 301 and CiA 402 that the drives send themselves. */
enum {
    CR_EMCY_NONE = 0x0000,
    CR_EMCY_HEARTBEAT = 0x8130,
    CR_EMCY_BUS_OFF = 0x8140,
    CR_EMCY_PDO_LENGTH = 0x8210,
    CR_EMCY_RPDO_TIMEOUT = 0x8250
};

typedef struct {
    uint8_t pending, deadline_missed;
    cr_sim_frame frame; /* waits for the next SYNC */
    uint64_t heard_us;  /* last time it came; 0 never */
} cr_rpdo;

typedef struct {
    uint8_t sync_count, sent;
    cr_sim_frame last;
    uint64_t sent_us;
} cr_tpdo;

typedef struct {
    uint8_t axis, node, nmt;
    uint8_t host_watched; /* a heartbeat of the host came since power-on, and none was missed after it */
    uint32_t value[CR_OD_ENTRIES];
    cr_rpdo rpdo[CR_PDOS];
    cr_tpdo tpdo[CR_PDOS];
    uint64_t host_seen_us, heartbeat_due_us, emcy_free_us;
    uint8_t emcy_count, out_count;
    cr_sim_frame emcy[CR_EMCY_MAX];
    cr_sim_frame out[CR_OUTBOX_MAX];
    uint32_t out_dropped;
    uint16_t error; /* set by the node when the application has to react: CR_EMCY_HEARTBEAT, CR_EMCY_RPDO_TIMEOUT */
} cr_node;

/* Purpose  power-on: default values, boot-up frame, pre-operational. */
void cr_node_init(cr_node *node, uint8_t axis, uint64_t now_us);

/* Purpose  value of an object that the dictionary has, as it is stored: two's complement in the low bits. */
uint32_t cr_node_get(const cr_node *node, uint16_t index, uint8_t sub);
int32_t cr_node_get_signed(const cr_node *node, uint16_t index, uint8_t sub);
void cr_node_set(cr_node *node, uint16_t index, uint8_t sub, uint32_t value);

/* Purpose  one frame from the bus, SYNC excepted.   Output  1 when the frame was for this node. */
int cr_node_receive(cr_node *node, const cr_sim_frame *frame, uint64_t now_us);

/* Output  1 when this is the heartbeat that 0x1016 tells the node to watch, of whichever node. */
int cr_node_watches(const cr_node *node, uint32_t id);

/* Purpose  SYNC: send the synchronous TPDOs with the values that stand now, then let the RPDOs that waited act. */
void cr_node_sync(cr_node *node, uint64_t now_us);

/* Purpose  let time pass: heartbeat, its consumer, RPDO deadlines, event-driven TPDOs, EMCY inhibit time. */
void cr_node_poll(cr_node *node, uint64_t now_us);

/* Purpose  enter an error in 0x1003 and send EMCY.   Output  error register as given. */
void cr_node_emcy(cr_node *node, uint16_t code, uint8_t error_register);

/* Bits of a classical frame with an 11-bit identifier and the most stuff bits it can have. */
uint32_t cr_frame_bits(uint32_t len);

#endif
