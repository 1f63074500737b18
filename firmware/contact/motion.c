/* motion: how far any point of the tool can have come since it was seen. DESIGN.md "Detect". */
#include "contact/stages.h"

/* Odometers are rebased where their sum, m and rad, reaches this: beyond it their last bit would exceed the slack. */
#define ODOMETER_MAX_M 8.0f

/* All spheres wake when the tree is seen next: in free space that costs nothing. */
static void forget(cr_motion *m) {
    m->slide_m = m->slide_lost_m = 0.0f;
    m->turn_rad = m->turn_lost_rad = 0.0f;
    m->root_wake_m = CR_WAKE_NOW;
    m->stale = 1u;
}

/* Adds to an odometer, and what its last bits could not take the next time: many small steps are not nothing. Source  Kahan 1965. */
static void add_up(float *sum, float *lost, float step) {
    const float more = step + *lost;
    const float next = max_f(*sum, *sum + more); /* it never turns back: what was awake at it would sleep */
    *lost = more - (next - *sum);
    *sum = next;
}

void cr_motion_advance(cr_motion *m, const cr_pose *pose) {
    if (m->valid) {
        cr_quat a = m->last.rot, b = pose->rot;
        float dw = b.w - a.w, dx = b.x - a.x, dy = b.y - a.y, dz = b.z - a.z;
        /* |2 sin(angle / 2)| <= 2 |dq|, and more where -q comes after q: then more wakes. Both odometers are rounded up. */
        const float turn_rad = 2.0f * sqrtf(dw * dw + dx * dx + dy * dy + dz * dz) * 1.000001f;
        add_up(&m->turn_rad, &m->turn_lost_rad, turn_rad);
        add_up(&m->slide_m, &m->slide_lost_m, v3_norm(v3_sub(pose->pos_m, m->last.pos_m)) * 1.000001f);
    }
    if (!m->valid || !(m->slide_m + m->turn_rad < ODOMETER_MAX_M)) {
        forget(m);
    }
    m->valid = 1u;
    m->last = *pose;
}
