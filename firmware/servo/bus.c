/* bus: the CANopen manager. Frames in, states of three drives out; torques in, frames out. */
#include "servo/bus_parts.h"

#include <string.h>

enum { NMT_START = 0x01, NMT_RESET_COMMUNICATION = 0x82 };
enum { STATE_BOOT = 0x00, STATE_OPERATIONAL = 0x05, STATE_PRE_OPERATIONAL = 0x7f };

/* CiA 402 status word: the bits that tell the state, and its values under that mask. */
#define STATUS_MASK 0x6fu
#define STATUS_READY 0x21u
#define STATUS_SWITCHED_ON 0x23u
#define STATUS_ENABLED 0x27u
#define STATUS_FAULT 0x08u
enum {
    CONTROL_OFF = 0x00,
    CONTROL_SHUTDOWN = 0x06,
    CONTROL_SWITCH_ON = 0x07,
    CONTROL_ENABLE = 0x0f,
    CONTROL_RESET = 0x80
};
/* From a reset to the next one while a drive is missing; twice as long each time, and at most: one that boots slowly is not reset for ever. */
#define RESET_WAIT_MS 500u
#define RESET_WAIT_MAX_MS (16u * RESET_WAIT_MS)
#define RESET_SETTLE_NS (20u * MS_NS)
#define CONTROL_REPEAT_NS (20u * MS_NS)
/* A drive whose state comes twice in this many periods in a row is two drives. */
#define TWICE_ROW_MAX 3u

/* EMCY, heartbeats and SDO answers of one drive in one period: with an inhibit time of 10 ms on EMCY there is no reason for
 * more. Four fit beside the states before the bus is full. */
#define OTHER_MAX 3u

/* ------------------------------------------------------------------------------------------------------ packing */
/* Two's complement without leaving it to the compiler. */
static int16_t to_i16(uint16_t v) { return (int16_t)(v < 0x8000u ? (int32_t)v : (int32_t)v - 0x10000); }
static int32_t to_i32(uint32_t v) { return v < 0x80000000u ? (int32_t)v : -(int32_t)(0xffffffffu - v) - 1; }

int16_t cr_per_mille(float torque, float rated, float limit) {
    if (!is_finite_f(torque) || !(rated > 0.0f) || !(limit >= 0.0f)) {
        return 0;
    }
    /* Truncated, not rounded, at the limit: 1000 limit / rated per mille need not be whole. */
    float most = min_f(limit / rated * 1000.0f, 32767.0f);
    float value = clamp_f(torque / rated * 1000.0f, -32767.0f, 32767.0f);
    float rounded = (float)(int32_t)(value + (value < 0.0f ? -0.5f : 0.5f));
    return (int16_t)clamp_f(rounded, -(float)(int32_t)most, (float)(int32_t)most);
}

cr_frame *cr_bus_add_frame(cr_tx *tx, uint32_t id, uint8_t size) {
    CR_ASSERT(tx->count < CR_TX_MAX && id <= 0x7ffu && size <= 8u);
    static const cr_frame empty = {0};
    uint32_t at = tx->count < CR_TX_MAX ? tx->count : CR_TX_MAX - 1u;
    cr_frame *frame = &tx->frames[at];
    *frame = empty;
    frame->id = (uint16_t)id;
    frame->size = size;
    tx->count = at + 1u;
    return frame;
}

/* ---------------------------------------------------------------------------------------------------- receiving */

void cr_bus_reset(cr_bus *bus, const cr_axis_config axis[CR_AXES]) {
    memset(bus, 0, sizeof *bus);
    bus->trouble_axis = CR_AXES;
    bus->reset_wait_ms = RESET_WAIT_MS / 2u; /* before the first */
    for (uint32_t a = 0; a < CR_AXES; a++) {
        bus->rated[a] = (uint32_t)(axis[a].rated * 1000.0f + 0.5f);
        bus->limit[a] = (uint32_t)(int32_t)cr_per_mille(axis[a].torque_max, axis[a].rated, axis[a].torque_max);
    }
}

void cr_bus_refuse(cr_bus *bus) { bus->refused |= bus->phase == CR_PHASE_LISTEN ? 1u : 0u; }

static int is_axis(uint32_t id, uint32_t base) { return id >= base + NODE_FIRST && id < base + NODE_FIRST + CR_AXES; }

/* What only the host sends: heard from outside, it means a second host. */
static int is_ours(uint32_t id) {
    return id == ID_NMT || id == ID_SYNC || id == ID_TORQUE || id == ID_HEARTBEAT + NODE_HOST ||
           is_axis(id, ID_CONTROL) || is_axis(id, ID_SDO_REQUEST);
}

int cr_bus_is_of_interest(uint16_t id) {
    return is_ours(id) || is_axis(id, ID_STATE) || id == ID_WRIST || is_axis(id, ID_SDO_ANSWER) ||
           is_axis(id, ID_EMCY) || is_axis(id, ID_EMCY_DEFAULT) || is_axis(id, ID_HEARTBEAT);
}

void cr_bus_raise(cr_bus *bus, uint32_t fault, uint32_t axis) {
    CR_ASSERT(fault != 0u && axis < CR_AXES);
    bus->faults |= fault;
    bus->trouble_axis = axis;
}

static void receive_state(cr_drive *drive, const cr_frame *frame, cr_servo_counters *counters) {
    if (frame->size != 8u) {
        counters->malformed++;
        return;
    }
    drive->counts = to_i32(get_u32(frame->data));
    drive->actual = to_i16(get_u16(frame->data + 4));
    drive->status = get_u16(frame->data + 6);
    drive->has_state = 1u;
    if ((frame->flags & CR_FRAME_EARLY) != 0u) {
        counters->late++;
    } else {
        counters->twice += drive->state_count > 0u ? 1u : 0u;
        drive->state_count++;
    }
}

static void receive_wrist(cr_wrist *wrist, const cr_frame *frame, cr_servo_counters *counters) {
    if (frame->size != 6u) {
        counters->malformed++;
        return;
    }
    for (size_t i = 0; i < 3u; i++) {
        wrist->counts[i] = to_i16(get_u16(frame->data + 2u * i));
    }
    counters->twice += wrist->fresh;
    wrist->fresh = 1u;
}

static void receive_heartbeat(cr_bus *bus, uint32_t axis, const cr_frame *frame, uint64_t now_ns,
                              cr_servo_counters *counters) {
    cr_drive *drive = &bus->drive[axis];
    if (frame->size != 1u) {
        counters->malformed++;
        return;
    }
    uint8_t state = frame->data[0] & 0x7fu;
    drive->heard_ns = now_ns;
    drive->nmt_state = state;
    if (bus->phase == CR_PHASE_RESET) {
        /* Pre-operational right after the reset, and operational at any time, may be from before it. */
        int settled = !bus->reset_due && now_ns - bus->reset_ns >= RESET_SETTLE_NS;
        drive->seen |= state == STATE_BOOT || (state == STATE_PRE_OPERATIONAL && settled) ? 1u : 0u;
        return;
    }
    int booted = bus->phase == CR_PHASE_SET_UP && state == STATE_BOOT;
    if (booted || (bus->phase == CR_PHASE_RUN && state != STATE_OPERATIONAL)) {
        cr_bus_raise(bus, CR_FAULT_RESET, axis);
    }
}

static void receive_emcy(cr_bus *bus, uint32_t axis, const cr_frame *frame, cr_servo_counters *counters) {
    if (frame->size != 8u) {
        counters->malformed++;
        return;
    }
    uint16_t code = get_u16(frame->data);
    counters->emcy++;
    if (code != 0u && bus->phase >= CR_PHASE_ENABLE) {
        bus->emcy_code = code;
        cr_bus_raise(bus, CR_FAULT_EMCY, axis);
    }
}

void cr_bus_receive(const cr_bus_config *config, cr_bus *bus, const cr_frame *frame, uint64_t now_ns,
                    cr_servo_counters *counters) {
    uint32_t id = frame->id, axis = (id & 0x7fu) - NODE_FIRST;
    if (is_ours(id)) {
        counters->alien++;
        bus->faults |= CR_FAULT_ALIEN;
        cr_bus_refuse(bus);
        return;
    }
    if (is_axis(id, ID_STATE)) {
        receive_state(&bus->drive[axis], frame, counters);
        return;
    }
    if (id == ID_WRIST) {
        receive_wrist(&bus->wrist, frame, counters);
        return;
    }
    if (axis < CR_AXES && ++bus->drive[axis].other_count > OTHER_MAX) {
        counters->babbled++;
        cr_bus_raise(bus, CR_FAULT_BABBLE, axis);
    }
    if (is_axis(id, ID_HEARTBEAT)) {
        receive_heartbeat(bus, axis, frame, now_ns, counters);
    } else if (is_axis(id, ID_EMCY) || is_axis(id, ID_EMCY_DEFAULT)) {
        receive_emcy(bus, axis, frame, counters);
    } else if (is_axis(id, ID_SDO_ANSWER)) {
        cr_sdo_receive(config, bus, axis, frame, counters);
    }
}

/* ----------------------------------------------------------------------------------------------------- checking */

static uint32_t status_of(const cr_drive *drive) { return drive->status & STATUS_MASK; }

/* Next control word on the way to OPERATION ENABLED; a fault of before the start is reset on the way. */
static uint16_t control_for(const cr_drive *drive) {
    if ((drive->status & 0x4fu) == STATUS_FAULT || (drive->status & 0x4fu) == 0x0fu) {
        return CONTROL_RESET;
    }
    switch (status_of(drive)) {
    case STATUS_READY:
        return CONTROL_SWITCH_ON;
    case STATUS_SWITCHED_ON:
    case STATUS_ENABLED:
        return CONTROL_ENABLE;
    default:
        return (drive->status & 0x4fu) == 0x40u ? CONTROL_SHUTDOWN : CONTROL_OFF;
    }
}

static void want_control(cr_drive *drive, uint16_t word, int again) {
    drive->send_control |= word != drive->control_word || again ? 1u : 0u;
    drive->control_word = word;
}

static void check_enable(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns) {
    uint32_t enabled = 0u, last = 0u;
    int again = now_ns - bus->control_ns >= CONTROL_REPEAT_NS;
    bus->control_ns = again ? now_ns : bus->control_ns;
    for (uint32_t a = 0; a < CR_AXES; a++) {
        cr_drive *drive = &bus->drive[a];
        if (drive->state_count > 0u && status_of(drive) == STATUS_ENABLED) {
            enabled++;
        } else {
            last = a;
        }
        if (drive->has_state) {
            /* The reset bit acts on its edge: a repeat has to drop it first. */
            int toggle = again && drive->control_word == CONTROL_RESET;
            want_control(drive, toggle ? (uint16_t)CONTROL_OFF : control_for(drive), again);
        }
    }
    if (enabled == CR_AXES) {
        bus->phase = CR_PHASE_RUN;
    } else if (now_ns - bus->enable_ns > config->enable_timeout_ms * MS_NS) {
        cr_bus_raise(bus, CR_FAULT_DRIVE_STATE, last);
    }
}

static void check_run(const cr_bus_config *config, cr_bus *bus, uint32_t axis, cr_servo_counters *counters) {
    cr_drive *drive = &bus->drive[axis];
    if (drive->state_count == 0u) {
        counters->missing[axis]++;
        drive->missing_row++;
        if (drive->missing_row > config->missing_max) {
            cr_bus_raise(bus, CR_FAULT_SILENT, axis);
        }
    } else {
        drive->missing_row = 0u;
    }
    drive->twice_row = drive->state_count > 1u ? drive->twice_row + 1u : 0u;
    if (drive->twice_row >= TWICE_ROW_MAX) {
        cr_bus_raise(bus, CR_FAULT_ALIEN, axis);
    }
    if ((drive->status & STATUS_FAULT) != 0u) {
        cr_bus_raise(bus, CR_FAULT_DRIVE, axis);
    } else if (status_of(drive) != STATUS_ENABLED) {
        cr_bus_raise(bus, CR_FAULT_DRIVE_STATE, axis);
    }
}

/* Angles may be bridged for as many of its frames as a state may be for periods. */
static void check_wrist(const cr_bus_config *config, cr_bus *bus, cr_servo_counters *counters) {
    cr_wrist *wrist = &bus->wrist;
    wrist->age = wrist->fresh ? 0u : wrist->age + 1u;
    counters->wrist_missing += wrist->age > 0u && wrist->age % WRIST_PERIODS == 0u ? 1u : 0u;
    if (wrist->age >= WRIST_PERIODS * (config->missing_max + 1u)) {
        cr_bus_raise(bus, CR_FAULT_SILENT, WRIST_AXIS);
    }
}

static void check_heartbeats(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns) {
    for (uint32_t a = 0; a < CR_AXES; a++) {
        if (now_ns - bus->drive[a].heard_ns > config->drive_timeout_ms * MS_NS) {
            cr_bus_raise(bus, CR_FAULT_HEARTBEAT, a);
        }
    }
}

static void begin_enable(cr_bus *bus, uint64_t now_ns) {
    CR_ASSERT(bus->phase == CR_PHASE_SET_UP && bus->sdo_waiting == 0u);
    bus->phase = CR_PHASE_ENABLE;
    bus->start_due = 1u;
    bus->enable_ns = bus->control_ns = now_ns;
    for (uint32_t a = 0; a < CR_AXES; a++) {
        /* What came before the mapping was set means nothing; heartbeats are due from now on. */
        bus->drive[a].has_state = 0u;
        bus->drive[a].heard_ns = now_ns;
    }
    bus->wrist.age = 0u;
}

static void check_set_up(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns) {
    if (bus->sdo_axis == CR_AXES) {
        begin_enable(bus, now_ns);
        return;
    }
    cr_sdo_check(config, bus, now_ns);
}

void cr_bus_check(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns, cr_servo_counters *counters) {
    if (!bus->has_start) {
        bus->has_start = 1u;
        bus->start_ns = bus->beat_ns = now_ns;
    }
    CR_ASSERT(bus->phase <= CR_PHASE_RUN && bus->sdo_axis <= CR_AXES && !(bus->reset_due && bus->start_due));
    switch (bus->phase) {
    case CR_PHASE_LISTEN:
        if (!bus->refused && now_ns - bus->start_ns >= config->listen_ms * MS_NS) {
            bus->phase = CR_PHASE_RESET;
            bus->reset_due = 1u;
            bus->beat_ns = now_ns - config->heartbeat_ms * MS_NS; /* the first one at once */
        }
        break;
    case CR_PHASE_RESET:
        if (bus->drive[0].seen && bus->drive[1].seen && bus->drive[2].seen) {
            bus->phase = CR_PHASE_SET_UP;
        } else if (!bus->reset_due && now_ns - bus->reset_ns >= bus->reset_wait_ms * MS_NS) {
            bus->reset_due = 1u;
        }
        break;
    case CR_PHASE_SET_UP:
        check_set_up(config, bus, now_ns);
        break;
    case CR_PHASE_ENABLE:
        check_heartbeats(config, bus, now_ns);
        check_enable(config, bus, now_ns);
        break;
    default:
        check_heartbeats(config, bus, now_ns);
        for (uint32_t a = 0; a < CR_AXES; a++) {
            check_run(config, bus, a, counters);
        }
        check_wrist(config, bus, counters);
        break;
    }
}

/* ------------------------------------------------------------------------------------------------------ sending */

void cr_bus_sync(cr_bus *bus, cr_tx *tx) {
    for (uint32_t a = 0; a < CR_AXES; a++) {
        bus->drive[a].state_count = bus->drive[a].other_count = 0u;
    }
    bus->wrist.fresh = 0u;
    if (bus->phase != CR_PHASE_LISTEN) {
        cr_bus_add_frame(tx, ID_SYNC, 0u);
    }
}

static void send_nmt(cr_tx *tx, uint8_t command) {
    cr_frame *frame = cr_bus_add_frame(tx, ID_NMT, 2u);
    frame->data[0] = command; /* node 0: all */
}

/* Off is said again and again: a drive may have missed it. */
static void send_controls(cr_bus *bus, int off, uint64_t now_ns, cr_tx *tx) {
    int again = off && now_ns - bus->control_ns >= CONTROL_REPEAT_NS;
    bus->control_ns = again ? now_ns : bus->control_ns;
    for (uint32_t a = 0; a < CR_AXES; a++) {
        cr_drive *drive = &bus->drive[a];
        if (off) {
            want_control(drive, CONTROL_OFF, again);
        }
        if (drive->send_control) {
            cr_frame *frame = cr_bus_add_frame(tx, ID_CONTROL + NODE_FIRST + a, 3u);
            put_u16(frame->data, drive->control_word);
            frame->data[2] = MODE_CYCLIC_TORQUE;
            drive->send_control = 0u;
        }
    }
}

static void send_heartbeat(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns, cr_tx *tx) {
    if (now_ns - bus->beat_ns >= config->heartbeat_ms * MS_NS) {
        cr_bus_add_frame(tx, ID_HEARTBEAT + NODE_HOST, 1u)->data[0] = STATE_OPERATIONAL;
        bus->beat_ns = now_ns;
    }
}

void cr_bus_transmit(const cr_bus_config *config, cr_bus *bus, const int16_t target[CR_AXES], int off, uint64_t now_ns,
                     cr_servo_counters *counters, cr_tx *tx) {
    if (bus->phase == CR_PHASE_LISTEN) {
        return;
    }
    CR_ASSERT(bus->phase == CR_PHASE_RUN || (target[0] == 0 && target[1] == 0 && target[2] == 0));
    cr_frame *torque = cr_bus_add_frame(tx, ID_TORQUE, 6u);
    for (uint32_t a = 0; a < CR_AXES; a++) {
        put_u16(&torque->data[(size_t)2u * a], (uint32_t)(uint16_t)target[a]);
    }
    if (bus->reset_due) {
        send_nmt(tx, NMT_RESET_COMMUNICATION);
        for (uint32_t a = 0; a < CR_AXES; a++) {
            bus->drive[a].seen = 0u; /* all of them boot again */
        }
        bus->reset_due = 0u;
        bus->reset_ns = now_ns;
        bus->reset_wait_ms <<= (uint32_t)(bus->reset_wait_ms < RESET_WAIT_MAX_MS);
    } else if (bus->start_due) {
        send_nmt(tx, NMT_START);
        bus->start_due = 0u;
    }
    send_controls(bus, off, now_ns, tx);
    if (!off) {
        cr_sdo_send(config, bus, now_ns, counters, tx);
    }
    send_heartbeat(config, bus, now_ns, tx);
}
