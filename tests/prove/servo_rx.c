/* Proof    a frame of any content is kept where there is room and counted where there is none: nothing outside is written, and only frames
 *          that mean something and are no longer than 8 bytes are kept
 * Entry    cr_servo_rx
 * Bounds   none for frames: every frame, at any count of those kept; the answer of the world, which it does not touch, has one area
 * Unwind   9 */
#include "prove.h"

#define CR_AREAS_MAX 1
#include "servo/bus.c"

#include "servo/servo.c"

int main(void) {
    cr_servo *s = ANY(cr_servo);
    cr_frame frame; /* not set: anything */
    const uint32_t before = s->frame_count, babbled = s->rx_babbled;
    ASSUME(before <= CR_RX_MAX);
    cr_servo_rx(s, &frame);
    PROVE(s->frame_count <= CR_RX_MAX && s->frame_count - before <= 1u);
    PROVE(s->rx_babbled == babbled || before == CR_RX_MAX);
    if (s->frame_count > before) {
        const cr_frame *kept = &s->frames[before];
        PROVE(kept->size <= 8u && kept->id == frame.id && cr_bus_is_of_interest(kept->id));
        PROVE(kept->flags == (s->synced ? 0u : CR_FRAME_EARLY));
    }
    return 0;
}
