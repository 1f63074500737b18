/* sdo: what the drives are asked and told before they may move anything, one request after the other. */
#include "servo/bus_parts.h"

/* One request on the whole bus in this time: the schedule counts on it. */
#define SDO_SPACING_NS (5u * MS_NS)
#define SDO_TRIES 3u
#define NO_ANSWER 0xffffffffu

/* Command bytes of CiA 301, 7.2.4.3: expedited only. */
enum { DOWNLOAD = 0x23, DOWNLOADED = 0x60, UPLOAD = 0x40, ABORTED = 0x80 };
#define UPLOADED 0x42u
#define UPLOADED_MASK 0xe2u
#define SIZE_GIVEN 0x01u

/* What is added to the value of a step; from ASK_VENDOR on nothing is written, the drive is only asked. */
enum {
    ADD_NONE,
    ADD_AXIS,
    ADD_HEARTBEAT,
    ADD_CONSUMER,
    ADD_TORQUE_TIMEOUT,
    ADD_LIMIT,
    ASK_VENDOR,
    ASK_PRODUCT,
    ASK_REVISION, /* the major half: the other changes nothing that a host can see (CiA 301) */
    ASK_RATED,
    ASK_LIMIT /* at least as much: a drive that was set to less has a reason */
};

typedef struct {
    uint16_t index;
    uint8_t sub, size, add, word; /* word: axis + 1 whose torque this mapping entry takes */
    uint32_t value;
} sdo_step;

#define INVALID 0x80000000u /* COB-ID entry: off while it is changed */
#define NO_RTR 0x40000000u
#define DUMMY_INT16 0x00030010u
#define TORQUE_INT16 0x60710010u

/* First who it is, then what it is told; everything told is read back. A mapping changes in the order of CiA 301: PDO off, count 0, entries, count, PDO on. */
static const sdo_step steps[] = {
    {0x1018, 1, 4, ASK_VENDOR, 0, 0},
    {0x1018, 2, 4, ASK_PRODUCT, 0, 0},
    {0x1018, 3, 4, ASK_REVISION, 0, 0},
    {0x6076, 0, 4, ASK_RATED, 0, 0},
    {0x6072, 0, 2, ASK_LIMIT, 0, 0},
    {0x6072, 0, 2, ADD_LIMIT, 0, 0},
    {0x1017, 0, 2, ADD_HEARTBEAT, 0, 0},
    {0x1016, 1, 4, ADD_CONSUMER, 0, (uint32_t)NODE_HOST << 16},
    {0x1014, 0, 4, ADD_AXIS, 0, INVALID | (ID_EMCY + NODE_FIRST)},
    {0x1015, 0, 2, ADD_NONE, 0, 100}, /* 10 ms in 100 us */
    {0x1014, 0, 4, ADD_AXIS, 0, ID_EMCY + NODE_FIRST},
    {0x1400, 1, 4, ADD_AXIS, 0, INVALID | (ID_CONTROL + NODE_FIRST)},
    {0x1400, 2, 1, ADD_NONE, 0, 255},
    {0x1600, 0, 1, ADD_NONE, 0, 0},
    {0x1600, 1, 4, ADD_NONE, 0, 0x60400010},
    {0x1600, 2, 4, ADD_NONE, 0, 0x60600008},
    {0x1600, 0, 1, ADD_NONE, 0, 2},
    {0x1400, 1, 4, ADD_AXIS, 0, ID_CONTROL + NODE_FIRST},
    {0x1401, 1, 4, ADD_NONE, 0, INVALID | ID_TORQUE},
    {0x1401, 2, 1, ADD_NONE, 0, 1},
    {0x1401, 5, 2, ADD_TORQUE_TIMEOUT, 0, 0},
    {0x1601, 0, 1, ADD_NONE, 0, 0},
    {0x1601, 1, 4, ADD_NONE, 1, 0},
    {0x1601, 2, 4, ADD_NONE, 2, 0},
    {0x1601, 3, 4, ADD_NONE, 3, 0},
    {0x1601, 0, 1, ADD_NONE, 0, 3},
    {0x1401, 1, 4, ADD_NONE, 0, ID_TORQUE},
    {0x1800, 1, 4, ADD_AXIS, 0, INVALID | NO_RTR | (ID_STATE + NODE_FIRST)},
    {0x1800, 2, 1, ADD_NONE, 0, 1},
    {0x1a00, 0, 1, ADD_NONE, 0, 0},
    {0x1a00, 1, 4, ADD_NONE, 0, 0x60640020},
    {0x1a00, 2, 4, ADD_NONE, 0, 0x60770010},
    {0x1a00, 3, 4, ADD_NONE, 0, 0x60410010},
    {0x1a00, 0, 1, ADD_NONE, 0, 3},
    {0x1800, 1, 4, ADD_AXIS, 0, NO_RTR | (ID_STATE + NODE_FIRST)},
    {0x6060, 0, 1, ADD_NONE, 0, MODE_CYCLIC_TORQUE},
    /* The wrist, of the drive that reads it. */
    {0x1801, 1, 4, ADD_NONE, 0, INVALID | NO_RTR | ID_WRIST},
    {0x1801, 2, 1, ADD_NONE, 0, WRIST_PERIODS},
    {0x1a01, 0, 1, ADD_NONE, 0, 0},
    {0x1a01, 1, 4, ADD_NONE, 0, 0x21000110},
    {0x1a01, 2, 4, ADD_NONE, 0, 0x21000210},
    {0x1a01, 3, 4, ADD_NONE, 0, 0x21000310},
    {0x1a01, 0, 1, ADD_NONE, 0, 3},
    {0x1801, 1, 4, ADD_NONE, 0, NO_RTR | ID_WRIST},
};
#define STEP_COUNT ((uint32_t)(sizeof steps / sizeof *steps))
#define WRIST_STEPS 8u

static uint32_t step_count(uint32_t axis) { return axis == WRIST_AXIS ? STEP_COUNT : STEP_COUNT - WRIST_STEPS; }

static uint32_t step_value(const cr_bus_config *config, const cr_bus *bus, const sdo_step *step) {
    const uint32_t axis = bus->sdo_axis;
    if (step->word != 0u) {
        return step->word == axis + 1u ? TORQUE_INT16 : DUMMY_INT16;
    }
    switch (step->add) {
    case ADD_AXIS:
        return step->value + axis;
    case ADD_HEARTBEAT:
        return config->heartbeat_ms;
    case ADD_CONSUMER:
        return step->value | config->host_timeout_ms;
    case ADD_TORQUE_TIMEOUT:
        return config->torque_timeout_ms;
    case ASK_VENDOR:
        return config->vendor_id;
    case ASK_PRODUCT:
        return config->product_code;
    case ASK_REVISION:
        return config->revision;
    case ASK_RATED:
        return bus->rated[axis];
    case ADD_LIMIT:
    case ASK_LIMIT:
        return bus->limit[axis];
    default:
        return step->value;
    }
}

/* --------------------------------------------------------------------------------------------------- conversation */

static int is_asked(const cr_bus *bus, const sdo_step *step) {
    return bus->sdo_reading != 0u || step->add >= ASK_VENDOR;
}

static void note_object(cr_bus *bus, const sdo_step *step) { bus->sdo_object = (uint32_t)step->index << 8 | step->sub; }

static void next_step(cr_bus *bus) {
    CR_ASSERT(bus->sdo_axis < CR_AXES && bus->sdo_step < step_count(bus->sdo_axis) && bus->sdo_waiting == 0u);
    bus->sdo_reading = 0u;
    bus->sdo_step++;
    if (bus->sdo_step == step_count(bus->sdo_axis)) {
        bus->sdo_step = 0u;
        bus->sdo_axis++;
    }
}

static int agrees(const sdo_step *step, uint32_t found, uint32_t wanted) {
    if (step->add == ASK_LIMIT) {
        return found >= wanted;
    }
    return step->add == ASK_REVISION ? found >> 16 == wanted >> 16 : found == wanted;
}

/* Bytes of the answer's value; those of the step where it does not say. */
static uint32_t answer_size(const sdo_step *step, uint8_t command) {
    return (command & SIZE_GIVEN) != 0u ? 4u - (command >> 2 & 3u) : step->size;
}

static void compare(const cr_bus_config *config, cr_bus *bus, const sdo_step *step, const cr_frame *frame) {
    const uint32_t size = answer_size(step, frame->data[0]), wanted = step_value(config, bus, step);
    uint32_t found = get_u32(frame->data + 4);
    found &= size < 4u ? (1u << 8u * size) - 1u : 0xffffffffu;
    if (size == step->size && agrees(step, found, wanted)) {
        next_step(bus);
        return;
    }
    note_object(bus, step);
    bus->sdo_found = found;
    bus->sdo_wanted = wanted;
    cr_bus_raise(bus, CR_FAULT_MISMATCH, bus->sdo_axis);
}

void cr_sdo_receive(const cr_bus_config *config, cr_bus *bus, uint32_t axis, const cr_frame *frame,
                    cr_servo_counters *counters) {
    if (bus->phase != CR_PHASE_SET_UP || bus->sdo_waiting == 0u || axis != bus->sdo_axis || frame->size != 8u) {
        counters->malformed++;
        return;
    }
    const sdo_step *step = &steps[bus->sdo_step];
    const uint8_t command = frame->data[0];
    if (get_u16(frame->data + 1) != step->index || frame->data[3] != step->sub) {
        counters->malformed++; /* the answer to a request that was given up */
        return;
    }
    if (command == ABORTED) {
        note_object(bus, step);
        bus->sdo_abort = get_u32(frame->data + 4);
        cr_bus_raise(bus, CR_FAULT_SDO, axis);
        return;
    }
    if (is_asked(bus, step) ? (command & UPLOADED_MASK) != UPLOADED : command != DOWNLOADED) {
        counters->malformed++;
        return;
    }
    bus->sdo_waiting = 0u;
    bus->sdo_tries = 0u;
    if (is_asked(bus, step)) {
        compare(config, bus, step, frame);
    } else {
        bus->sdo_reading = 1u;
    }
}

void cr_sdo_check(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns) {
    if (bus->sdo_waiting != 0u && now_ns - bus->sdo_ns > config->sdo_timeout_ms * MS_NS) {
        bus->sdo_waiting = 0u;
        if (bus->sdo_tries >= SDO_TRIES) {
            note_object(bus, &steps[bus->sdo_step]);
            bus->sdo_abort = NO_ANSWER;
            cr_bus_raise(bus, CR_FAULT_SDO, bus->sdo_axis);
        }
    }
}

void cr_sdo_send(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns, cr_servo_counters *counters, cr_tx *tx) {
    if (bus->phase != CR_PHASE_SET_UP || bus->sdo_waiting != 0u || bus->sdo_axis >= CR_AXES ||
        (bus->sdo_ns != 0u && now_ns - bus->sdo_ns < SDO_SPACING_NS)) {
        return;
    }
    const sdo_step *step = &steps[bus->sdo_step];
    cr_frame *frame = cr_bus_add_frame(tx, ID_SDO_REQUEST + NODE_FIRST + bus->sdo_axis, 8u);
    put_u16(frame->data + 1, step->index);
    frame->data[3] = step->sub;
    if (is_asked(bus, step)) {
        frame->data[0] = UPLOAD;
    } else {
        frame->data[0] = (uint8_t)(DOWNLOAD | (4u - step->size) << 2); /* expedited, size given */
        put_u32(frame->data + 4, step_value(config, bus, step));
    }
    counters->sdo_retries += bus->sdo_tries > 0u ? 1u : 0u;
    bus->sdo_tries++;
    bus->sdo_ns = now_ns;
    bus->sdo_waiting = 1u;
}
