#include "drift.h"

#include <math.h>

static cr_quat product(cr_quat a, cr_quat b) {
    cr_quat q;
    q.w = a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z;
    q.x = a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y;
    q.y = a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x;
    q.z = a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w;
    return q;
}

static cr_quat unit_of(cr_quat q) {
    const float scale = 1.0f / sqrtf(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    q.w *= scale;
    q.x *= scale;
    q.y *= scale;
    q.z *= scale;
    return q;
}

static void store(cr_drift_row *row, const cr_pose *pose, const cr_output *out) {
    const float rot[4] = {pose->rot.w, pose->rot.x, pose->rot.y, pose->rot.z};
    const float force[3] = {out->force_world_N.x, out->force_world_N.y, out->force_world_N.z};
    const float torque[3] = {out->torque_world_Nm.x, out->torque_world_Nm.y, out->torque_world_Nm.z};
    for (int i = 0; i < 4; i++) {
        row->rot[i] = rot[i];
    }
    for (int i = 0; i < 3; i++) {
        row->force_N[i] = force[i];
        row->torque_Nm[i] = torque[i];
    }
    row->depth_m = out->depth_m;
    row->faults = out->faults;
}

void cr_drift_run(cr_world *world, cr_pose *pose, cr_quat step, int unit, size_t every, size_t count,
                  cr_drift_row *rows) {
    static const cr_output none;
    cr_output out = none;
    for (size_t row = 0; row < count; row++) {
        for (size_t i = 0; i < every; i++) {
            const cr_quat next = product(step, pose->rot);
            pose->rot = unit ? unit_of(next) : next;
            cr_tick(world, pose, 1e-3f, &out);
        }
        store(&rows[row], pose, &out);
    }
}
