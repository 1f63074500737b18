/* Proof    a frame with any identifier that means something, of any length and content, in any state of the bus that can come about, at any
 *          time: nothing outside is read or written, and the state is one that can come about again
 * Entry    cr_bus_receive
 * Bounds   none: every state, every frame that cr_servo_rx takes, every clock, every configuration; sdo_answer.c proves what is left out
 * Long     minutes on a busy machine
 * Unwind   9 */
#include "bus_states.h"

#include "servo/bus.c"

/* Proved by itself: sdo_answer.c. */
void cr_sdo_receive(const cr_bus_config *config, cr_bus *bus, uint32_t axis, const cr_frame *frame,
                    cr_servo_counters *counters) {
    (void)config, (void)bus, (void)frame, (void)counters;
    PROVE(axis < CR_AXES);
}
void cr_sdo_check(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns) { (void)config, (void)bus, (void)now_ns; }
void cr_sdo_send(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns, cr_servo_counters *counters, cr_tx *tx) {
    (void)config, (void)bus, (void)now_ns, (void)counters, (void)tx;
}

/* One identifier after the other: the solver need not guess whose drive it is. */
static void prove_id(uint16_t id) {
    cr_bus_config config; /* what is not set may be anything */
    cr_bus bus;
    cr_frame frame;
    cr_servo_counters counters;
    ASSUME(can_be(&bus, 1u) && frame.size <= 8u); /* cr_servo_rx takes no longer one */
    frame.id = id;
    cr_bus_receive(&config, &bus, &frame, nondet_u64(), &counters);
    PROVE(can_be(&bus, 1u));
}

int main(void) {
    static const uint16_t bases[] = {ID_STATE, ID_CONTROL,      ID_SDO_ANSWER, ID_SDO_REQUEST,
                                     ID_EMCY,  ID_EMCY_DEFAULT, ID_HEARTBEAT};
    static const uint16_t others[] = {ID_NMT, ID_SYNC, ID_TORQUE, ID_WRIST, ID_HEARTBEAT + NODE_HOST};
    const uint16_t any = nondet_u16();
    int listed = 0;
    for (uint32_t i = 0; i < sizeof bases / sizeof *bases; i++) {
        for (uint16_t a = 0; a < CR_AXES; a++) {
            const uint16_t id = (uint16_t)(bases[i] + NODE_FIRST + a);
            listed |= id == any;
            prove_id(id);
        }
    }
    for (uint32_t i = 0; i < sizeof others / sizeof *others; i++) {
        listed |= others[i] == any;
        prove_id(others[i]);
    }
    PROVE(listed == cr_bus_is_of_interest(any)); /* all there are */
    return 0;
}
