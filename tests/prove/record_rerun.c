/* Proof    a record of any content is fed to the servo: as many frames as it has room for, each no longer than a frame
 * Entry    feed of cr_servo_rerun, cr_servo_rx
 * Bounds   none: every record, every servo that has room; the tick that follows is proved in its parts
 * Unwind   13 */
#include "prove.h"

#include "servo/servo_stages.h"

#define cr_servo_tick real_tick
#include "servo/servo.c"
#undef cr_servo_tick

int main(void) {
    static cr_servo servo; /* frames, counts and flags are set below */
    cr_record record;      /* not set: anything */
    servo.frame_count = nondet_u32();
    servo.synced = nondet_u8() & 1u;
    ASSUME(servo.frame_count <= CR_RX_MAX);
    const uint32_t count = record.frame_count < CR_RX_MAX ? record.frame_count : CR_RX_MAX;
    for (uint32_t i = 0; i < count; i++) { /* as feed does, before the tick */
        cr_servo_rx(&servo, &record.frames[i]);
    }
    PROVE(servo.frame_count <= CR_RX_MAX);
    return 0;
}
