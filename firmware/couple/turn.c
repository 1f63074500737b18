/* Rotation vectors and attitudes, exact for any angle. */
#include "couple/couple_parts.h"

/* (atan(t) - t) / t^3 for |t| <= tan(pi / 8), in z = t^2: Cephes atanf. */
static float atan_rest(float z) {
    return ((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z - 3.33329491539e-1f;
}

static cr_quat quat_times(cr_quat a, cr_quat b) {
    cr_quat r = {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                 a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
    return r;
}

cr_vec3 cr_couple_turn_between(cr_quat from, cr_quat to) {
    const cr_quat back = {from.w, -from.x, -from.y, -from.z};
    const cr_quat q = quat_times(to, back);
    const float sign = q.w < 0.0f ? -1.0f : 1.0f;
    const cr_vec3 v = v3(sign * q.x, sign * q.y, sign * q.z); /* sin(angle / 2) axis */
    const float cosine = sign * q.w, sine = v3_norm(v);
    const float quarter = sine / (1.0f + cosine); /* tan(angle / 4) <= 1 */
    const float part = 1.0f / ((1.0f + cosine) * (1.0f + sqrtf(1.0f + quarter * quarter)));
    const float eighth = sine * part; /* tan(angle / 8) */
    const float z = eighth * eighth;
    return v3_scale(v, 8.0f * part * (1.0f + z * atan_rest(z)));
}

cr_quat cr_couple_turned(cr_quat q, cr_vec3 turn_rad) {
    /* Sine and cosine of the sixteenth by their series, then squared three times. */
    const cr_vec3 part = v3_scale(turn_rad, 1.0f / 16.0f);
    const float h2 = v3_dot(part, part);
    const float sine = 1.0f + h2 * (-1.0f / 6.0f + h2 * (1.0f / 120.0f));
    const float cosine = 1.0f + h2 * (-0.5f + h2 * (1.0f / 24.0f));
    cr_quat turn = {cosine, sine * part.x, sine * part.y, sine * part.z};
    for (int i = 0; i < 3; i++) {
        turn = quat_times(turn, turn);
    }
    const cr_quat r = quat_times(turn, q);
    const float s = 1.0f / sqrtf(r.w * r.w + r.x * r.x + r.y * r.y + r.z * r.z);
    const cr_quat unit = {s * r.w, s * r.x, s * r.y, s * r.z};
    return unit;
}
