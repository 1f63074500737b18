/* pose: joint values in, pose of the tool, Jacobian, margin and range out. */
#include "servo/servo_stages.h"

#define PI_F 3.14159265f
#define HALF_PI_F 1.57079633f
#define ANGLE_MAX_RAD 100.0f

/* Quadrant by Cody and Waite (pi/2 in three pieces that multiply exactly for |angle| <= 100), then the minimax polynomials
 * of Cephes sinf and cosf on +-pi/4. */
void cr_sincos(float angle_rad, float *sine, float *cosine) {
    if (!(abs_f(angle_rad) <= ANGLE_MAX_RAD)) {
        *sine = 0.0f;
        *cosine = 1.0f;
        return;
    }
    float turns = angle_rad * (1.0f / HALF_PI_F);
    int32_t quadrant = (int32_t)(turns + (turns < 0.0f ? -0.5f : 0.5f));
    float n = (float)quadrant;
    float x = ((angle_rad - n * 1.5703125f) - n * 4.8351287841796875e-4f) - n * 3.13916479e-7f;
    float z = x * x;
    float s = ((-1.9515295891e-4f * z + 8.3321608736e-3f) * z - 1.6666654611e-1f) * z * x + x;
    float c =
        ((2.443315711809948e-5f * z - 1.388731625493765e-3f) * z + 4.166664568298827e-2f) * z * z - 0.5f * z + 1.0f;
    switch ((uint32_t)quadrant & 3u) {
    case 0u:
        *sine = s;
        *cosine = c;
        break;
    case 1u:
        *sine = c;
        *cosine = -s;
        break;
    case 2u:
        *sine = -s;
        *cosine = -c;
        break;
    default:
        *sine = -c;
        *cosine = s;
        break;
    }
}

/* Angle of slope t in 0..1: halved about tan(pi/8), then the polynomial of Cephes atanf. */
static float atan_of(float t) {
    float base = 0.0f;
    if (t > 0.41421356f) {
        base = 0.25f * PI_F;
        t = (t - 1.0f) / (t + 1.0f);
    }
    float z = t * t;
    float p = ((8.05374449538e-2f * z - 1.38776856032e-1f) * z + 1.99777106478e-1f) * z - 3.33329491539e-1f;
    return base + (p * z * t + t);
}

float cr_atan2(float y, float x) {
    float ax = abs_f(x), ay = abs_f(y);
    float large = max_f(ax, ay), small = min_f(ax, ay);
    if (!(large > 0.0f) || !is_finite_f(x) || !is_finite_f(y)) {
        return 0.0f;
    }
    float angle = atan_of(small / large);
    angle = ay > ax ? HALF_PI_F - angle : angle;
    angle = x < 0.0f ? PI_F - angle : angle;
    return y < 0.0f ? -angle : angle;
}

static cr_quat quat_mul(cr_quat a, cr_quat b) {
    cr_quat r = {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                 a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
    return r;
}
static cr_quat quat_conjugate(cr_quat q) {
    cr_quat r = {q.w, -q.x, -q.y, -q.z};
    return r;
}
static cr_quat quat_unit(cr_quat q) {
    float n2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    float s = n2 > 1e-12f ? 1.0f / sqrtf(n2) : 0.0f;
    cr_quat r = {n2 > 1e-12f ? q.w * s : 1.0f, q.x * s, q.y * s, q.z * s};
    return r;
}
static cr_vec3 quat_rotate(cr_quat q, cr_vec3 v) {
    cr_pose p = {{0.0f, 0.0f, 0.0f}, q};
    xform m = cr_xform_from_pose(&p);
    return xform_rotate(&m, v);
}

/* Yaw about Z, then pitch about the new Y, then roll about the new X. */
static cr_quat wrist_rotation(const float wrist_rad[3]) {
    float s[3] = {0.0f, 0.0f, 0.0f}, c[3] = {1.0f, 1.0f, 1.0f};
    for (int i = 0; i < 3; i++) {
        cr_sincos(0.5f * wrist_rad[i], &s[i], &c[i]);
    }
    cr_quat yaw = {c[0], 0.0f, 0.0f, s[0]}, pitch = {c[1], 0.0f, s[1], 0.0f}, roll = {c[2], s[2], 0.0f, 0.0f};
    return quat_mul(quat_mul(yaw, pitch), roll);
}

static uint32_t find_range(const cr_arm_config *arm, const cr_joints *j) {
    uint32_t range = 0u;
    float elbow = j->joint[1] - j->joint[2];
    for (uint32_t i = 0; i < CR_AXES; i++) {
        int joint_in = j->joint[i] >= arm->joint_min[i] && j->joint[i] <= arm->joint_max[i];
        int wrist_in = j->wrist_rad[i] >= arm->wrist_min_rad[i] && j->wrist_rad[i] <= arm->wrist_max_rad[i];
        range |= joint_in ? 0u : (uint32_t)CR_RANGE_JOINT << i;
        range |= wrist_in ? 0u : (uint32_t)CR_RANGE_WRIST << i;
    }
    int elbow_in = elbow >= arm->elbow_min_rad && elbow <= arm->elbow_max_rad;
    return range | (elbow_in ? 0u : (uint32_t)CR_RANGE_ELBOW);
}

/* A joint for the arithmetic: bounded, so that no sum overflows. The range bits tell. */
static float tame(float value) { return value >= -1e4f && value <= 1e4f ? value : 0.0f; }

void cr_kinematics_solve(const cr_arm_config *arm, const cr_joints *joints, cr_kinematics *out) {
    float su, cu, sf, cf, guide = tame(joints->joint[0]);
    cr_quat base = arm->world_from_base.rot;
    cr_sincos(joints->joint[1], &su, &cu);
    cr_sincos(joints->joint[2], &sf, &cf);
    cr_vec3 tip = v3(guide, arm->upper_m * cu + arm->fore_m * cf, arm->upper_m * su + arm->fore_m * sf);
    out->tip_world_m = v3_add(quat_rotate(base, tip), arm->world_from_base.pos_m);
    out->column[0] = quat_rotate(base, v3(1.0f, 0.0f, 0.0f));
    out->column[1] = quat_rotate(base, v3(0.0f, -arm->upper_m * su, arm->upper_m * cu));
    out->column[2] = quat_rotate(base, v3(0.0f, -arm->fore_m * sf, arm->fore_m * cf));
    out->margin = abs_f(su * cf - cu * sf);
    out->range = find_range(arm, joints);
    cr_quat hand = quat_mul(base, wrist_rotation(joints->wrist_rad));
    out->world_from_tool.rot = quat_unit(quat_mul(hand, arm->tip_from_tool.rot));
    out->world_from_tool.pos_m = v3_add(out->tip_world_m, quat_rotate(hand, arm->tip_from_tool.pos_m));
}

/* The two links as a triangle with the tip at (y, z): elbow by the cosine rule, elevation from the tip's own. */
static cr_err solve_arm(const cr_arm_config *arm, float y, float z, float *upper, float *fore) {
    float a = arm->upper_m, b = arm->fore_m;
    float cosine = (y * y + z * z - a * a - b * b) / (2.0f * a * b);
    if (!(cosine > -1.0f && cosine < 1.0f)) {
        return CR_ERR_VALUE;
    }
    float sine = sqrtf((1.0f - cosine) * (1.0f + cosine));
    *upper = cr_atan2(z, y) + cr_atan2(b * sine, a + b * cosine);
    *fore = *upper - cr_atan2(sine, cosine);
    return CR_OK;
}

cr_err cr_joints_from_pose(const cr_arm_config *arm, const cr_pose *world_from_tool, cr_joints *joints) {
    cr_quat hand = quat_mul(world_from_tool->rot, quat_conjugate(arm->tip_from_tool.rot));
    cr_quat to_base = quat_conjugate(arm->world_from_base.rot);
    cr_vec3 tip_world = v3_sub(world_from_tool->pos_m, quat_rotate(hand, arm->tip_from_tool.pos_m));
    cr_vec3 tip = quat_rotate(to_base, v3_sub(tip_world, arm->world_from_base.pos_m));
    cr_joints found;
    cr_err err = solve_arm(arm, tip.y, tip.z, &found.joint[1], &found.joint[2]);
    if (err != CR_OK || !v3_is_finite(tip)) {
        return CR_ERR_VALUE;
    }
    cr_pose wrist = {{0.0f, 0.0f, 0.0f}, quat_unit(quat_mul(to_base, hand))};
    xform m = cr_xform_from_pose(&wrist);
    found.joint[0] = tip.x;
    found.wrist_rad[0] = cr_atan2(m.r1.x, m.r0.x);
    found.wrist_rad[1] = cr_atan2(-m.r2.x, sqrtf(m.r0.x * m.r0.x + m.r1.x * m.r1.x));
    found.wrist_rad[2] = cr_atan2(m.r2.y, m.r2.z);
    *joints = found;
    return CR_OK;
}
