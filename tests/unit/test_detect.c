/* Detection: every skip changes the work and nothing else; coverage is that of the definition; capacities are counted. */
#include "contact/way_out.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define RANDOM_POSES 3000
#define WALK_TICKS 20000

static cr_contact_set sets[2];

/* One detection with its own odometers. */
typedef struct {
    cr_motion motion;
    cr_descent search;
    cr_detect_options options;
    cr_stats stats;
    cr_contact_set *set;
} detector;

static detector make_detector(const crt_rig *rig, uint32_t skip, uint32_t coverage, cr_contact_set *set) {
    detector d;
    memset(&d, 0, sizeof d);
    d.motion.wake_count = rig->scene.group_count * CR_LANES;
    d.motion.wake_m = calloc(d.motion.wake_count, sizeof(float));
    d.options.skip = skip;
    d.options.coverage = coverage;
    d.options.lookups_max = UINT32_MAX;
    d.options.slices_max = CR_SEARCH_TICKS_MAX;
    d.set = set;
    return d;
}

static void detect(detector *d, const crt_rig *rig, const cr_pose *pose) {
    xform now = cr_xform_from_pose(pose);
    memset(&d->stats, 0, sizeof d->stats);
    cr_motion_advance(&d->motion, pose);
    assert_true(cr_detect(&rig->field, &now, &d->options, &d->motion, &d->search, d->set, &d->stats));
}

static int same_sets(const detector *a, const detector *b) {
    const cr_contact_set *s = a->set, *t = b->set;
    if (s->hit_count != t->hit_count || s->way.count != t->way.count || s->contacts != t->contacts) {
        return 0;
    }
    for (uint32_t i = 0; i < s->hit_count; i++) {
        const cr_hit *p = &s->hits[i], *q = &t->hits[i];
        if (p->cluster != q->cluster || p->covered != q->covered || p->inside != q->inside || p->near != q->near ||
            p->planes != q->planes || p->facet != q->facet) {
            return 0;
        }
    }
    return memcmp(s->way.zones, t->way.zones, s->way.count * sizeof *s->way.zones) == 0 &&
           memcmp(s->way.reach, t->way.reach, s->hit_count * sizeof *s->way.reach) == 0;
}

static void open_cube_on(crt_rig *rig, const crt_solid *solid) {
    const double centre[3] = {2e-3, 0.0, 1e-3}, half[3] = {12e-3, 9e-3, 7e-3};
    crt_tool tool = crt_tool_new(1.5e-3);
    crt_add_box(&tool, centre, half);
    crt_open(rig, solid, &tool, VOXEL_M, NULL);
    crt_tool_free(&tool);
}

static void open_ball_on(crt_rig *rig, const crt_solid *solid) {
    crt_tool tool = crt_tool_new(1.2e-3);
    crt_add_ball(&tool, 9e-3);
    crt_open(rig, solid, &tool, VOXEL_M, NULL);
    crt_tool_free(&tool);
}

static cr_pose random_pose(uint64_t *seed, double reach) {
    cr_pose p =
        crt_pose(crt_uniform(seed, -reach, reach), crt_uniform(seed, -reach, reach), crt_uniform(seed, -reach, reach));
    p.rot = crt_random_rotation(seed);
    return p;
}

static void check_skips(const crt_rig *rig, uint32_t skip, uint32_t coverage) {
    detector with = make_detector(rig, skip, coverage, &sets[0]);
    detector without = make_detector(rig, 0u, coverage, &sets[1]);
    uint64_t seed = 77u + skip;
    uint32_t touching = 0u;
    for (int i = 0; i < RANDOM_POSES / 7; i++) {
        cr_pose pose = random_pose(&seed, 30e-3);
        detect(&with, rig, &pose);
        detect(&without, rig, &pose);
        if (!same_sets(&with, &without)) {
            fail_msg("skip %u, coverage %u, pose %d: not the same", skip, coverage, i);
        }
        touching += with.set->hit_count > 0u;
    }
    assert_true(touching > 100u);
    free(with.motion.wake_m);
    free(without.motion.wake_m);
}

static void detect_is_the_same_for_every_subset_of_skips(void **state) {
    (void)state;
    crt_solid solids[] = {crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0), crt_room(-15e-3, 15e-3, 20e-3, -20e-3, 20e-3),
                          crt_wedge(1.0, 30e-3, 20e-3), crt_ball(20e-3)};
    for (size_t i = 0; i < sizeof solids / sizeof *solids; i++) {
        crt_rig rig;
        if (i % 2u == 0u) {
            open_cube_on(&rig, &solids[i]);
        } else {
            open_ball_on(&rig, &solids[i]);
        }
        for (uint32_t skip = 1u; skip <= CR_SKIP_ALL; skip++) {
            check_skips(&rig, skip, i < 2u ? CR_COVERAGE_SOFT : CR_COVERAGE_HARD);
        }
        crt_close(&rig);
    }
}

static void detect_over_planes_is_the_same_for_every_subset_of_skips(void **state) {
    (void)state;
    crt_solid solids[] = {crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0), crt_room(-15e-3, 15e-3, 20e-3, -20e-3, 20e-3),
                          crt_wedge(1.0, 30e-3, 20e-3)};
    for (size_t i = 0; i < sizeof solids / sizeof *solids; i++) {
        crt_rig rig;
        open_cube_on(&rig, &solids[i]);
        crt_mark_planes(&rig);
        for (uint32_t skip = 1u; skip <= CR_SKIP_ALL; skip++) {
            check_skips(&rig, skip, skip % 2u == 0u ? CR_COVERAGE_SOFT : CR_COVERAGE_HARD);
        }
        crt_close(&rig);
    }
}

static void detect_sleeps_and_wakes_rightly_on_a_long_walk(void **state) {
    (void)state;
    crt_solid block = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    crt_rig rig;
    open_cube_on(&rig, &block);
    detector with = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    detector without = make_detector(&rig, 0u, CR_COVERAGE_SOFT, &sets[1]);
    uint64_t seed = 4u, slept = 0u, nodes = 0u, touching = 0u;
    cr_pose pose = crt_pose(0.0, 0.0, 15e-3);
    double velocity[3] = {0.0, 0.0, 0.0}, axis[3] = {0.0, 0.0, 1.0}, angle = 0.0;
    for (int i = 0; i < WALK_TICKS; i++) {
        double *p[3] = {&velocity[0], &velocity[1], &velocity[2]};
        const float at[3] = {pose.pos_m.x, pose.pos_m.y, pose.pos_m.z};
        for (int a = 0; a < 3; a++) {
            /* Pulled to the edge, kicked about: now 0.2 mm, now 0.001 mm a tick. */
            *p[a] = 0.98 * *p[a] - 2e-4 * ((double)at[a] - (a == 2 ? 8e-3 : 0.0)) + crt_uniform(&seed, -2e-5, 2e-5);
            axis[a] += crt_uniform(&seed, -0.02, 0.02);
        }
        angle += 2e-3 * sin(0.002 * i);
        pose.pos_m = v3_add(pose.pos_m, v3((float)velocity[0], (float)velocity[1], (float)velocity[2]));
        pose.rot = crt_turn(axis[0], axis[1], axis[2], angle);
        detect(&with, &rig, &pose);
        detect(&without, &rig, &pose);
        if (!same_sets(&with, &without)) {
            fail_msg("tick %d: not the same", i);
        }
        slept += with.stats.nodes_coherent;
        nodes += with.stats.nodes;
        touching += with.set->hit_count > 0u;
    }
    assert_true(touching > WALK_TICKS / 10 && touching < WALK_TICKS);
    assert_true(slept > nodes / 4u);
    free(with.motion.wake_m);
    free(without.motion.wake_m);
    crt_close(&rig);
}

static void detect_costs_no_points_in_free_space(void **state) {
    (void)state;
    crt_solid block = crt_box(-25e-3, 25e-3, 20e-3, -25e-3, 0.0);
    crt_rig rig;
    open_cube_on(&rig, &block);
    detector d = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    uint64_t seed = 31u;
    for (int i = 0; i < 500; i++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, -0.03, 0.03), crt_uniform(&seed, -0.03, 0.03), crt_uniform(&seed, 0.05, 2.0));
        pose.rot = crt_random_rotation(&seed);
        detect(&d, &rig, &pose);
        assert_int_equal(d.set->hit_count, 0);
        assert_int_equal(d.stats.points, 0);
        assert_true(d.stats.nodes <= 1u || pose.pos_m.z < 0.1f);
    }
    free(d.motion.wake_m);
    crt_close(&rig);
}

static void detect_looks_at_no_point_while_the_tool_rests_in_free_space(void **state) {
    (void)state;
    crt_solid block = crt_box(-25e-3, 25e-3, 20e-3, -25e-3, 0.0);
    crt_rig rig;
    open_cube_on(&rig, &block);
    detector d = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    /* 2 mm over the block: the tree has to be walked once. */
    cr_pose pose = crt_pose(0.0, 0.0, 8e-3);
    detect(&d, &rig, &pose);
    uint32_t first = d.stats.nodes;
    assert_true(first > 1u);
    for (int i = 0; i < 100; i++) {
        detect(&d, &rig, &pose);
        assert_int_equal(d.stats.points, 0);
        assert_true(d.stats.nodes < first && d.stats.nodes_coherent > 0u);
    }
    free(d.motion.wake_m);
    crt_close(&rig);
}

/* A cube face-on in a wall: all its face inside, the sides by the part below the wall; what pushes is the face times the depth. */
static void detect_coverage_of_a_face_is_exact(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    crt_open_cube(&rig, &block, 8e-3, 2e-3, VOXEL_M);
    detector d = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    for (int i = 1; i < 8; i++) {
        double depth = 1e-3 + 0.7e-3 * i, push = 0.0, area = 0.0;
        cr_pose pose = crt_pose(0.0, 0.0, 8e-3 - depth);
        detect(&d, &rig, &pose);
        for (uint32_t z = 0; z < d.set->way.count; z++) {
            push += (double)d.set->way.zones[z].push_m3.z;
            area += (double)d.set->way.zones[z].area_m2;
        }
        /* Edges and vertices have a thousandth of a sample each; distances are rounded to a quantum. */
        assert_true(fabs(push - 256e-6 * depth) < 256e-6 * (1e-6 + 2e-3 * depth));
        if (!(fabs(area - (256e-6 + 64e-3 * depth)) < 64e-3 * 1e-5)) {
            fail_msg("depth %g m: area %g, expected %g", depth, area, 256e-6 + 64e-3 * depth);
        }
    }
    free(d.motion.wake_m);
    crt_close(&rig);
}

static void detect_counts_the_points_inside(void **state) {
    (void)state;
    crt_solid block = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    crt_rig rig;
    open_cube_on(&rig, &block);
    detector d = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    uint64_t seed = 8u;
    for (int i = 0; i < 300; i++) {
        cr_pose pose = random_pose(&seed, 20e-3);
        xform now = cr_xform_from_pose(&pose);
        uint32_t least = 0u, most = 0u;
        detect(&d, &rig, &pose);
        for (uint32_t c = 0; c < rig.scene.cluster_count; c++) {
            for (uint32_t k = 0; k < rig.scene.clusters[c].count; k++) {
                const struct cr_img_cluster *cl = &rig.scene.clusters[c];
                cr_vec3 p = cr_xform_point(&now, v3(cl->x[k], cl->y[k], cl->z[k]));
                const double q[3] = {(double)p.x, (double)p.y, (double)p.z};
                double exact = crt_distance(&block, q), margin = (double)rig.scene.meta->quantum_m + 1e-7;
                least += exact < -margin;
                most += exact < margin;
            }
        }
        assert_in_range(d.set->contacts, least, most);
    }
    free(d.motion.wake_m);
    crt_close(&rig);
}

static void detect_hits_are_in_ascending_order_of_clusters(void **state) {
    (void)state;
    crt_solid room = crt_room(-15e-3, 15e-3, 20e-3, -20e-3, 20e-3);
    crt_rig rig;
    open_cube_on(&rig, &room);
    detector d = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    uint64_t seed = 15u;
    for (int i = 0; i < 200; i++) {
        cr_pose pose = random_pose(&seed, 12e-3);
        detect(&d, &rig, &pose);
        for (uint32_t h = 1; h < d.set->hit_count; h++) {
            assert_true(d.set->hits[h - 1u].cluster < d.set->hits[h].cluster);
        }
        for (uint32_t z = 0; z < d.set->way.count; z++) {
            assert_true(d.set->way.zones[z].deep_hit < d.set->hit_count);
        }
    }
    free(d.motion.wake_m);
    crt_close(&rig);
}

/* What a hit says that all its lanes are over, so that they need not be looked up again, is what a lookup says: one facet, or one cell of planes. */
static void detect_knows_what_all_lanes_of_a_hit_are_over(void **state) {
    (void)state;
    crt_solid solids[] = {crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0), crt_room(-15e-3, 15e-3, 20e-3, -20e-3, 20e-3)};
    for (size_t k = 0; k < sizeof solids / sizeof *solids; k++) {
        crt_rig rig;
        open_cube_on(&rig, &solids[k]);
        detector d = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
        uint64_t seed = 23u;
        uint32_t facets = 0u, cells = 0u;
        for (int i = 0; i < 300; i++) {
            const cr_pose pose = random_pose(&seed, 20e-3);
            const xform now = cr_xform_from_pose(&pose);
            detect(&d, &rig, &pose);
            for (uint32_t h = 0; h < d.set->hit_count; h++) {
                const cr_hit *hit = &d.set->hits[h];
                const struct cr_img_cluster *c = &rig.scene.clusters[hit->cluster];
                const uint32_t lanes = (uint32_t)(hit->covered | hit->near) & first_lanes(c->count);
                cr_lanes3 world;
                cr_lookup look;
                cr_lanes_to_world(&now, c->x, c->y, c->z, &world);
                cr_field_look_up_lanes(&rig.field, &world, lanes, &look);
                if (hit->facet != CR_FACET_NONE && lanes != 0u) {
                    assert_int_equal(cr_way_common(&rig.field, &look, lanes), hit->facet);
                    facets++;
                }
                for (uint32_t left = hit->planes != 0u ? lanes : 0u; left != 0u; cells++) {
                    const int lane = take_lane(&left);
                    assert_true(has_lane(look.on_planes, lane));
                    assert_int_equal(look.kind[lane], hit->planes);
                }
            }
        }
        assert_true(facets > 100u && cells > 100u);
        free(d.motion.wake_m);
        crt_close(&rig);
    }
}

/* A cube of 31,000 samples swallowed by the block: more clusters than fit. */
static void detect_counts_what_exceeds_its_capacities(void **state) {
    (void)state;
    crt_solid block = crt_box(-60e-3, 60e-3, 60e-3, -120e-3, 0.0);
    crt_rig rig;
    crt_open_cube(&rig, &block, 36e-3, 1e-3, 4e-3);
    assert_true(rig.scene.cluster_count > CR_CLUSTERS_MAX + 1000u);
    for (uint32_t skip = 0u; skip <= CR_SKIP_ALL; skip += CR_SKIP_ALL) {
        cr_config config = cr_config_default();
        config.skip = skip;
        crt_restart(&rig, &config);
        uint32_t most = 0u, dropped = 0u, late = 0u;
        for (int i = 0; i < 40; i++) {
            cr_pose pose = crt_pose(0.0, 0.0, 40e-3 - 3e-3 * i);
            pose.rot = crt_turn(1.0, 0.3, 0.2, 0.05 * i);
            cr_output out;
            cr_tick(rig.world, &pose, 1e-3f, &out);
            assert_true(crt_is_sound(&out, &config));
            assert_true(out.stats.clusters <= CR_CLUSTERS_MAX);
            assert_true(out.stats.points <= CR_LOOKUPS_MAX * CR_LANES);
            most = out.stats.clusters > most ? out.stats.clusters : most;
            dropped += out.stats.clusters_dropped;
            late += out.stats.late_ticks;
        }
        assert_int_equal(most, CR_CLUSTERS_MAX);
        assert_true(dropped > 0u);
        assert_true(skip != 0u || late > 0u);
    }
    crt_close(&rig);
}

static cr_motion make_motion(float *wake, uint32_t count) {
    cr_motion m;
    memset(&m, 0, sizeof m);
    m.wake_m = wake;
    m.wake_count = count;
    return m;
}

static void detect_odometers_bound_the_motion_of_every_point(void **state) {
    (void)state;
    float wake[CR_LANES];
    cr_motion m = make_motion(wake, CR_LANES);
    uint64_t seed = 12u;
    cr_pose before = random_pose(&seed, 0.1);
    cr_motion_advance(&m, &before);
    for (int i = 0; i < 2000; i++) {
        cr_pose now = before;
        float slide = m.slide_m, turn = m.turn_rad;
        cr_quat step =
            crt_turn(crt_uniform(&seed, -1, 1), crt_uniform(&seed, -1, 1), 1.0, crt_uniform(&seed, 0.0, 0.2));
        cr_quat q = before.rot;
        now.rot = (cr_quat){step.w * q.w - step.x * q.x - step.y * q.y - step.z * q.z,
                            step.w * q.x + step.x * q.w + step.y * q.z - step.z * q.y,
                            step.w * q.y - step.x * q.z + step.y * q.w + step.z * q.x,
                            step.w * q.z + step.x * q.y - step.y * q.x + step.z * q.w};
        if (i % 2) {
            now.rot = (cr_quat){-now.rot.w, -now.rot.x, -now.rot.y, -now.rot.z};
        }
        now.pos_m = v3_add(now.pos_m, v3((float)crt_uniform(&seed, -2e-3, 2e-3), 0.0f, 1e-3f));
        cr_motion_advance(&m, &now);
        if (m.slide_m < slide) {
            before = now;
            continue; /* rebased */
        }
        cr_vec3 p = v3((float)crt_uniform(&seed, -0.1, 0.1), (float)crt_uniform(&seed, -0.1, 0.1), 0.05f);
        xform a = cr_xform_from_pose(&before), b = cr_xform_from_pose(&now);
        float moved = v3_norm(v3_sub(cr_xform_point(&b, p), cr_xform_point(&a, p)));
        assert_true(moved <= m.slide_m - slide + (m.turn_rad - turn) * v3_norm(p) + 2e-6f);
        before = now;
    }
}

static void detect_odometers_start_again_before_they_lose_precision(void **state) {
    (void)state;
    float wake[CR_LANES];
    cr_motion m = make_motion(wake, CR_LANES);
    cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    int rebased = 0;
    float most = 0.0f;
    cr_motion_advance(&m, &pose);
    for (int i = 1; i < 4000; i++) {
        m.stale = 0u;
        pose.pos_m.x = i % 2 ? 0.01f : 0.0f;
        cr_motion_advance(&m, &pose);
        most = max_f(most, m.slide_m);
        if (m.slide_m == 0.0f) {
            rebased++;
            /* All that slept wakes: no wake-up distance survives its odometer. */
            assert_true(m.stale == 1u && m.root_wake_m <= 0.0f);
        }
    }
    assert_true(rebased >= 3 && rebased <= 40);
    assert_true(most < 16.0f);
}

/* Steps below the last bit of an odometer that has come far: each alone would be lost, and the tool creep into what sleeps. */
static void detect_odometers_miss_no_creep(void **state) {
    (void)state;
    float wake[CR_LANES];
    cr_motion m = make_motion(wake, CR_LANES);
    cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    cr_motion_advance(&m, &pose);
    for (int i = 1; i <= 300; i++) {
        pose.pos_m.x = i % 2 ? 0.01f : 0.0f;
        pose.rot = crt_turn(0.0, 0.0, 1.0, i % 2 ? 0.01 : 0.0);
        cr_motion_advance(&m, &pose);
    }
    const float slide_m = m.slide_m, turn_rad = m.turn_rad;
    assert_true(slide_m > 2.9f && turn_rad > 2.9f);
    const int steps = 50000;
    for (int i = 1; i <= steps; i++) {
        pose.pos_m.x = (float)(1e-7 * i);
        pose.rot.z = (float)(0.5e-7 * i);
        cr_motion_advance(&m, &pose);
    }
    assert_float_equal(m.slide_m - slide_m, 1e-7f * (float)steps, 1e-5f);
    assert_float_equal(m.turn_rad - turn_rad, 1e-7f * (float)steps, 1e-5f);
}

/* A sphere that touches wakes when the odometer stands where it stood: one bit back, and it sleeps. */
static void detect_odometers_never_turn_back(void **state) {
    (void)state;
    float wake[CR_LANES];
    uint64_t seed = 21u;
    uint32_t rests = 0u;
    cr_motion m = make_motion(wake, CR_LANES);
    for (int i = 0; i < 20000; i++) {
        const cr_pose pose = random_pose(&seed, i % 2 ? 0.01 : 1e-5);
        cr_motion_advance(&m, &pose);
        for (int k = 0; k < 3; k++) {
            const float slide_m = m.slide_m, turn_rad = m.turn_rad;
            cr_motion_advance(&m, &pose); /* at rest */
            assert_true(m.slide_m >= slide_m && m.turn_rad >= turn_rad);
            rests++;
        }
    }
    assert_true(rests > 50000u);
}

static void detect_forgets_everything_on_its_first_pose(void **state) {
    (void)state;
    float wake[CR_LANES];
    cr_motion m = make_motion(wake, CR_LANES);
    m.root_wake_m = 1e9f;
    cr_pose pose = crt_pose(1.0, 2.0, 3.0);
    cr_motion_advance(&m, &pose);
    assert_true(m.slide_m == 0.0f && m.turn_rad == 0.0f && m.root_wake_m <= 0.0f && m.stale == 1u);
}

static void detect_is_the_same_across_a_leap(void **state) {
    (void)state;
    crt_solid block = crt_box(-25e-3, 0.0, 20e-3, -25e-3, 0.0);
    crt_rig rig;
    open_cube_on(&rig, &block);
    detector with = make_detector(&rig, CR_SKIP_ALL, CR_COVERAGE_SOFT, &sets[0]);
    detector without = make_detector(&rig, 0u, CR_COVERAGE_SOFT, &sets[1]);
    for (int i = 0; i < 40; i++) {
        /* From the far end of the position range into contact and back. */
        cr_pose pose = i % 2 ? crt_pose(-5e-3, 0.0, 4e-3 + 1e-5 * i) : crt_pose(i % 4 ? 9e3 : 1.0, -3.0 * i, 5.0);
        detect(&with, &rig, &pose);
        detect(&without, &rig, &pose);
        assert_true(same_sets(&with, &without));
        assert_int_equal(with.set->hit_count > 0u, i % 2);
    }
    free(with.motion.wake_m);
    free(without.motion.wake_m);
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(detect_is_the_same_for_every_subset_of_skips),
        cmocka_unit_test(detect_over_planes_is_the_same_for_every_subset_of_skips),
        cmocka_unit_test(detect_sleeps_and_wakes_rightly_on_a_long_walk),
        cmocka_unit_test(detect_costs_no_points_in_free_space),
        cmocka_unit_test(detect_looks_at_no_point_while_the_tool_rests_in_free_space),
        cmocka_unit_test(detect_coverage_of_a_face_is_exact),
        cmocka_unit_test(detect_counts_the_points_inside),
        cmocka_unit_test(detect_hits_are_in_ascending_order_of_clusters),
        cmocka_unit_test(detect_knows_what_all_lanes_of_a_hit_are_over),
        cmocka_unit_test(detect_counts_what_exceeds_its_capacities),
        cmocka_unit_test(detect_odometers_bound_the_motion_of_every_point),
        cmocka_unit_test(detect_odometers_miss_no_creep),
        cmocka_unit_test(detect_odometers_never_turn_back),
        cmocka_unit_test(detect_odometers_start_again_before_they_lose_precision),
        cmocka_unit_test(detect_forgets_everything_on_its_first_pose),
        cmocka_unit_test(detect_is_the_same_across_a_leap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
