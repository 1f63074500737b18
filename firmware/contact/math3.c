/* math3: what is not in line, because many ask. */
#include "contact/math3.h"

/* Sums of bits, of two, four and eight. */
uint32_t cr_count_lanes(uint32_t lanes) {
    const uint32_t two = lanes - ((lanes >> 1) & 0x55555555u);
    const uint32_t four = (two & 0x33333333u) + ((two >> 2) & 0x33333333u);
    return (((four + (four >> 4)) & 0x0f0f0f0fu) * 0x01010101u) >> 24;
}

xform cr_xform_from_pose(const cr_pose *p) {
    cr_quat q = p->rot;
    float xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
    float xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
    float wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
    xform m;
    m.r0 = v3(1.0f - 2.0f * (yy + zz), 2.0f * (xy - wz), 2.0f * (xz + wy));
    m.r1 = v3(2.0f * (xy + wz), 1.0f - 2.0f * (xx + zz), 2.0f * (yz - wx));
    m.r2 = v3(2.0f * (xz - wy), 2.0f * (yz + wx), 1.0f - 2.0f * (xx + yy));
    m.t = p->pos_m;
    return m;
}

cr_vec3 cr_xform_point(const xform *m, cr_vec3 v) { return v3_add(xform_rotate(m, v), m->t); }

int cr_in_range(float v, float low, float high) { return v >= low && v <= high; }
