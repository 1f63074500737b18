/* The coupling against what statics says: a box on a floor, in a corner, between walls, on a slope; tipped, turned, let go, refused. */
#include "couple.h"
#include "couple/couple_parts.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#define K_T 2000.0f
#define K_R 5.0f
#define HALF_X 0.05f
#define HALF_Y 0.03f
#define HALF_Z 0.02f
#define FLOOR 0.3f
#define INSIDE_MAX 2e-5f

static cr_couple couple;
static cr_couple_output out;

static cr_couple_config settings(float friction) {
    cr_couple_config c = cr_couple_config_default();
    c.stiffness_N_m = K_T;
    c.stiffness_Nm_rad = K_R;
    c.friction = friction;
    return c;
}

static void begin(float friction) {
    const cr_couple_config c = settings(friction);
    assert_int_equal(cr_couple_init(&couple, &c), CR_OK);
}

/* Turned by an angle about y. */
static cr_pose pose(float x, float y, float z, double about_y) {
    const cr_pose p = {{x, y, z}, {(float)cos(about_y / 2), 0.0f, (float)sin(about_y / 2), 0.0f}};
    return p;
}

/* The face of a box that looks against an axis, as a contact with the plane whose normal that axis is. */
static cr_couple_contact face(uint32_t key, int axis, float sign, float offset) {
    const float half[3] = {HALF_X, HALF_Y, HALF_Z};
    float n[3] = {0.0f, 0.0f, 0.0f}, p[3];
    cr_couple_contact c = {0};
    n[axis] = sign;
    c.key = key;
    c.normal_world = v3_from(n);
    c.offset_m = offset;
    c.point_count = 4u;
    for (int i = 0; i < 4; i++) {
        p[axis] = -sign * half[axis];
        p[(axis + 1) % 3] = (i & 1 ? 1.0f : -1.0f) * half[(axis + 1) % 3];
        p[(axis + 2) % 3] = (i & 2 ? 1.0f : -1.0f) * half[(axis + 2) % 3];
        c.point_tool_m[i] = v3_from(p);
    }
    return c;
}

static void step(const cr_pose *hand, const cr_couple_contact *contacts, uint32_t count) {
    cr_couple_step(&couple, hand, 1e-3f, contacts, count, &out);
    assert_int_equal(out.faults, 0);
    assert_true(out.inside_m <= INSIDE_MAX);
    assert_true(out.iterations <= CR_COUPLE_ITERATIONS_MAX);
}

/* The hand goes in a straight line. */
static void go(cr_pose from, cr_pose to, uint32_t steps, const cr_couple_contact *contacts, uint32_t count) {
    for (uint32_t i = 0; i <= steps; i++) {
        const float t = (float)i / (float)steps;
        cr_pose p = to;
        p.pos_m = v3_mad(from.pos_m, v3_sub(to.pos_m, from.pos_m), t);
        step(&p, contacts, count);
    }
}

static void assert_near(float a, float b, float within) {
    if (!(fabsf(a - b) <= within)) {
        fail_msg("%.9g is not %.9g within %.3g", (double)a, (double)b, (double)within);
    }
}
static void assert_wrench(float fx, float fy, float fz, float tx, float ty, float tz) {
    const float k = 2e-5f * K_T;
    assert_near(out.force_world_N.x, fx, k);
    assert_near(out.force_world_N.y, fy, k);
    assert_near(out.force_world_N.z, fz, k);
    assert_near(out.torque_world_Nm.x, tx, k * HALF_X);
    assert_near(out.torque_world_Nm.y, ty, k * HALF_X);
    assert_near(out.torque_world_Nm.z, tz, k * HALF_X);
}
static void assert_nothing_felt(void) {
    static const cr_vec3 none = {0.0f, 0.0f, 0.0f};
    assert_memory_equal(&out.force_world_N, &none, sizeof none);
    assert_memory_equal(&out.torque_world_Nm, &none, sizeof none);
}

/* ------------------------------------------------------------------------------------------------------- statics */

static void a_free_hand_holds_the_tool_and_feels_nothing(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    begin(0.3f);
    for (int i = 0; i < 100; i++) {
        const cr_pose p = pose(0.4f + 1e-4f * (float)i, 0.2f, 0.4f, 0.03 * i);
        step(&p, &floor, i % 2 == 0 ? 1u : 0u);
        assert_nothing_felt();
        assert_int_equal(out.pressing, 0);
        assert_near(out.held.pos_m.x, p.pos_m.x, 1e-7f);
        assert_near(out.held.pos_m.z, p.pos_m.z, 1e-7f);
        assert_near(out.held.rot.y, p.rot.y, 3e-7f);
    }
}

static void a_box_on_a_floor_is_pushed_out_and_laid_flat(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    begin(0.0f);
    go(pose(0.4f, 0.2f, 0.325f, 0.1), pose(0.4f, 0.2f, 0.31f, 0.1), 150u, &floor, 1u);
    assert_int_equal(out.pressing, 4);
    assert_wrench(0.0f, 0.0f, K_T * 0.01f, 0.0f, -K_R * 0.1f, 0.0f);
    assert_near(out.held.pos_m.z, FLOOR + HALF_Z, INSIDE_MAX);
    assert_near(out.held.rot.y, 0.0f, 1e-4f);
}

static void a_box_in_a_corner_feels_each_wall_for_itself(void **state) {
    (void)state;
    const cr_couple_contact walls[3] = {face(1u, 0, 1.0f, 0.1f), face(2u, 1, 1.0f, 0.1f), face(3u, 2, 1.0f, 0.1f)};
    begin(0.0f);
    go(pose(0.16f, 0.14f, 0.13f, 0.0), pose(0.147f, 0.125f, 0.119f, 0.0), 200u, walls, 3u);
    assert_wrench(0.003f * K_T, 0.005f * K_T, 0.001f * K_T, 0.0f, 0.0f, 0.0f);
}

/* Pressed down with moment below what tips it, then above: beyond, the box stands on two points, and the moment is force times half width. */
static void a_box_tips_about_its_edge_when_the_moment_is_larger_than_its_base(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    begin(0.0f);
    for (int i = 0; i <= 600; i++) {
        const cr_pose p = pose(0.4f, 0.2f, 0.31f, 5e-4 * i);
        step(&p, &floor, 1u);
        const float moment = fabsf(out.torque_world_Nm.y);
        if (K_R * 5e-4f * (float)i < 0.99f * K_T * 0.01f * HALF_X) {
            assert_int_equal(out.pressing, 4);
            assert_near(moment, K_R * 5e-4f * (float)i, 2e-5f * K_T * HALF_X);
        } else if (K_R * 5e-4f * (float)i > 1.01f * K_T * 0.01f * HALF_X) {
            const float lean = 2.0f * asinf(out.held.rot.y);
            const float arm = HALF_X * cosf(lean) - HALF_Z * sinf(lean);
            assert_int_equal(out.pressing, 2);
            assert_near(moment, out.force_world_N.z * arm, 2e-5f * K_T * HALF_X);
        }
    }
    assert_true(out.held.rot.y > 0.01f);
}

static void a_peg_between_two_walls_stays_between_them(void **state) {
    (void)state;
    const cr_couple_contact walls[2] = {face(1u, 0, 1.0f, -HALF_X - 1e-5f), face(2u, 0, -1.0f, -HALF_X - 1e-5f)};
    begin(0.0f);
    go(pose(0.0f, 0.0f, 0.0f, 0.04), pose(0.003f, 0.002f, 0.001f, 0.04), 100u, walls, 2u);
    /* Across, pushed by 3 mm less the play; along, free; turned, the walls hold it but for what the play lets. */
    const float play = 1e-5f / HALF_Z;
    assert_wrench(-K_T * 0.003f, 0.0f, 0.0f, 0.0f, -K_R * 0.04f + K_R * play, 0.0f);
    assert_near(out.held.pos_m.y, 0.002f, 1e-6f);
    assert_near(out.held.pos_m.z, 0.001f, 1e-6f);
}

static void contacts_that_say_the_same_twice_change_nothing(void **state) {
    (void)state;
    cr_couple_contact many[CR_COUPLE_CONTACTS_MAX];
    for (uint32_t i = 0; i < CR_COUPLE_CONTACTS_MAX; i++) {
        many[i] = face(i, 2, 1.0f, FLOOR);
    }
    for (uint32_t same = 0; same < 2u; same++) {
        cr_couple_output of[2];
        for (uint32_t n = 0; n < 2u; n++) {
            begin(0.3f);
            go(pose(0.4f, 0.2f, 0.325f, 0.05), pose(0.402f, 0.2f, 0.31f, 0.05), 150u, many,
               n == 0u ? 1u : CR_COUPLE_CONTACTS_MAX);
            of[n] = out;
        }
        assert_near(of[1].force_world_N.z, of[0].force_world_N.z, 5e-6f * K_T);
        assert_near(of[1].force_world_N.x, of[0].force_world_N.x, 5e-6f * K_T);
        assert_near(of[1].torque_world_Nm.y, of[0].torque_world_Nm.y, 5e-6f * K_T * HALF_X);
        for (uint32_t i = 0; i < CR_COUPLE_CONTACTS_MAX; i++) {
            many[i].key = 7u; /* under one name too */
        }
    }
}

/* A ladder of pegs: the hand moves by a little, the wrench by no more than the springs say. */
static void no_number_of_contacts_is_stiffer_than_the_springs(void **state) {
    (void)state;
    cr_couple_contact c[CR_COUPLE_CONTACTS_MAX];
    begin(0.3f);
    for (uint32_t i = 0; i < CR_COUPLE_CONTACTS_MAX; i++) {
        c[i] = face(i, (int)(i % 3u), 1.0f, 0.1f);
        c[i].point_tool_m[i % 4u].x *= 0.5f + 0.01f * (float)i;
    }
    go(pose(0.16f, 0.14f, 0.13f, 0.0), pose(0.147f, 0.125f, 0.115f, 0.0), 200u, c, CR_COUPLE_CONTACTS_MAX);
    const cr_vec3 before = out.force_world_N;
    const float turned = out.torque_world_Nm.y;
    const cr_pose deeper = pose(0.146f, 0.125f, 0.115f, 0.0), leaning = pose(0.146f, 0.125f, 0.115f, 0.001);
    step(&deeper, c, CR_COUPLE_CONTACTS_MAX);
    assert_near(out.force_world_N.x - before.x, K_T * 1e-3f, 0.01f * K_T * 1e-3f);
    step(&leaning, c, CR_COUPLE_CONTACTS_MAX);
    assert_true(fabsf(out.torque_world_Nm.y - turned) <= 1.01f * K_R * 1e-3f);
}

/* ------------------------------------------------------------------------------------------------------ friction */

/* Pulled along the floor with 0.28 of what presses: 10 minutes at 1 kHz. */
static void a_box_below_the_angle_of_friction_does_not_drift_in_ten_minutes(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    const cr_pose pulled = pose(0.4f + 0.0028f, 0.2f, 0.31f, 0.0);
    begin(0.3f);
    go(pose(0.4f, 0.2f, 0.32f, 0.0), pose(0.4f, 0.2f, 0.31f, 0.0), 100u, &floor, 1u);
    go(pose(0.4f, 0.2f, 0.31f, 0.0), pulled, 100u, &floor, 1u);
    const cr_vec3 at = out.held.pos_m;
    assert_near(at.x, 0.4f, 1e-5f);
    for (uint32_t i = 0; i < 600000u; i++) {
        step(&pulled, &floor, 1u);
    }
    assert_near(out.held.pos_m.x, at.x, 1e-6f);
    assert_near(out.held.pos_m.y, at.y, 1e-6f);
    assert_near(out.force_world_N.x, -K_T * 0.0028f, 2e-5f * K_T);
}

static void a_box_above_the_angle_of_friction_slides_until_the_force_is_that_of_friction(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    begin(0.3f);
    go(pose(0.4f, 0.2f, 0.32f, 0.0), pose(0.4f, 0.2f, 0.31f, 0.0), 100u, &floor, 1u);
    go(pose(0.4f, 0.2f, 0.31f, 0.0), pose(0.43f, 0.24f, 0.31f, 0.0), 500u, &floor, 1u);
    const float along = sqrtf(out.force_world_N.x * out.force_world_N.x + out.force_world_N.y * out.force_world_N.y);
    assert_near(along, 0.3f * out.force_world_N.z, 0.01f * out.force_world_N.z);
    assert_near(out.force_world_N.x / along, -0.6f, 0.01f);
    assert_near(out.force_world_N.y / along, -0.8f, 0.01f);
}

static void friction_holds_a_face_against_turning_on_the_spot(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    const float limit = 0.3f * K_T * 0.01f * sqrtf(HALF_X * HALF_X + HALF_Y * HALF_Y);
    begin(0.3f);
    for (int i = 0; i <= 400; i++) {
        const double angle = i < 100 ? 0.0 : 1e-3 * (i - 100);
        cr_pose p = {{0.4f, 0.2f, 0.31f}, {(float)cos(angle / 2), 0.0f, 0.0f, (float)sin(angle / 2)}};
        step(&p, &floor, 1u);
        const float turn = K_R * (float)angle;
        assert_near(-out.torque_world_Nm.z, turn < limit ? turn : limit,
                    turn > 0.9f * limit ? 0.05f * limit : 0.01f * limit);
    }
}

static void a_point_that_moves_on_the_tool_keeps_what_friction_holds(void **state) {
    (void)state;
    cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    const cr_pose pulled = pose(0.402f, 0.2f, 0.31f, 0.0);
    begin(0.3f);
    go(pose(0.4f, 0.2f, 0.32f, 0.0), pose(0.4f, 0.2f, 0.31f, 0.0), 100u, &floor, 1u);
    go(pose(0.4f, 0.2f, 0.31f, 0.0), pulled, 100u, &floor, 1u);
    for (uint32_t i = 0; i < 100u; i++) {
        for (uint32_t j = 0; j < 4u; j++) {
            floor.point_tool_m[j].x *= 0.995f;
        }
        step(&pulled, &floor, 1u);
    }
    assert_near(out.force_world_N.x, -K_T * 0.002f, 0.01f * K_T * 0.002f);
    floor.key = 2u; /* another contact is held where it is now */
    floor.point_count = 3u;
    step(&pulled, &floor, 1u);
    floor.point_count = 4u;
    step(&pulled, &floor, 1u);
    assert_near(out.force_world_N.x, -K_T * 0.002f, 0.01f * K_T * 0.002f);
}

/* -------------------------------------------------------------------------------------------------- coming, going */

static void a_tool_pulled_off_meets_the_hand_without_a_kick(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    begin(0.3f);
    go(pose(0.4f, 0.2f, 0.325f, 0.02), pose(0.401f, 0.2f, 0.31f, 0.02), 150u, &floor, 1u);
    float before = out.force_world_N.z;
    for (int i = 0; i <= 200; i++) {
        const cr_pose p = pose(0.401f, 0.2f, 0.31f + 1e-4f * (float)i, 0.02);
        step(&p, &floor, 1u);
        assert_true(out.force_world_N.z >= 0.0f && out.force_world_N.z <= before + 1e-6f * K_T);
        assert_true(before - out.force_world_N.z <= 1.05f * K_T * 1e-4f);
        before = out.force_world_N.z;
    }
    assert_nothing_felt();
    assert_near(out.held.pos_m.z, 0.33f, 1e-7f);
}

static void a_hand_that_begins_far_inside_is_led_out_by_the_shortest_way(void **state) {
    (void)state;
    const cr_couple_contact walls[2] = {face(1u, 0, 1.0f, 0.1f), face(2u, 2, 1.0f, 0.1f)};
    const cr_pose deep = pose(0.05f, 0.0f, 0.02f, 0.0);
    begin(0.3f);
    cr_couple_step(&couple, &deep, 1e-3f, walls, 2u, &out);
    assert_near(out.force_world_N.x, K_T * 0.1f, 0.05f * K_T * 0.1f);
    assert_near(out.force_world_N.z, K_T * 0.1f, 0.05f * K_T * 0.1f);
    for (int i = 0; i < 50; i++) {
        cr_couple_step(&couple, &deep, 1e-3f, walls, 2u, &out);
    }
    assert_true(out.inside_m <= 1e-4f); /* 200 N: the points are as hard as CR_COUPLE_HARD says */
}

static void walls_that_leave_no_room_share_what_is_left(void **state) {
    (void)state;
    const cr_couple_contact walls[2] = {face(1u, 0, 1.0f, -HALF_X + 5e-4f), face(2u, 0, -1.0f, -HALF_X + 7e-4f)};
    const cr_pose p = pose(0.0f, 0.0f, 0.0f, 0.01);
    begin(0.0f);
    for (int i = 0; i < 50; i++) {
        cr_couple_step(&couple, &p, 1e-3f, walls, 2u, &out);
        assert_int_equal(out.faults, 0);
    }
    assert_near(out.held.pos_m.x, -1e-4f, 2e-6f);
    assert_near(out.inside_m, 6e-4f, 2e-6f);
}

/* Turned past a floor by a radian at once: more than one step leads through. */
static void a_hand_that_turns_too_far_for_one_step_is_followed_in_several(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, 0.2f);
    const cr_pose before = pose(0.4f, 0.2f, 0.4f, 0.0), after = pose(0.4f, 0.2f, 0.4f, 2.5);
    begin(0.0f);
    step(&before, &floor, 1u);
    step(&after, &floor, 1u);
    assert_nothing_felt();
    assert_near(2.0f * acosf(out.held.rot.w), 1.0f, 1e-3f);
    step(&after, &floor, 1u);
    step(&after, &floor, 1u);
    assert_near(2.0f * acosf(out.held.rot.w), 2.5f, 1e-3f);
    assert_nothing_felt();
}

/* Held from above by a hook and pulled down hard: turning is resisted by more than the springs, and does not swing. */
static void a_tool_that_hangs_from_a_point_does_not_swing(void **state) {
    (void)state;
    cr_couple_contact hook = {0};
    cr_couple_config c = settings(0.0f);
    hook.normal_world = v3(0.0f, 0.0f, 1.0f);
    hook.point_count = 1u;
    hook.point_tool_m[0] = v3(0.02f, 0.0f, 0.2f);
    c.stiffness_Nm_rad = 1.0f;
    assert_int_equal(cr_couple_init(&couple, &c), CR_OK);
    for (int i = 0; i <= 400; i++) {
        const cr_pose p = pose(0.0f, 0.0f, -0.2f - (i < 200 ? 1e-4f * (float)i : 0.02f), 0.0);
        cr_couple_step(&couple, &p, 1e-3f, &hook, 1u, &out);
    }
    /* Where the moment of the pull is that of the spring: the point hangs almost above the centre. */
    const float lean = 2.0f * asinf(-out.held.rot.y), pull = out.force_world_N.z;
    assert_near(pull * (0.02f * cosf(lean) - 0.2f * sinf(lean)), 1.0f * lean, 2e-3f);
    assert_near(lean, 0.09f, 0.01f);
}

/* ------------------------------------------------------------------------------------------------------- damping */

static void a_damper_adds_to_the_push_and_never_holds_back(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    cr_couple_config c = settings(0.0f);
    c.damping_Ns_m = 5.0f;
    c.damping_Nms_rad = 0.02f;
    assert_int_equal(cr_couple_init(&couple, &c), CR_OK);
    go(pose(0.4f, 0.2f, 0.33f, 0.0), pose(0.4f, 0.2f, 0.321f, 0.0), 50u, NULL, 0u);
    assert_nothing_felt();
    for (int i = 0; i < 100; i++) { /* 0.1 m/s down */
        const cr_pose p = pose(0.4f, 0.2f, 0.32f - 1e-4f * (float)i, 0.0);
        step(&p, &floor, 1u);
    }
    assert_wrench(0.0f, 0.0f, K_T * 0.0099f + 5.0f * 0.1f, 0.0f, 0.0f, 0.0f);
    for (int i = 0; i < 200; i++) {
        const cr_pose p = pose(0.4f, 0.2f, 0.31f + 5e-4f * (float)i, 0.002 * i);
        step(&p, &floor, i < 100 ? 1u : 0u);
        assert_true(out.force_world_N.z >= 0.0f);
    }
    assert_nothing_felt();
}

static void the_torque_is_about_the_origin_of_the_hands_tool(void **state) {
    (void)state;
    const cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    cr_couple_config c = settings(0.0f);
    c.centre_tool_m = v3(0.01f, 0.0f, 0.0f);
    assert_int_equal(cr_couple_init(&couple, &c), CR_OK);
    go(pose(0.4f, 0.2f, 0.325f, 0.0), pose(0.4f, 0.2f, 0.31f, 0.0), 150u, &floor, 1u);
    assert_wrench(0.0f, 0.0f, K_T * 0.01f, 0.0f, -0.01f * K_T * 0.01f, 0.0f);
    assert_near(out.held.pos_m.x, 0.4f, 1e-6f);
    assert_near(out.held.pos_m.z, FLOOR + HALF_Z, INSIDE_MAX);
}

/* ------------------------------------------------------------------------------------------------ energy, halving */

/* A closed way of the hand in a corner, some of it outside: of step i of n. */
static cr_pose on_the_way(int i, int n) {
    const double s = 6.283185307179586 * i / n, lean = 0.03 * sin(2 * s + 1);
    const cr_pose p = {
        {(float)(0.148 + 0.004 * sin(3 * s)), (float)(0.129 + 0.003 * sin(s + 2)), (float)(0.119 + 0.003 * cos(2 * s))},
        {(float)cos(lean), (float)(0.6 * sin(lean)), (float)(0.8 * sin(lean)), 0.0f}};
    return p;
}

/* What the hand was given over one round, of the mean wrench; the largest energy held; the largest change of force in a step. */
static double given_in_a_round(float friction, int n, double *stored, double *change) {
    const cr_couple_contact walls[3] = {face(1u, 0, 1.0f, 0.1f), face(2u, 1, 1.0f, 0.1f), face(3u, 2, 1.0f, 0.1f)};
    cr_couple_output last = {0};
    double given = 0.0;
    begin(friction);
    *stored = *change = 0.0;
    for (int i = 0; i <= 2 * n; i++) {
        const cr_pose p = on_the_way(i % n, n), q = on_the_way((i + n - 1) % n, n);
        cr_couple_step(&couple, &p, 1e-3f, walls, 3u, &out);
        assert_int_equal(out.faults, 0);
        assert_true(out.inside_m <= INSIDE_MAX);
        assert_true(friction > 0.0f || out.unsettled_m <= 1e-7f);
        if (i > n) {
            const cr_vec3 moved = v3_sub(p.pos_m, q.pos_m), turned = cr_couple_turn_between(q.rot, p.rot);
            const cr_vec3 f = v3_add(out.force_world_N, last.force_world_N),
                          t = v3_add(out.torque_world_Nm, last.torque_world_Nm);
            const cr_vec3 apart = v3_sub(p.pos_m, out.held.pos_m), lean = cr_couple_turn_between(out.held.rot, p.rot);
            given += 0.5 * (double)(v3_dot(f, moved) + v3_dot(t, turned));
            *stored = fmax(*stored, 0.5 * (double)(K_T * v3_dot(apart, apart) + K_R * v3_dot(lean, lean)));
            *change = fmax(*change, (double)v3_norm(v3_sub(out.force_world_N, last.force_world_N)));
        }
        last = out;
    }
    return given;
}

static void a_closed_way_gives_the_hand_no_energy(void **state) {
    (void)state;
    double stored, change;
    assert_true(given_in_a_round(0.0f, 2000, &stored, &change) <= 1e-3 * stored);
    const double lost = given_in_a_round(0.0f, 4000, &stored, &change);
    assert_true(lost <= 1e-3 * stored && lost >= -1e-3 * stored);
    assert_true(given_in_a_round(0.3f, 2000, &stored, &change) <= -0.05 * stored);
}

static void half_the_step_is_half_the_change_of_force(void **state) {
    (void)state;
    double stored, whole, half;
    (void)given_in_a_round(0.0f, 2000, &stored, &whole);
    (void)given_in_a_round(0.0f, 4000, &stored, &half);
    assert_true(half <= 0.52 * whole);
}

/* 10 mm and 0.1 rad to and fro, at up to 0.14 m/s and 1 rad/s. */
static void a_hand_that_shakes_in_a_corner_leaves_no_point_inside(void **state) {
    (void)state;
    const cr_couple_contact walls[3] = {face(1u, 0, 1.0f, 0.1f), face(2u, 1, 1.0f, 0.1f), face(3u, 2, 1.0f, 0.1f)};
    begin(0.3f);
    for (int i = 0; i < 4000; i++) {
        const float s = 2e-3f * (float)i;
        cr_pose p = pose(0.147f, 0.127f, 0.117f, 0.2 * sin(4.0 * (double)s));
        p.pos_m = v3_mad(p.pos_m, v3(sinf(3.0f * s), sinf(5.0f * s + 1.0f), sinf(7.0f * s + 2.0f)), 0.01f);
        step(&p, walls, 3u);
    }
}

/* ------------------------------------------------------------------------------------------------------- refusals */

static void what_is_no_number_is_a_fault_and_no_wrench(void **state) {
    (void)state;
    for (int i = 0; i < 18; i++) {
        cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
        cr_pose p = pose(0.4f, 0.2f, 0.31f, 0.0);
        float period = 1e-3f;
        float *const at[18] = {&p.pos_m.x,
                               &p.pos_m.y,
                               &p.pos_m.z,
                               &p.rot.w,
                               &p.rot.x,
                               &p.rot.y,
                               &p.rot.z,
                               &period,
                               &floor.normal_world.x,
                               &floor.normal_world.y,
                               &floor.normal_world.z,
                               &floor.offset_m,
                               &floor.point_tool_m[0].x,
                               &floor.point_tool_m[1].y,
                               &floor.point_tool_m[2].z,
                               &floor.point_tool_m[3].x,
                               &couple.held.pos_m.x,
                               &couple.held.rot.w};
        const uint32_t fault = i < 7    ? CR_FAULT_POSE
                               : i == 7 ? CR_FAULT_PERIOD
                               : i < 16 ? CR_COUPLE_FAULT_CONTACT
                                        : CR_FAULT_NUMBER;
        begin(0.3f);
        cr_couple_step(&couple, &p, period, &floor, 1u, &out);
        assert_true(out.force_world_N.z > 10.0f);
        const float was = *at[i];
        *at[i] = NAN;
        cr_couple_step(&couple, &p, period, &floor, 1u, &out);
        assert_int_equal(out.faults, fault);
        assert_nothing_felt();
        *at[i] = was;
        cr_couple_step(&couple, &p, period, &floor, 1u, &out);
        assert_int_equal(out.faults, fault); /* latched */
        assert_nothing_felt();
        cr_couple_reset(&couple);
        cr_couple_step(&couple, &p, period, &floor, 1u, &out);
        assert_int_equal(out.faults, 0);
        assert_true(out.force_world_N.z > 10.0f);
    }
}

static void inputs_out_of_their_ranges_are_faults(void **state) {
    (void)state;
    cr_couple_contact floor = face(1u, 2, 1.0f, FLOOR);
    const cr_pose p = pose(0.4f, 0.2f, 0.31f, 0.0);
    cr_pose odd = p;
    begin(0.0f);
    cr_couple_step(&couple, &p, 0.0f, &floor, 1u, &out);
    assert_int_equal(out.faults, CR_FAULT_PERIOD);
    cr_couple_step(&couple, &p, 1.5f, &floor, 1u, &out);
    assert_int_equal(out.faults, CR_FAULT_PERIOD);
    cr_couple_reset(&couple);
    odd.rot.w = 1.1f;
    cr_couple_step(&couple, &odd, 1e-3f, &floor, 1u, &out);
    assert_int_equal(out.faults, CR_FAULT_POSE);
    cr_couple_reset(&couple);
    odd = p;
    odd.pos_m.y = -2e4f;
    cr_couple_step(&couple, &odd, 1e-3f, &floor, 1u, &out);
    assert_int_equal(out.faults, CR_FAULT_POSE);
    cr_couple_reset(&couple);
    cr_couple_step(&couple, &p, 1e-3f, &floor, CR_COUPLE_CONTACTS_MAX + 1u, &out);
    assert_int_equal(out.faults, CR_COUPLE_FAULT_CONTACT);
    cr_couple_reset(&couple);
    cr_couple_step(&couple, &p, 1e-3f, NULL, 1u, &out);
    assert_int_equal(out.faults, CR_COUPLE_FAULT_CONTACT);
    cr_couple_reset(&couple);
    floor.point_count = CR_COUPLE_POINTS_MAX + 1u;
    cr_couple_step(&couple, &p, 1e-3f, &floor, 1u, &out);
    assert_int_equal(out.faults, CR_COUPLE_FAULT_CONTACT);
    cr_couple_reset(&couple);
    floor.point_count = 0u; /* a contact without a point is none */
    step(&p, &floor, 1u);
    assert_nothing_felt();
}

static void settings_out_of_their_ranges_are_refused(void **state) {
    (void)state;
    cr_couple_config c = settings(0.0f);
    float *const at[6] = {&c.stiffness_N_m,   &c.stiffness_Nm_rad, &c.damping_Ns_m,
                          &c.damping_Nms_rad, &c.friction,         &c.centre_tool_m.y};
    const float bad[3] = {-2e4f, 2e6f, NAN};
    assert_int_equal(cr_couple_init(NULL, &c), CR_ERR_NULL);
    assert_int_equal(cr_couple_init(&couple, NULL), CR_ERR_NULL);
    assert_null(cr_couple_config_error(&c));
    begin(0.3f);
    for (int i = 0; i < 6; i++) {
        for (int j = 0; j < 3; j++) {
            const float was = *at[i];
            *at[i] = bad[j];
            assert_non_null(cr_couple_config_error(&c));
            assert_int_equal(cr_couple_init(&couple, &c), CR_ERR_CONFIG);
            *at[i] = was;
        }
    }
    assert_near(couple.config.friction, 0.3f, 0.0f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_free_hand_holds_the_tool_and_feels_nothing),
        cmocka_unit_test(a_box_on_a_floor_is_pushed_out_and_laid_flat),
        cmocka_unit_test(a_box_in_a_corner_feels_each_wall_for_itself),
        cmocka_unit_test(a_box_tips_about_its_edge_when_the_moment_is_larger_than_its_base),
        cmocka_unit_test(a_peg_between_two_walls_stays_between_them),
        cmocka_unit_test(contacts_that_say_the_same_twice_change_nothing),
        cmocka_unit_test(no_number_of_contacts_is_stiffer_than_the_springs),
        cmocka_unit_test(a_box_below_the_angle_of_friction_does_not_drift_in_ten_minutes),
        cmocka_unit_test(a_box_above_the_angle_of_friction_slides_until_the_force_is_that_of_friction),
        cmocka_unit_test(friction_holds_a_face_against_turning_on_the_spot),
        cmocka_unit_test(a_point_that_moves_on_the_tool_keeps_what_friction_holds),
        cmocka_unit_test(a_tool_pulled_off_meets_the_hand_without_a_kick),
        cmocka_unit_test(a_hand_that_begins_far_inside_is_led_out_by_the_shortest_way),
        cmocka_unit_test(walls_that_leave_no_room_share_what_is_left),
        cmocka_unit_test(a_hand_that_turns_too_far_for_one_step_is_followed_in_several),
        cmocka_unit_test(a_tool_that_hangs_from_a_point_does_not_swing),
        cmocka_unit_test(a_damper_adds_to_the_push_and_never_holds_back),
        cmocka_unit_test(the_torque_is_about_the_origin_of_the_hands_tool),
        cmocka_unit_test(a_closed_way_gives_the_hand_no_energy),
        cmocka_unit_test(half_the_step_is_half_the_change_of_force),
        cmocka_unit_test(a_hand_that_shakes_in_a_corner_leaves_no_point_inside),
        cmocka_unit_test(what_is_no_number_is_a_fault_and_no_wrench),
        cmocka_unit_test(inputs_out_of_their_ranges_are_faults),
        cmocka_unit_test(settings_out_of_their_ranges_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
