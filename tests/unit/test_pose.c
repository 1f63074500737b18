/* Kinematics against the same geometry in double with libm, and against finite differences. */
#include "servo.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846

static uint32_t seed = 1u;
static double uniform(double low, double high) {
    seed = seed * 1664525u + 1013904223u;
    return low + (high - low) * (double)(seed >> 8) / 16777216.0;
}

/* Rotation matrices by hand: nothing shared with the code under test. */
typedef struct {
    double m[3][3];
} matrix;
static matrix turn(int axis, double angle) {
    const double c = cos(angle), s = sin(angle);
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    matrix r = {{{0}}};
    r.m[axis][axis] = 1.0;
    r.m[i][i] = r.m[j][j] = c;
    r.m[i][j] = -s;
    r.m[j][i] = s;
    return r;
}
static matrix product(matrix a, matrix b) {
    matrix r = {{{0}}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            for (int k = 0; k < 3; k++) {
                r.m[i][j] += a.m[i][k] * b.m[k][j];
            }
        }
    }
    return r;
}
static matrix of_quat(cr_quat f) {
    double w = (double)f.w, x = (double)f.x, y = (double)f.y, z = (double)f.z;
    const double n = sqrt(w * w + x * x + y * y + z * z);
    w /= n, x /= n, y /= n, z /= n;
    matrix r = {{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                 {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                 {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
    return r;
}
static void apply(matrix r, const double v[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = r.m[i][0] * v[0] + r.m[i][1] * v[1] + r.m[i][2] * v[2];
    }
}

typedef struct {
    double tip[3], tool[3];
    matrix rotation;
} reference;

static reference refer(const cr_arm_config *arm, const double joint[3], const double wrist[3]) {
    reference ref;
    const matrix base = of_quat(arm->world_from_base.rot);
    const double a = (double)arm->upper_m, b = (double)arm->fore_m;
    const double local[3] = {joint[0], a * cos(joint[1]) + b * cos(joint[2]), a * sin(joint[1]) + b * sin(joint[2])};
    const double grip[3] = {(double)arm->tip_from_tool.pos_m.x, (double)arm->tip_from_tool.pos_m.y,
                            (double)arm->tip_from_tool.pos_m.z};
    const double at[3] = {(double)arm->world_from_base.pos_m.x, (double)arm->world_from_base.pos_m.y,
                          (double)arm->world_from_base.pos_m.z};
    const matrix hand = product(base, product(turn(2, wrist[0]), product(turn(1, wrist[1]), turn(0, wrist[2]))));
    double offset[3];
    apply(base, local, ref.tip);
    apply(hand, grip, offset);
    for (int i = 0; i < 3; i++) {
        ref.tip[i] += at[i];
        ref.tool[i] = ref.tip[i] + offset[i];
    }
    ref.rotation = product(hand, of_quat(arm->tip_from_tool.rot));
    return ref;
}

static cr_arm_config odd_arm(void) {
    cr_arm_config arm = cr_servo_config_default().arm;
    arm.upper_m = 0.5f;
    arm.fore_m = 0.4f;
    arm.world_from_base = (cr_pose){{0.3f, -0.6f, 0.2f}, {0.5f, 0.5f, -0.5f, 0.5f}};
    arm.tip_from_tool = (cr_pose){{0.01f, -0.02f, 0.12f}, {0.8f, 0.0f, 0.6f, 0.0f}};
    return arm;
}

static cr_joints random_joints(double joint[3], double wrist[3]) {
    cr_joints j;
    joint[0] = uniform(-0.75, 0.75);
    joint[1] = uniform(-0.3, 2.0);
    joint[2] = joint[1] - uniform(0.7, 2.4);
    for (int i = 0; i < 3; i++) {
        wrist[i] = i == 1 ? uniform(-1.4, 1.4) : uniform(-3.1, 3.1);
        j.joint[i] = (float)joint[i];
        j.wrist_rad[i] = (float)wrist[i];
        joint[i] = (double)j.joint[i];
        wrist[i] = (double)j.wrist_rad[i];
    }
    return j;
}

static double at(cr_vec3 v, int i) { return (double)(i == 0 ? v.x : i == 1 ? v.y : v.z); }

static void sincos_is_within_its_bound_of_libm(void **state) {
    (void)state;
    double worst = 0.0;
    for (int i = -1000000; i <= 1000000; i++) {
        const float angle = (float)i * 1e-4f;
        float s, c;
        cr_sincos(angle, &s, &c);
        worst = fmax(worst, fmax(fabs((double)s - sin((double)angle)), fabs((double)c - cos((double)angle))));
    }
    print_message("sincos: worst error %.3g\n", worst);
    assert_true(worst < 1.2e-7);
}

static void sincos_of_no_angle_is_that_of_zero(void **state) {
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY, 1e30f, 101.0f};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        float s, c;
        cr_sincos(bad[i], &s, &c);
        assert_true(s == 0.0f && c == 1.0f);
    }
}

static void atan2_is_within_its_bound_of_libm(void **state) {
    (void)state;
    double worst = 0.0;
    for (int i = 0; i < 1000000; i++) {
        const float x = (float)uniform(-2.0, 2.0), y = (float)uniform(-2.0, 2.0);
        worst = fmax(worst, fabs((double)cr_atan2(y, x) - atan2((double)y, (double)x)));
    }
    print_message("atan2: worst error %.3g\n", worst);
    assert_true(worst < 4e-7);
    assert_true(cr_atan2(0.0f, 0.0f) == 0.0f && cr_atan2(NAN, 1.0f) == 0.0f && cr_atan2(1.0f, INFINITY) == 0.0f);
    assert_true(fabs((double)cr_atan2(1e-30f, -1.0f) - PI) < 4e-7);
}

static void kinematics_agrees_with_the_double_reference(void **state) {
    (void)state;
    const cr_arm_config arms[] = {cr_servo_config_default().arm, odd_arm()};
    double position = 0.0, attitude = 0.0;
    for (int n = 0; n < 200000; n++) {
        double joint[3], wrist[3];
        const cr_joints joints = random_joints(joint, wrist);
        const cr_arm_config *arm = &arms[n % 2];
        cr_kinematics kin;
        cr_kinematics_solve(arm, &joints, &kin);
        const reference ref = refer(arm, joint, wrist);
        const matrix got = of_quat(kin.world_from_tool.rot);
        for (int i = 0; i < 3; i++) {
            position = fmax(position, fabs(at(kin.tip_world_m, i) - ref.tip[i]));
            position = fmax(position, fabs(at(kin.world_from_tool.pos_m, i) - ref.tool[i]));
            for (int k = 0; k < 3; k++) {
                attitude = fmax(attitude, fabs(got.m[i][k] - ref.rotation.m[i][k]));
            }
        }
        assert_true(fabs((double)kin.margin - fabs(sin(joint[1] - joint[2]))) < 1e-6);
    }
    print_message("kinematics: position %.3g m, attitude %.3g\n", position, attitude);
    assert_true(position < 0.5e-6 && attitude < 7e-7);
}

static void jacobian_is_the_difference_quotient(void **state) {
    (void)state;
    const cr_arm_config arm = odd_arm();
    double worst = 0.0;
    for (int n = 0; n < 20000; n++) {
        double joint[3], wrist[3];
        const cr_joints joints = random_joints(joint, wrist);
        cr_kinematics kin;
        cr_kinematics_solve(&arm, &joints, &kin);
        for (int a = 0; a < 3; a++) {
            double high[3], low[3];
            memcpy(high, joint, sizeof high);
            memcpy(low, joint, sizeof low);
            high[a] += 1e-5;
            low[a] -= 1e-5;
            const reference up = refer(&arm, high, wrist), down = refer(&arm, low, wrist);
            for (int i = 0; i < 3; i++) {
                worst = fmax(worst, fabs(at(kin.column[a], i) - (up.tip[i] - down.tip[i]) / 2e-5));
            }
        }
    }
    assert_true(worst < 1e-6);
}

static void inverse_returns_to_the_joints(void **state) {
    (void)state;
    const cr_arm_config arm = odd_arm();
    double worst = 0.0;
    for (int n = 0; n < 50000; n++) {
        double joint[3], wrist[3];
        const cr_joints joints = random_joints(joint, wrist);
        cr_kinematics kin;
        cr_joints back;
        cr_kinematics_solve(&arm, &joints, &kin);
        assert_int_equal(cr_joints_from_pose(&arm, &kin.world_from_tool, &back), CR_OK);
        for (int i = 0; i < 3; i++) {
            worst = fmax(worst, fabs((double)back.joint[i] - joint[i]));
            const double d = (double)back.wrist_rad[i] - wrist[i];
            worst = fmax(worst, 0.1 * fabs(d - 2.0 * PI * round(d / (2.0 * PI)))); /* 1 / cos 80 deg: near the gimbal */
        }
    }
    print_message("inverse: worst error %.3g\n", worst);
    assert_true(worst < 4e-6);
}

static void inverse_refuses_what_is_out_of_reach(void **state) {
    (void)state;
    const cr_arm_config arm = cr_servo_config_default().arm;
    const cr_pose far = {{0.0f, 1.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}};
    const cr_pose none = {{0.0f, NAN, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}};
    cr_joints joints = {{1.0f, 2.0f, 3.0f}, {0}};
    assert_int_equal(cr_joints_from_pose(&arm, &far, &joints), CR_ERR_VALUE);
    assert_int_equal(cr_joints_from_pose(&arm, &none, &joints), CR_ERR_VALUE);
    assert_true(joints.joint[2] == 3.0f);
}

static void reference_posture_has_the_tip_at_the_origin(void **state) {
    (void)state;
    const cr_arm_config arm = cr_servo_config_default().arm;
    const cr_joints joints = {{0.0f, (float)(PI / 4.0), (float)(-PI / 4.0)}, {0}};
    cr_kinematics kin;
    cr_kinematics_solve(&arm, &joints, &kin);
    assert_true(fabs((double)kin.tip_world_m.x) + fabs((double)kin.tip_world_m.y) + fabs((double)kin.tip_world_m.z) <
                1e-6);
    assert_true(kin.margin > 0.9999f && kin.range == 0u);
}

static void range_tells_which_joint(void **state) {
    (void)state;
    const cr_arm_config arm = cr_servo_config_default().arm;
    cr_kinematics kin;
    cr_joints joints = {{0.76f, 0.8f, -0.8f}, {0.0f, 1.5f, 0.0f}};
    cr_kinematics_solve(&arm, &joints, &kin);
    assert_int_equal(kin.range, CR_RANGE_JOINT | (CR_RANGE_WRIST << 1));
    joints = (cr_joints){{0.0f, 0.5f, 0.2f}, {0}};
    cr_kinematics_solve(&arm, &joints, &kin);
    assert_int_equal(kin.range, CR_RANGE_ELBOW);
    joints.joint[1] = NAN;
    cr_kinematics_solve(&arm, &joints, &kin);
    assert_true((kin.range & (CR_RANGE_JOINT << 1)) != 0u);
}

static void kinematics_of_garbage_is_finite(void **state) {
    (void)state;
    const cr_arm_config arm = odd_arm();
    const float bad[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 0.0f};
    for (int n = 0; n < 6 * 6; n++) {
        const float a = bad[n % 6], b = bad[n / 6];
        const cr_joints joints = {{a, b, a}, {b, a, b}};
        cr_kinematics kin;
        cr_kinematics_solve(&arm, &joints, &kin);
        const float *value = &kin.world_from_tool.pos_m.x;
        for (size_t i = 0; i < offsetof(cr_kinematics, range) / sizeof(float); i++) {
            assert_true(isfinite(value[i]));
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sincos_is_within_its_bound_of_libm),
        cmocka_unit_test(sincos_of_no_angle_is_that_of_zero),
        cmocka_unit_test(atan2_is_within_its_bound_of_libm),
        cmocka_unit_test(kinematics_agrees_with_the_double_reference),
        cmocka_unit_test(jacobian_is_the_difference_quotient),
        cmocka_unit_test(inverse_returns_to_the_joints),
        cmocka_unit_test(inverse_refuses_what_is_out_of_reach),
        cmocka_unit_test(reference_posture_has_the_tip_at_the_origin),
        cmocka_unit_test(range_tells_which_joint),
        cmocka_unit_test(kinematics_of_garbage_is_finite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
