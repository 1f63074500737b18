/* A control on the guide alone, at the reference posture, with nothing in the way of the force. */
#ifndef CRT_CONTROL_BENCH_H
#define CRT_CONTROL_BENCH_H

#include "servo/servo_stages.h"

/* A count of the guide's encoder. */
#define CRT_STEP_M 60e-6

typedef struct {
    cr_servo_config config;
    cr_control control;
    cr_kinematics kinematics;
    cr_control_input in;
    cr_control_output out;
} crt_bench;

/* Purpose  no ramp, no friction, no gravity; at rest. */
crt_bench crt_bench_make(void);

/* Purpose  the posture from here on; m, rad, rad. */
void crt_bench_set_joints(crt_bench *b, float guide, float upper, float fore);

/* Purpose  a period with this force of the contact, N; its output is finite. */
void crt_bench_step(crt_bench *b, float fx, float fy, float fz);

/* Purpose  is a within the tolerance of b? */
int crt_near(float a, double b, double tolerance);

#endif
