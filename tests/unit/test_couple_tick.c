/* A coupling that looks for its contacts, in scenes whose distances are analytic: a cube on a wall, over an edge, in a room, against a plate that is thinner
 * than it is deep. */
#include "couple.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define HALF_M 8e-3
#define VOXEL_M 2e-3
#define PERIOD_S 1e-3f
#define INSIDE_MAX 2e-5
#define BALL_M 10e-3
#define BALL_OFF_MAX 25e-5 /* in a tick, where a sample passes the edge */
#define STROKES 60
#define PI 3.14159265358979323846

static crt_rig wall, edge, room, plate;
static cr_coupled coupled;
static cr_couple_output out;

static int open_rigs(void **state) {
    (void)state;
    const crt_solid w = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0), e = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    const crt_solid r = crt_room(-14e-3, 20e-3, 14e-3, -14e-3, 20e-3), p = crt_box(-40e-3, 40e-3, 40e-3, -1e-3, 0.0);
    crt_open_cube(&wall, &w, HALF_M, 1e-3, VOXEL_M);
    crt_open_cube(&edge, &e, HALF_M, 1e-3, VOXEL_M);
    crt_open_cube(&room, &r, HALF_M, 1e-3, VOXEL_M);
    crt_open_cube(&plate, &p, HALF_M, 1e-3, 1e-3);
    return 0;
}

static int close_rigs(void **state) {
    (void)state;
    crt_close(&wall);
    crt_close(&edge);
    crt_close(&room);
    crt_close(&plate);
    return 0;
}

static void begin(float friction) {
    cr_couple_config c = cr_couple_config_default();
    c.stiffness_N_m = 2000.0f;
    c.friction = friction;
    assert_int_equal(cr_coupled_init(&coupled, &c), CR_OK);
}

static void tick(const crt_rig *rig, cr_pose hand) {
    memset(&out, 0xa5, sizeof out);
    cr_couple_tick(&coupled, rig->world, &hand, PERIOD_S, &out);
    assert_int_equal(out.faults, 0);
    assert_int_equal(coupled.stats.dropped, 0);
    assert_true(coupled.stats.steps <= CR_COUPLE_STEPS_MAX && coupled.contact_count <= CR_COUPLE_CONTACTS_MAX);
}

static cr_pose turned(double x, double y, double z, cr_quat rot) {
    cr_pose p = crt_pose(x, y, z);
    p.rot = rot;
    return p;
}

/* A corner of the held cube: x and z. */
static void corner_of(int k, double *x, double *z) {
    const cr_quat q = out.held.rot;
    const double v[3] = {k & 1 ? HALF_M : -HALF_M, k & 2 ? HALF_M : -HALF_M, k & 4 ? HALF_M : -HALF_M};
    const double c[3] = {(double)q.y * v[2] - (double)q.z * v[1], (double)q.z * v[0] - (double)q.x * v[2],
                         (double)q.x * v[1] - (double)q.y * v[0]};
    const double w = (double)q.w;
    *x = v[0] + 2.0 * (w * c[0] + (double)q.y * c[2] - (double)q.z * c[1]) + (double)out.held.pos_m.x;
    *z = v[2] + 2.0 * (w * c[2] + (double)q.x * c[1] - (double)q.y * c[0]) + (double)out.held.pos_m.z;
}

/* How deep a corner of the held cube is below a box, of which z = 0 is the top and x = right the side. */
static double deepest_corner(double right) {
    double deep = 0.0;
    for (int k = 0; k < 8; k++) {
        double x, z;
        corner_of(k, &x, &z);
        deep = fmax(deep, fmin(-z, right - x));
    }
    return deep;
}

/* How deep it is in a floor at z = low or in a wall at x = low, the deeper of the two. */
static double deepest_in_corner(double low) {
    double deep = 0.0;
    for (int k = 0; k < 8; k++) {
        double x, z;
        corner_of(k, &x, &z);
        deep = fmax(deep, fmax(low - z, low - x));
    }
    return deep;
}

static void nothing_is_felt_before_it_touches_and_the_spring_alone_after(void **state) {
    (void)state;
    begin(0.0f);
    for (int i = 0; i <= 400; i++) {
        const double above_m = 1e-3 * (200 - i) / 100.0;
        tick(&wall, crt_pose(0.0, 0.0, HALF_M + above_m));
        const double want_N = above_m < 0.0 ? -2000.0 * above_m : 0.0;
        assert_true(fabs((double)out.force_world_N.z - want_N) < 2e-3);
        assert_true(above_m <= 1e-6 || (double)out.force_world_N.z == 0.0);
        assert_true(fabs((double)out.force_world_N.x) < 1e-3 && fabs((double)out.torque_world_Nm.y) < 1e-4);
        assert_true(deepest_corner(1.0) < INSIDE_MAX);
    }
    assert_true(out.pressing >= 3u && out.pressing <= CR_COUPLE_CONTACTS_MAX);
    tick(&wall, crt_pose(0.0, 0.0, HALF_M + 5e-3)); /* let go: it meets the hand without a kick */
    assert_true((double)out.force_world_N.z == 0.0 && fabsf(out.held.pos_m.z - (float)(HALF_M + 5e-3)) < 1e-6f);
}

static void plate_never_lets_through(void **state) {
    (void)state;
    uint64_t seed = 11u;
    for (int stroke = 0; stroke < STROKES; stroke++) {
        const double speed_m = crt_uniform(&seed, 2e-4, 1e-3), x = crt_uniform(&seed, -8e-3, 8e-3);
        const cr_quat rot = stroke < 10 ? crt_turn(0.0, 0.0, 1.0, 0.0) : crt_random_rotation(&seed);
        begin(stroke % 2 ? 0.3f : 0.0f);
        for (double z = 25e-3; z > -6e-3; z -= speed_m) {
            tick(&plate, turned(x, 0.0, z, rot));
            assert_true((double)out.inside_m < INSIDE_MAX);
            assert_true((double)out.held.pos_m.z > HALF_M - INSIDE_MAX && deepest_corner(1.0) < INSIDE_MAX);
        }
        assert_true(out.force_world_N.z > 20.0f);
    }
}

static void edge_holds_a_cube_that_turns_over_it(void **state) {
    (void)state;
    begin(0.0f);
    for (int i = 0; i < 1000; i++) {
        const double a = i * PI / 1000.0;
        tick(&edge, turned(6e-3 * cos(a) + 2e-3, 0.0, 9e-3 - 6e-3 * sin(a), crt_turn(0.2, 1.0, 0.1, 0.8 * sin(a))));
        assert_true(deepest_corner(0.0) < INSIDE_MAX);
    }
}

/* The edge of the block, not a point of the tool, is what touches: the middle of a face comes down on it aslant. */
static void edge_between_samples_is_felt_where_it_touches(void **state) {
    (void)state;
    const double lean = PI / 4.0;
    for (int k = 0; k < 20; k++) { /* wherever the samples are */
        const double along = 1e-3 * (k - 10) / 10.0, from = HALF_M + 1e-3, s = sin(lean), c = cos(lean);
        begin(0.0f);
        for (int i = 0; i <= 120; i++) {
            const double off = from - 1e-5 * i;
            tick(&edge, turned(off * s + along * c, 0.0, off * c - along * s, crt_turn(0.0, 1.0, 0.0, lean)));
            const double want_N = off < HALF_M ? 2000.0 * (HALF_M - off) : 0.0;
            const double got_N = sqrt((double)(out.force_world_N.x * out.force_world_N.x) +
                                      (double)(out.force_world_N.z * out.force_world_N.z));
            assert_true(fabs(got_N - want_N) < 2000.0 * INSIDE_MAX);
        }
    }
}

/* A direction of the tool in the world. */
static void carried(cr_quat q, const double v[3], double *to) {
    const double u[3] = {(double)q.x, (double)q.y, (double)q.z}, w = (double)q.w;
    const double uv = u[0] * v[0] + u[1] * v[1] + u[2] * v[2], uu = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        to[a] = 2.0 * uv * u[a] + (w * w - uu) * v[a] + 2.0 * w * (u[b] * v[c] - u[c] * v[b]);
    }
}

/* Two edges that cross, wherever the samples are: what is felt is at right angles to both, and no period brings another direction. */
static void edges_that_cross_push_at_right_angles_to_both(void **state) {
    (void)state;
    const double along_y[3] = {0.0, 1.0, 0.0}, middle[3] = {-HALF_M, 0.0, -HALF_M};
    for (int k = 0; k < 24; k++) {
        const cr_quat rot = crt_turn(1.0, 0.05, 1.05, 0.5 + 0.04 * (k % 8));
        double edge_m[3], t[3];
        carried(rot, middle, edge_m);
        carried(rot, along_y, t);
        const double size = sqrt(t[0] * t[0] + t[2] * t[2]), sign = t[2] < 0.0 ? 1.0 : -1.0;
        const double n[3] = {-sign * t[2] / size, 0.0, sign * t[0] / size}; /* e x t, e along y */
        const double up = n[0] + n[2] > 0.0 ? 1.0 : -1.0, off = 1e-3 * (k - 12) / 8.0;
        begin(0.0f);
        for (int i = -20; i <= 40; i++) {
            const double down = 1e-5 * i * up;
            tick(&edge, turned(off * t[0] - edge_m[0] - down * n[0], off * t[1] - edge_m[1],
                               off * t[2] - edge_m[2] - down * n[2], rot));
            const cr_vec3 f = out.force_world_N;
            double held[3];
            carried(out.held.rot, along_y, held);
            const double force = sqrt((double)(f.x * f.x + f.y * f.y + f.z * f.z));
            const double leans = (double)f.x * held[0] + (double)f.y * held[1] + (double)f.z * held[2];
            assert_true(i <= 2 || force > 0.0);
            assert_true(fabs((double)f.y) <= 2e-3 * force + 2e-3 && fabs(leans) <= 2e-3 * force + 2e-3);
        }
    }
}

/* Drawn along its own lowest edge over that of the block, piece after piece to its corner, which comes off at once: what is felt does not swing. */
static void edge_drawn_over_an_edge_is_felt_alike_along_all_of_it(void **state) {
    (void)state;
    const double along_x[3] = {1.0, 0.0, 0.0}, corner[3] = {-HALF_M, -HALF_M, -HALF_M};
    const double cx = cos(PI / 8.0), sx = sin(PI / 8.0);
    for (int k = 1; k <= 14; k++) {
        const double lean = 0.025 * k, cy = cos(0.5 * lean), sy = sin(0.5 * lean);
        const cr_quat rot = {(float)(cy * cx), (float)(cy * sx), (float)(sy * cx), (float)(-sy * sx)};
        begin(0.0f);
        for (int i = -20; i <= 330; i++) {
            const double down = fmin(1e-3, 5e-5 * i), at[3] = {4e-3 - 4e-5 * fmax(0, i), -HALF_M, -HALF_M};
            double from[3], t[3], v[3];
            carried(rot, at, from);
            tick(&edge, turned(-from[0] - down * sin(lean), -from[1], -from[2] - down * cos(lean), rot));
            carried(out.held.rot, along_x, t);
            carried(out.held.rot, corner, v);
            const cr_vec3 f = out.force_world_N;
            const double force = sqrt((double)(f.x * f.x + f.y * f.y + f.z * f.z));
            const double leans = (double)f.x * t[0] + (double)f.y * t[1] + (double)f.z * t[2];
            const int off_corner = at[0] > -HALF_M + 1e-4, past = at[0] < -HALF_M - 2e-4;
            assert_true(i <= 2 || !off_corner || force > 0.0);
            assert_true(!off_corner ||
                        (fabs((double)f.y) <= 2e-3 * force + 2e-3 && fabs(leans) <= 2e-3 * force + 2e-3));
            assert_true(!past || (double)out.held.pos_m.z + v[2] < -5e-4); /* it fell */
        }
    }
}

/* Round an edge of the block, its middle a way below where the ball would touch: down on the top, round the edge, down the side. */
static void way_round_edge(double at, double deep_m, double *x, double *z) {
    const double r = BALL_M - deep_m, a = 0.5 * PI * fmin(1.0, fmax(0.0, at));
    *x = r * sin(a) + fmin(0.0, at) * HALF_M;
    *z = r * cos(a) - fmax(0.0, at - 1.0) * HALF_M;
}

/* Without friction it rests nowhere: what is felt is the way out to the block with a round of the ball's radius. */
static void ball_slides_round_an_edge(void **state) {
    (void)state;
    const crt_solid e = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    const double deep[] = {1e-3, 1.5e-3, 3e-3};
    crt_tool ball = crt_tool_new(1e-3);
    crt_rig rig;
    crt_add_ball(&ball, BALL_M);
    crt_open(&rig, &e, &ball, 1e-3, NULL);
    for (int k = 0; k < 12; k++) {
        const cr_quat rot = crt_turn(0.3, 0.5, 0.8, 0.3 + 0.45 * (k % 4));
        const double deep_m = deep[k / 4];
        double sum = 0.0;
        begin(0.0f);
        for (int i = -50; i <= 900; i++) {
            double x, z;
            way_round_edge((fmax(0, i) - 300) / 300.0, i < 0 ? -1e-3 - 1e-5 * i : deep_m * fmin(1.0, i / 100.0), &x,
                           &z);
            tick(&rig, turned(x, 0.0, z, rot));
            const double over = fmax(0.0, x), up = fmax(0.0, z), far = sqrt(over * over + up * up);
            const double want_N = 2000.0 * fmax(0.0, BALL_M - far) / far;
            const double off_N =
                hypot((double)out.force_world_N.x - want_N * over, (double)out.force_world_N.z - want_N * up);
            assert_true(off_N < 2000.0 * BALL_OFF_MAX);
            sum += off_N * off_N / 951.0;
        }
        assert_true(sqrt(sum) < 2000.0 * INSIDE_MAX);
    }
    crt_close(&rig);
    crt_tool_free(&ball);
}

static void room_holds_a_cube_in_its_corner(void **state) {
    (void)state;
    begin(0.0f);
    for (int i = 0; i < 500; i++) {
        tick(&room, crt_pose(-4e-5 * i, -4e-5 * i, -4e-5 * i));
    }
    assert_true(fabsf(out.held.pos_m.x + 6e-3f) < 2e-5f && fabsf(out.held.pos_m.z + 6e-3f) < 2e-5f);
    assert_true(fabsf(out.force_world_N.x - 2000.0f * (20e-3f - 4e-5f - 6e-3f)) < 0.1f);
}

/* One corner of the cube touches two walls at once: both hold it, and it rests. */
static void corner_of_a_cube_rests_where_two_walls_meet(void **state) {
    (void)state;
    uint64_t seed = 3u;
    for (int k = 0; k < 12; k++) {
        const cr_quat rot = k == 0 ? crt_turn(0.0, 1.0, 0.0, PI / 4.0) : crt_random_rotation(&seed);
        begin(k % 2 ? 0.3f : 0.0f);
        for (int i = 0; i < 600; i++) {
            tick(&room, turned(fmax(-4e-5 * i, -12e-3), 0.0, fmax(-4e-5 * i, -10e-3), rot));
            assert_true(deepest_in_corner(-14e-3) < INSIDE_MAX && (double)out.inside_m < INSIDE_MAX);
        }
        const cr_couple_output rest = out;
        for (int i = 0; i < 50; i++) {
            tick(&room, turned(-12e-3, 0.0, -10e-3, rot));
            assert_true(coupled.stats.steps <= 2u && (double)coupled.stats.left_m == 0.0);
        }
        assert_true(fabsf(out.force_world_N.x - rest.force_world_N.x) < 2e-3f);
        assert_true(fabsf(out.force_world_N.z - rest.force_world_N.z) < 2e-3f);
        assert_true(out.force_world_N.x > 1.0f && out.force_world_N.z > 1.0f);
    }
}

/* A tool of one point above another: each of its own, and nothing else to hold it. */
static crt_tool make_needle(void) {
    crt_tool needle = crt_tool_new(1e-3);
    needle.samples = calloc(2u, sizeof *needle.samples);
    needle.start = realloc(needle.start, 2u * sizeof *needle.start);
    assert_true(needle.samples != NULL && needle.start != NULL);
    for (int k = 0; k < 2; k++) {
        crt_sample *s = &needle.samples[k];
        s->pos_m[2] = 10e-3 * k;
        s->normal[2] = k ? 1.0 : -1.0;
        s->u[0] = s->v[1] = 1.0;
        s->area_m2 = 1e-9;
        s->vertex = 1;
    }
    needle.sample_count = needle.start[1] = 2u;
    needle.cluster_count = 1u;
    return needle;
}

/* Also where the cell does not say how its facets meet: their pairs do. */
static void point_in_a_groove_and_in_a_corner_is_held_by_all_walls(void **state) {
    (void)state;
    const crt_solid walls = crt_room(-14e-3, 20e-3, 14e-3, -14e-3, 20e-3);
    crt_tool needle = make_needle();
    for (int k = 0; k < 16; k++) {
        const double lean = 0.1 * (k % 4), y = k % 8 < 4 ? 0.0 : -15.5e-3; /* into the third wall too */
        crt_rig rig;
        crt_open(&rig, &walls, &needle, VOXEL_M, NULL);
        if (k >= 8) {
            crt_forget_planes(&rig);
        }
        begin(0.0f);
        for (int i = 0; i <= 500; i++) {
            const double s = fmin(1.0, i / 400.0);
            tick(&rig, turned(-16e-3 * s, y * s, -17e-3 * s, crt_turn(0.0, 1.0, 0.0, lean)));
            const cr_vec3 at = out.held.pos_m;
            assert_true((double)at.x > -14e-3 - INSIDE_MAX && (double)at.z > -14e-3 - INSIDE_MAX);
            assert_true((double)at.y > -14e-3 - INSIDE_MAX && coupled.stats.steps < CR_COUPLE_STEPS_MAX);
        }
        assert_true(out.pressing >= (k % 8 < 4 ? 2u : 3u));
        assert_true((double)coupled.stats.left_m == 0.0 && coupled.stats.steps == 1u);
        crt_close(&rig);
    }
    crt_tool_free(&needle);
}

/* Facets that meet convexly are no walls of a groove, though one cell sees both: the distance holds a point over the edge. */
static void point_over_an_edge_of_a_mixed_cell_is_held_by_the_distance(void **state) {
    (void)state;
    const crt_solid e = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_tool needle = make_needle();
    crt_rig rig;
    crt_open(&rig, &e, &needle, VOXEL_M, NULL);
    crt_forget_planes(&rig);
    begin(0.0f);
    for (int i = 0; i <= 100; i++) {
        tick(&rig, crt_pose(-0.5e-3, 0.0, 3e-3 - 4e-5 * i));
        const cr_vec3 at = out.held.pos_m;
        assert_true(fmax((double)at.x, (double)at.z) > -0.25 * VOXEL_M);
    }
    assert_true(out.pressing == 1u && out.force_world_N.z > 0.5f);
    crt_close(&rig);
    crt_tool_free(&needle);
}

/* A field that is zero everywhere has no direction: what tells no way out is left out, and told. */
static void sample_without_a_way_out_is_left_out(void **state) {
    (void)state;
    const crt_solid w = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    const cr_pose hand = crt_pose(0.0, 0.0, HALF_M - 1e-4);
    crt_rig flat;
    crt_open_cube(&flat, &w, HALF_M, 1e-3, VOXEL_M);
    crt_forget_planes(&flat);
    int16_t *samples = crt_section(flat.image, CR_SEC_SAMPLES);
    for (uint32_t i = 0; i < flat.scene.sample_count; i++) {
        samples[i] = 0;
    }
    begin(0.0f);
    cr_couple_tick(&coupled, flat.world, &hand, PERIOD_S, &out);
    assert_true(out.faults == 0u && isfinite((double)v3_norm(out.force_world_N)));
    assert_true(coupled.stats.dropped > 0u);
    crt_close(&flat);
}

/* The springs' centre is far off the tool: where a turn is cut short, the tool still stays on its side. */
static void turn_about_a_far_centre_passes_no_plate(void **state) {
    (void)state;
    for (int k = 0; k < 12; k++) {
        cr_couple_config c = cr_couple_config_default();
        c.centre_tool_m.z = k < 6 ? 50e-3f : 100e-3f;
        assert_int_equal(cr_coupled_init(&coupled, &c), CR_OK);
        for (int i = 0; i < 30; i++) {
            const double angle = i < 3 ? 0.0 : 0.5 + 0.1 * (k % 6);
            tick(&plate, turned(0.0, 0.0, HALF_M + 6e-3, crt_turn(0.0, 1.0, 0.0, angle)));
            assert_true(deepest_corner(1.0) < INSIDE_MAX);
        }
        assert_true((double)coupled.stats.left_m == 0.0);
    }
}

/* Slid off an edge with the hand far below, it is on its way for ticks in which nothing presses: what is felt until it has arrived is the spring. */
static void spring_pulls_until_the_tool_has_arrived(void **state) {
    (void)state;
    uint64_t seed = 7u;
    uint32_t most = 0u;
    for (int k = 0; k < 20; k++) {
        const double deep_m = crt_uniform(&seed, 10e-3, 25e-3), speed_m = crt_uniform(&seed, 1e-4, 6e-4);
        const cr_quat rot = crt_turn(0.0, 0.0, 1.0, crt_uniform(&seed, 0.0, PI));
        uint32_t late = 0u;
        begin(0.0f);
        for (double z = HALF_M + 1e-3; z > HALF_M - deep_m; z -= 5e-4) {
            tick(&edge, turned(-10e-3, 0.0, z, rot));
        }
        for (double x = -10e-3; x < 20e-3; x += speed_m) {
            const cr_pose hand = turned(x, 0.0, HALF_M - deep_m, rot);
            tick(&edge, hand);
            const cr_vec3 off = v3_mad(out.force_world_N, v3_sub(out.held.pos_m, hand.pos_m), -2000.0f);
            assert_true(v3_norm(off) < 1e-3f);
            late = coupled.stats.left_m > 0.0f ? late + 1u : 0u;
            most = late > most ? late : most;
        }
        assert_true(out.pressing == 0u && v3_norm(out.force_world_N) == 0.0f);
    }
    assert_true(most >= 2u);
}

/* What is not done is told: a hand far off, and nothing between. */
static void tick_tells_how_far_it_did_not_come(void **state) {
    (void)state;
    begin(0.0f);
    tick(&wall, crt_pose(0.0, 0.0, HALF_M + 1e-4));
    double left_m = 30e-3;
    for (int i = 0; i < 40 && left_m > 0.0; i++) {
        tick(&wall, crt_pose(30e-3, 0.0, HALF_M + 1e-4));
        const double to_go_m = 30e-3 - (double)out.held.pos_m.x;
        left_m = (double)coupled.stats.left_m;
        assert_true(to_go_m < 1e-6 || left_m > 0.0);
    }
    assert_true((double)out.held.pos_m.x > 30e-3 - 1e-6 && left_m == 0.0);
}

static void friction_holds_on_a_wall_without_creep(void **state) {
    (void)state;
    begin(0.3f);
    for (int i = 0; i <= 100; i++) {
        tick(&wall, crt_pose(0.0, 0.0, HALF_M - 5e-5 * i));
    }
    for (int i = 0; i <= 100; i++) {
        tick(&wall, crt_pose(1e-5 * i, 0.0, HALF_M - 5e-3));
    }
    const cr_pose held = out.held;
    assert_true(fabsf(out.force_world_N.x + 2.0f) < 0.02f); /* of 3 N that it may carry */
    for (int i = 0; i < 3000; i++) {
        tick(&wall, crt_pose(1e-3, 0.0, HALF_M - 5e-3));
    }
    assert_true(fabsf(out.held.pos_m.x - held.pos_m.x) < 2e-7f && fabsf(held.pos_m.x) < 5e-6f);
    for (int i = 0; i <= 100; i++) {
        tick(&wall, crt_pose(1e-3 + 3e-5 * i, 0.0, HALF_M - 5e-3));
    }
    assert_true(fabsf(out.force_world_N.x + 3.0f) < 0.03f && out.held.pos_m.x > 2e-3f);
}

static void hand_that_begins_inside_is_led_out(void **state) {
    (void)state;
    begin(0.0f);
    for (int i = 0; i < 200; i++) {
        tick(&wall, crt_pose(0.0, 0.0, HALF_M - 3e-3));
    }
    assert_true(deepest_corner(1.0) < INSIDE_MAX && fabsf(out.force_world_N.z - 6.0f) < 0.05f);
}

/* Contacts that contradict each other, more than there may be: an answer, a number. */
static void hand_that_begins_across_a_plate_gets_an_answer(void **state) {
    (void)state;
    uint64_t seed = 5u;
    for (int k = 0; k < 20; k++) {
        const cr_quat rot = crt_random_rotation(&seed);
        begin(0.0f);
        for (int i = 0; i < 30; i++) {
            tick(&plate, turned(0.0, 0.0, -0.5e-3, rot));
            assert_true(isfinite(out.force_world_N.z) && fabsf(out.held.pos_m.z) < 0.1f);
        }
        for (int i = 0; i < 60; i++) {
            tick(&plate, turned(0.0, 0.0, -0.5e-3 + 5e-4 * i, rot));
        }
        assert_true(isfinite(out.force_world_N.z) && isfinite(out.held.pos_m.z));
    }
}

/* A hand that jumps is followed, over several ticks, and stopped by what lies between. */
static void hand_that_jumps_through_a_plate_is_held_before_it(void **state) {
    (void)state;
    begin(0.0f);
    tick(&plate, crt_pose(0.0, 0.0, 20e-3));
    for (int i = 0; i < 20; i++) {
        tick(&plate, crt_pose(1e-3, 0.0, -20e-3));
    }
    assert_true(fabsf(out.held.pos_m.z - (float)HALF_M) < 2e-5f && out.force_world_N.z > 50.0f);
}

/* Rocked in a corner of a room, more samples touch than there are contacts: those that have left give way. */
static void rocked_in_a_corner_contacts_give_way(void **state) {
    (void)state;
    uint32_t most = 0u;
    begin(0.0f);
    for (int i = 0; i < 600; i++) {
        const double press_m = fmin(1.0, i / 50.0) * 1.5e-3, a = 0.9 * i;
        const cr_quat rot = crt_turn(cos(a), sin(a), sin(1.7 * a), 4e-3 * (1 + i % 3));
        tick(&room, turned(-6e-3 - press_m, -6e-3 - press_m, -6e-3 - press_m, rot));
        most = coupled.contact_count > most ? coupled.contact_count : most;
        assert_true((double)out.inside_m < INSIDE_MAX);
    }
    assert_int_equal(most, CR_COUPLE_CONTACTS_MAX);
}

static void more_samples_than_there_is_room_for_still_hold(void **state) {
    (void)state;
    const crt_solid w = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig fine;
    crt_open_cube(&fine, &w, HALF_M, 0.3e-3, VOXEL_M);
    begin(0.0f);
    for (int i = 0; i < 40; i++) {
        const cr_pose hand = crt_pose(0.0, 0.0, HALF_M + 1e-3 - 1e-4 * i);
        cr_couple_tick(&coupled, fine.world, &hand, PERIOD_S, &out);
        assert_true(coupled.stats.near <= CR_COUPLE_NEAR_MAX && deepest_corner(1.0) < INSIDE_MAX);
    }
    assert_true(coupled.stats.dropped > 0u && fabsf(out.force_world_N.z - 5.8f) < 0.05f);
    crt_close(&fine);
}

static void bad_input_latches(void **state) {
    (void)state;
    cr_pose pose = crt_pose(0.0, 0.0, 20e-3);
    cr_couple_config c = cr_couple_config_default();
    assert_int_equal(cr_coupled_init(NULL, &c), CR_ERR_NULL);
    assert_int_equal(cr_coupled_init(&coupled, NULL), CR_ERR_NULL);
    c.friction = NAN;
    assert_int_equal(cr_coupled_init(&coupled, &c), CR_ERR_CONFIG);
    begin(0.0f);
    tick(&wall, pose);
    cr_couple_tick(&coupled, NULL, &pose, PERIOD_S, &out);
    assert_int_equal(out.faults, CR_COUPLE_FAULT_CONTACT);
    cr_couple_tick(&coupled, wall.world, &pose, 0.0f, &out);
    assert_int_equal(out.faults, CR_COUPLE_FAULT_CONTACT | CR_FAULT_PERIOD);
    cr_coupled_reset(&coupled);
    pose.pos_m.x = NAN;
    cr_couple_tick(&coupled, wall.world, &pose, PERIOD_S, &out);
    assert_int_equal(out.faults, CR_FAULT_POSE);
    assert_true((double)out.force_world_N.z == 0.0 && isfinite(out.held.pos_m.x));
    cr_coupled_reset(&coupled);
    tick(&wall, crt_pose(0.0, 0.0, 20e-3));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_felt_before_it_touches_and_the_spring_alone_after),
        cmocka_unit_test(plate_never_lets_through),
        cmocka_unit_test(edge_holds_a_cube_that_turns_over_it),
        cmocka_unit_test(edge_between_samples_is_felt_where_it_touches),
        cmocka_unit_test(edges_that_cross_push_at_right_angles_to_both),
        cmocka_unit_test(edge_drawn_over_an_edge_is_felt_alike_along_all_of_it),
        cmocka_unit_test(ball_slides_round_an_edge),
        cmocka_unit_test(room_holds_a_cube_in_its_corner),
        cmocka_unit_test(corner_of_a_cube_rests_where_two_walls_meet),
        cmocka_unit_test(point_in_a_groove_and_in_a_corner_is_held_by_all_walls),
        cmocka_unit_test(point_over_an_edge_of_a_mixed_cell_is_held_by_the_distance),
        cmocka_unit_test(sample_without_a_way_out_is_left_out),
        cmocka_unit_test(turn_about_a_far_centre_passes_no_plate),
        cmocka_unit_test(spring_pulls_until_the_tool_has_arrived),
        cmocka_unit_test(tick_tells_how_far_it_did_not_come),
        cmocka_unit_test(friction_holds_on_a_wall_without_creep),
        cmocka_unit_test(hand_that_begins_inside_is_led_out),
        cmocka_unit_test(hand_that_begins_across_a_plate_gets_an_answer),
        cmocka_unit_test(hand_that_jumps_through_a_plate_is_held_before_it),
        cmocka_unit_test(rocked_in_a_corner_contacts_give_way),
        cmocka_unit_test(more_samples_than_there_is_room_for_still_hold),
        cmocka_unit_test(bad_input_latches),
    };
    return cmocka_run_group_tests(tests, open_rigs, close_rigs);
}
