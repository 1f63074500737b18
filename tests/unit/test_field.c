/* Distances: exact next to planes, edges and vertices, lower bounds far away. Expected values are analytic, in double. */
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define PI 3.14159265358979323846
#define VOXEL_M 2e-3
#define POSITION_ROUNDING_M 1e-8
#define POINTS 4096

static void open_with_cube(crt_rig *rig, const crt_solid *solid) { crt_open_cube(rig, solid, 4e-3, 2e-3, VOXEL_M); }

static void look_up(const crt_rig *rig, const float p[CR_LANES][3], cr_lookup *out) {
    cr_lanes3 lanes;
    for (int i = 0; i < CR_LANES; i++) {
        lanes.x[i] = p[i][0];
        lanes.y[i] = p[i][1];
        lanes.z[i] = p[i][2];
    }
    memset(out, 0xff, sizeof *out);
    cr_field_look_up(&rig->field, &lanes, out);
}

static double distance_at(const crt_solid *solid, const float p[3]) {
    const double q[3] = {(double)p[0], (double)p[1], (double)p[2]};
    return crt_distance(solid, q);
}

/* Random points of a box, 16 at a time: largest |phi - exact| where the exact distance is below reach_m. */
static double largest_error(const crt_rig *rig, const crt_solid *solid, const double low[3], const double high[3],
                            double reach_m, int *compared) {
    uint64_t seed = 3u;
    double worst = 0.0;
    *compared = 0;
    for (int n = 0; n < POINTS / CR_LANES; n++) {
        float p[CR_LANES][3];
        cr_lookup at;
        for (int i = 0; i < CR_LANES; i++) {
            for (int a = 0; a < 3; a++) {
                p[i][a] = (float)crt_uniform(&seed, low[a], high[a]);
            }
        }
        look_up(rig, (const float(*)[3])p, &at);
        for (int i = 0; i < CR_LANES; i++) {
            double exact = distance_at(solid, p[i]);
            if (fabs(exact) < reach_m) {
                worst = fmax(worst, fabs((double)at.phi_m[i] - exact));
                ++*compared;
            }
        }
    }
    return worst;
}

static void check_box(const crt_solid *solid, const double low[3], const double high[3]) {
    crt_rig rig;
    int compared = 0;
    open_with_cube(&rig, solid);
    double quantum = (double)rig.scene.meta->quantum_m;
    double error = largest_error(&rig, solid, low, high, 3.4e-3, &compared);
    assert_true(compared > POINTS / 10);
    if (!(error < 0.51 * quantum + POSITION_ROUNDING_M)) {
        fail_msg("error %g m, quantum %g m", error, quantum);
    }
    crt_close(&rig);
}

static void field_is_exact_to_quantisation_on_a_plane(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    const double low[3] = {-20e-3, -20e-3, -4e-3}, high[3] = {20e-3, 20e-3, 4e-3};
    check_box(&block, low, high);
}

static void field_is_exact_at_a_convex_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    const double low[3] = {-4e-3, -20e-3, -4e-3}, high[3] = {4e-3, 20e-3, 4e-3};
    check_box(&block, low, high);
}

static void field_is_exact_at_a_convex_vertex(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 30e-3, -40e-3, 0.0);
    const double low[3] = {-4e-3, 26e-3, -4e-3}, high[3] = {4e-3, 34e-3, 4e-3};
    check_box(&block, low, high);
}

static void field_is_exact_at_sharp_and_blunt_wedges(void **state) {
    (void)state;
    const double angles_deg[] = {40.0, 60.0, 120.0, 150.0};
    for (size_t i = 0; i < sizeof angles_deg / sizeof *angles_deg; i++) {
        crt_solid wedge = crt_wedge(angles_deg[i] * PI / 180.0, 30e-3, 20e-3);
        const double low[3] = {-5e-3, -24e-3, -5e-3}, high[3] = {5e-3, 24e-3, 5e-3};
        check_box(&wedge, low, high);
    }
}

static void field_is_exact_at_a_concave_edge(void **state) {
    (void)state;
    crt_solid room = crt_room(-30e-3, 0.0, 30e-3, -30e-3, 0.0);
    const double low[3] = {-4e-3, -20e-3, -4e-3}, high[3] = {4e-3, 20e-3, 4e-3};
    check_box(&room, low, high);
}

static void field_is_exact_at_a_concave_vertex(void **state) {
    (void)state;
    crt_solid room = crt_room(-30e-3, 0.0, 20e-3, -30e-3, 0.0);
    const double low[3] = {-4e-3, 16e-3, -4e-3}, high[3] = {4e-3, 24e-3, 4e-3};
    check_box(&room, low, high);
}

static void field_stays_within_its_stated_error_on_a_ball(void **state) {
    (void)state;
    crt_solid ball = crt_ball(20e-3);
    crt_rig rig;
    int compared = 0;
    open_with_cube(&rig, &ball);
    const double low[3] = {-24e-3, -24e-3, -24e-3}, high[3] = {24e-3, 24e-3, 24e-3};
    double error = largest_error(&rig, &ball, low, high, 3.4e-3, &compared);
    assert_true(compared > 100);
    assert_true(error < (double)rig.scene.meta->error_max_m);
    crt_close(&rig);
}

/* Where voxels have samples of their own: an error that goes with the square of their intervals, and gradients of the ball. */
static void field_takes_the_samples_of_fine_voxels(void **state) {
    (void)state;
    crt_solid ball = crt_ball(10e-3);
    const double low[3] = {-11e-3, -11e-3, -11e-3}, high[3] = {11e-3, 11e-3, 11e-3};
    double error[2];
    for (int fine = 0; fine < 2; fine++) {
        crt_rig rig;
        int compared = 0;
        ball.fine = fine;
        open_with_cube(&rig, &ball);
        error[fine] = largest_error(&rig, &ball, low, high, 0.02e-3, &compared);
        assert_true(compared > 20);
        crt_close(&rig);
    }
    assert_true(error[1] < 0.3 * error[0]);
}

static void field_has_the_slope_of_fine_voxels(void **state) {
    (void)state;
    crt_solid ball = crt_ball(10e-3);
    crt_rig rig;
    ball.fine = 1;
    open_with_cube(&rig, &ball);
    uint64_t seed = 5u;
    for (int n = 0; n < 100; n++) {
        float p[CR_LANES][3];
        cr_lookup at;
        for (int i = 0; i < CR_LANES; i++) {
            const cr_quat q = crt_random_rotation(&seed);
            const float size = 10e-3f / sqrtf(q.x * q.x + q.y * q.y + q.z * q.z);
            p[i][0] = q.x * size;
            p[i][1] = q.y * size;
            p[i][2] = q.z * size;
        }
        look_up(&rig, (const float(*)[3])p, &at);
        for (int i = 0; i < CR_LANES; i++) {
            const float along = (at.gx[i] * p[i][0] + at.gy[i] * p[i][1] + at.gz[i] * p[i][2]) / 10e-3f;
            assert_true(fabsf(along - 1.0f) < 0.08f); /* samples twice too far apart: 1.0 */
        }
    }
    crt_close(&rig);
}

static void field_gradient_is_the_facet_normal_on_a_face(void **state) {
    (void)state;
    crt_solid wedge = crt_wedge(70.0 * PI / 180.0, 40e-3, 30e-3);
    crt_rig rig;
    cr_lookup at;
    double n[4];
    float p[CR_LANES][3];
    open_with_cube(&rig, &wedge);
    crt_plane(&wedge, 1, n);
    for (int i = 0; i < CR_LANES; i++) {
        /* Along the middle of the right face, from 2 mm inside to 2 mm outside. */
        double height = -2e-3 + 4e-3 * i / (CR_LANES - 1);
        p[i][0] = (float)(20e-3 * tan(35.0 * PI / 180.0) + height * n[0]);
        p[i][1] = 1e-3f;
        p[i][2] = (float)(-20e-3 + height * n[2]);
    }
    look_up(&rig, (const float(*)[3])p, &at);
    for (int i = 0; i < CR_LANES; i++) {
        assert_true(fabs((double)at.gx[i] - n[0]) < 2e-3 && fabs((double)at.gz[i] - n[2]) < 2e-3);
        assert_true(fabs((double)at.gy[i]) < 2e-3);
        assert_int_equal(rig.scene.kinds[cr_field_kind(&rig.field, &at, i)].kind, CR_KIND_PLANAR);
        assert_int_equal(rig.scene.kinds[cr_field_kind(&rig.field, &at, i)].facet[0], 1);
    }
    crt_close(&rig);
}

static void field_gradient_points_away_from_the_nearest_point_of_an_edge(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    cr_lookup at;
    float p[CR_LANES][3];
    open_with_cube(&rig, &block);
    for (int i = 0; i < CR_LANES; i++) {
        double turn = (0.05 + 0.9 * i / (CR_LANES - 1)) * PI / 2.0;
        p[i][0] = (float)(1.5e-3 * cos(turn));
        p[i][1] = 3e-3f;
        p[i][2] = (float)(1.5e-3 * sin(turn));
    }
    look_up(&rig, (const float(*)[3])p, &at);
    for (int i = 0; i < CR_LANES; i++) {
        assert_true(fabsf(at.gx[i] - p[i][0] / 1.5e-3f) < 1e-5f && fabsf(at.gz[i] - p[i][2] / 1.5e-3f) < 1e-5f);
        assert_true((at.from_facet >> i) & 1u);
        /* Facet 1 is +x, facet 2 is +z. */
        assert_int_equal(at.facet[i], p[i][0] > p[i][2] ? 1 : 2);
    }
    crt_close(&rig);
}

/* Far bricks: the sign is right and |phi| never says more than the true distance; outside the grid the way to it is added. */
static void check_bounds(const crt_solid *solid, double reach) {
    crt_rig rig;
    uint64_t seed = 9u;
    int far = 0;
    open_with_cube(&rig, solid);
    double quantum = (double)rig.scene.meta->quantum_m;
    for (int n = 0; n < POINTS / CR_LANES; n++) {
        float p[CR_LANES][3];
        cr_lookup at;
        for (int i = 0; i < CR_LANES; i++) {
            for (int a = 0; a < 3; a++) {
                p[i][a] = (float)crt_uniform(&seed, -reach, reach);
            }
        }
        look_up(&rig, (const float(*)[3])p, &at);
        for (int i = 0; i < CR_LANES; i++) {
            double exact = distance_at(solid, p[i]), phi = (double)at.phi_m[i];
            if (at.entry[i] & CR_TOP_FAR) {
                far++;
                assert_true(phi * exact >= 0.0);
                assert_true(fabs(phi) <= fabs(exact) * (1.0 + 1e-6) + 1e-7);
                assert_true(at.gx[i] == 0.0f && at.gy[i] == 0.0f && at.gz[i] == 0.0f);
                assert_int_equal(cr_field_kind(&rig.field, &at, i), 0);
            } else {
                assert_true(fabs(phi - exact) <
                            (fabs(exact) < 3e-3 ? 2.0 * quantum : (double)rig.scene.meta->error_out_m));
            }
        }
    }
    assert_true(far > 100);
    crt_close(&rig);
}

static void field_far_bricks_give_lower_bounds(void **state) {
    (void)state;
    crt_solid block = crt_box(-60e-3, 60e-3, 50e-3, -90e-3, 0.0), room = crt_room(-60e-3, 60e-3, 50e-3, -90e-3, 0.0);
    check_bounds(&block, 0.14);
    check_bounds(&room, 0.14);
}

static void field_adds_the_way_to_the_grid_outside_of_it(void **state) {
    (void)state;
    crt_solid block = crt_box(-10e-3, 10e-3, 10e-3, -20e-3, 0.0);
    crt_rig rig;
    cr_lookup edge, away;
    float at_edge[CR_LANES][3], beyond[CR_LANES][3];
    open_with_cube(&rig, &block);
    const struct cr_img_meta *m = rig.scene.meta;
    float high_x = m->origin_m[0] + (float)m->dims[0] * m->brick_m;
    for (int i = 0; i < CR_LANES; i++) {
        float way = 0.01f * (float)(1 << i);
        at_edge[i][0] = high_x - 1e-6f;
        beyond[i][0] = high_x + way;
        at_edge[i][1] = beyond[i][1] = 1e-3f;
        at_edge[i][2] = beyond[i][2] = -5e-3f;
    }
    look_up(&rig, (const float(*)[3])at_edge, &edge);
    look_up(&rig, (const float(*)[3])beyond, &away);
    for (int i = 0; i < CR_LANES; i++) {
        float way = 0.01f * (float)(1 << i);
        assert_true(fabsf(away.phi_m[i] - edge.phi_m[i] - way) < 1e-5f * way + 1e-5f);
        assert_true((double)away.phi_m[i] <= distance_at(&block, beyond[i]) * (1.0 + 1e-6));
    }
    crt_close(&rig);
}

static void field_takes_points_at_the_end_of_the_world(void **state) {
    (void)state;
    crt_solid block = crt_box(-10e-3, 10e-3, 10e-3, -20e-3, 0.0);
    crt_rig rig;
    cr_lookup at;
    float p[CR_LANES][3];
    open_with_cube(&rig, &block);
    for (int i = 0; i < CR_LANES; i++) {
        for (int a = 0; a < 3; a++) {
            p[i][a] = (i >> a) & 1 ? 2e4f : -2e4f;
        }
    }
    look_up(&rig, (const float(*)[3])p, &at);
    for (int i = 0; i < CR_LANES; i++) {
        assert_true(at.phi_m[i] > 3e4f && is_finite_f(at.phi_m[i]));
    }
    crt_close(&rig);
}

static void field_places_every_lane_by_itself(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    cr_lookup many, one;
    uint64_t seed = 21u;
    float p[CR_LANES][3], same[CR_LANES][3];
    open_with_cube(&rig, &block);
    for (int round = 0; round < 50; round++) {
        for (int i = 0; i < CR_LANES; i++) {
            for (int a = 0; a < 3; a++) {
                p[i][a] = (float)crt_uniform(&seed, -60e-3, 30e-3);
            }
        }
        look_up(&rig, (const float(*)[3])p, &many);
        for (int i = 0; i < CR_LANES; i++) {
            for (int k = 0; k < CR_LANES; k++) {
                memcpy(same[k], p[i], sizeof same[k]);
            }
            look_up(&rig, (const float(*)[3])same, &one);
            assert_memory_equal(&one.phi_m[7], &many.phi_m[i], sizeof(float));
            assert_memory_equal(&one.gz[7], &many.gz[i], sizeof(float));
        }
    }
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(field_is_exact_to_quantisation_on_a_plane),
        cmocka_unit_test(field_is_exact_at_a_convex_edge),
        cmocka_unit_test(field_is_exact_at_a_convex_vertex),
        cmocka_unit_test(field_is_exact_at_sharp_and_blunt_wedges),
        cmocka_unit_test(field_is_exact_at_a_concave_edge),
        cmocka_unit_test(field_is_exact_at_a_concave_vertex),
        cmocka_unit_test(field_stays_within_its_stated_error_on_a_ball),
        cmocka_unit_test(field_takes_the_samples_of_fine_voxels),
        cmocka_unit_test(field_has_the_slope_of_fine_voxels),
        cmocka_unit_test(field_gradient_is_the_facet_normal_on_a_face),
        cmocka_unit_test(field_gradient_points_away_from_the_nearest_point_of_an_edge),
        cmocka_unit_test(field_far_bricks_give_lower_bounds),
        cmocka_unit_test(field_adds_the_way_to_the_grid_outside_of_it),
        cmocka_unit_test(field_takes_points_at_the_end_of_the_world),
        cmocka_unit_test(field_places_every_lane_by_itself),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
