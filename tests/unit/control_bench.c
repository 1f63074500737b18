/* A control by itself: see the header. */
#include "control_bench.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846

void crt_bench_set_joints(crt_bench *b, float guide, float upper, float fore) {
    const cr_joints joints = {{guide, upper, fore}, {0}};
    cr_kinematics_solve(&b->config.arm, &joints, &b->kinematics);
    memcpy(b->in.joint, joints.joint, sizeof b->in.joint);
}

crt_bench crt_bench_make(void) {
    crt_bench b;
    memset(&b, 0, sizeof b);
    b.config = cr_servo_config_default();
    b.config.control.ramp_s = 0.0f;
    b.config.control.force_rate_max_N_s = 1e6f;
    b.config.control.friction_share = 0.0f;
    b.config.axis[1].gravity = b.config.axis[2].gravity = 0.0f;
    b.in.period_s = 1e-3f;
    crt_bench_set_joints(&b, 0.0f, (float)(PI / 4.0), (float)(-PI / 4.0));
    return b;
}

void crt_bench_step(crt_bench *b, float fx, float fy, float fz) {
    b->in.kinematics = &b->kinematics;
    b->in.contact_force_N = v3(fx, fy, fz);
    cr_control_step(&b->config, &b->control, &b->in, &b->out);
    assert_true(b->out.finite);
}

int crt_near(float a, double b, double tolerance) { return fabs((double)a - b) <= tolerance; }
