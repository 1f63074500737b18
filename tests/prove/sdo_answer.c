/* Proof    what a drive answers, whatever it is: no step beyond the last is asked for, no value is read that is not there
 * Entry    cr_sdo_receive, and cr_sdo_check and cr_sdo_send, which go on from it
 * Bounds   none: every state that can come about, every answer, every clock, every configuration
 * Unwind   9 */
#include "bus_states.h"

#include "servo/sdo.c"

void cr_bus_raise(cr_bus *bus, uint32_t fault, uint32_t axis) {
    bus->faults |= fault;
    bus->trouble_axis = axis;
}

/* A frame of its own for each request. */
static cr_frame sent;
cr_frame *cr_bus_add_frame(cr_tx *tx, uint32_t id, uint8_t size) {
    tx->count++;
    sent.id = (uint16_t)id;
    sent.size = size;
    return &sent;
}

int main(void) {
    cr_bus_config config; /* what is not set may be anything */
    cr_bus bus;
    cr_frame frame;
    cr_servo_counters counters;
    cr_tx tx;
    const uint32_t axis = nondet_u32();
    const uint64_t now_ns = nondet_u64();
    ASSUME(axis < CR_AXES && can_be(&bus, step_count(bus.sdo_axis)));
    ASSUME(bus.sdo_waiting == 0u || bus.sdo_axis < CR_AXES);
    ASSUME(config.sdo_timeout_ms <= 10000u); /* cr_servo_config_error */
    tx.count = 0u;
    switch (nondet_u8() & 3u) {
    case 0:
        cr_sdo_receive(&config, &bus, axis, &frame, &counters);
        break;
    case 1:
        cr_sdo_check(&config, &bus, now_ns);
        break;
    default:
        cr_sdo_send(&config, &bus, now_ns, &counters, &tx);
        break;
    }
    PROVE(can_be(&bus, step_count(bus.sdo_axis)) && tx.count <= 1u);
    PROVE(bus.sdo_waiting == 0u || bus.sdo_axis < CR_AXES);
    return 0;
}
