/* Proof    a frame of any identifier, length and content, from the bus or from a record, is kept where there is room and nowhere else
 * Entry    cr_servo_rx, which cr_servo_rerun feeds with the frames of a record
 * Bounds   every frame, after 0, 11 and 12 others: the first, the last that has room, one too many
 * Unwind   2 */
#include "prove.h"

#include "servo/servo.c"

static void prove_after(uint32_t count) {
    static cr_servo servo; /* only what is set here is looked at */
    cr_frame frame;        /* not set: anything */
    servo.frame_count = count;
    servo.synced = nondet_u8() & 1u;
    servo.rx_babbled = nondet_u32();
    cr_servo_rx(&servo, &frame);
    PROVE(servo.frame_count <= CR_RX_MAX && servo.frame_count >= count);
    PROVE(servo.frame_count == count || servo.frames[count].size <= 8u);
}

int main(void) {
    prove_after(0u);
    prove_after(CR_RX_MAX - 1u);
    prove_after(CR_RX_MAX);
    return 0;
}
