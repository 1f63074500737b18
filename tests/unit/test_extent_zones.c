/* Contact areas are connected pieces of tool, contact zones smooth pieces of the static surface. */
#include "image_builder.h"
#include "rivals/extent.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3

#define LOOKUPS 32u

static cr_contact_set set, pieces;
static cr_area_set areas;
static cr_stats stats;

static void open_boxes(crt_rig *rig, const crt_solid *solid, const double boxes[][6], int count) {
    crt_tool tool = crt_tool_new(1.5e-3);
    for (int i = 0; i < count; i++) {
        crt_add_box(&tool, boxes[i], boxes[i] + 3);
    }
    crt_open(rig, solid, &tool, VOXEL_M, NULL);
    crt_tool_free(&tool);
}

static void group(const crt_rig *rig, const cr_pose *pose) {
    crt_find_areas(rig, pose, 0u, CR_COVERAGE_SOFT, &set, &areas, &stats);
}

static const cr_zone *zone_on(const cr_area_work *area, uint32_t patch) {
    for (uint32_t z = 0; z < area->zone_count; z++) {
        if (area->zones[z].patch == patch) {
            return &area->zones[z];
        }
    }
    return NULL;
}

static const double one_box[1][6] = {{0.0, 0.0, 0.0, 8e-3, 8e-3, 8e-3}};
static const double two_boxes[2][6] = {{-14e-3, 0.0, 0.0, 6e-3, 6e-3, 6e-3}, {14e-3, 0.0, 2e-3, 6e-3, 6e-3, 6e-3}};

static void zones_one_piece_of_tool_is_one_area(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 30e-3, -40e-3, 0.0);
    crt_rig rig;
    cr_pose pose = crt_pose(0.0, 0.0, 5e-3);
    open_boxes(&rig, &block, one_box, 1);
    group(&rig, &pose);
    assert_int_equal(areas.count, 1);
    assert_int_equal(areas.areas[0].zone_count, 1);
    for (uint32_t i = 0; i < set.hit_count; i++) {
        assert_int_equal(set.hits[i].area, 0);
    }
    crt_close(&rig);
}

static void zones_two_pieces_of_tool_are_two_areas(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 30e-3, -40e-3, 0.0);
    crt_rig rig;
    open_boxes(&rig, &block, two_boxes, 2);
    cr_pose high = crt_pose(0.0, 0.0, 5e-3), low = crt_pose(0.0, 0.0, 2e-3), free_pose = crt_pose(0.0, 0.0, 20e-3);
    group(&rig, &high);
    assert_int_equal(areas.count, 1);
    group(&rig, &low);
    assert_int_equal(areas.count, 2);
    /* The first box comes first; the second is less deep by 2 mm on four sides of 12 mm. */
    double less = (double)(areas.areas[0].sum.area - areas.areas[1].sum.area);
    assert_true(fabs(less - 4 * 12e-3 * 2e-3) < 0.02 * 4 * 12e-3 * 2e-3);
    group(&rig, &free_pose);
    assert_int_equal(areas.count, 0);
    crt_close(&rig);
}

/* Neighbours that are covered where they meet. */
static int are_joined(const cr_scene *s, const cr_hit *a, const cr_hit *b) {
    for (uint32_t k = s->adj_start[a->cluster]; k < s->adj_start[a->cluster + 1u]; k++) {
        const struct cr_img_neighbour *beside = &s->adj[k];
        if (beside->cluster == b->cluster && (beside->mine & a->covered) && (beside->theirs & b->covered)) {
            return 1;
        }
    }
    return 0;
}

/* Same components as a plain flood over the hits. */
static void zones_areas_are_the_connected_components_of_the_hits(void **state) {
    (void)state;
    crt_solid room = crt_room(-18e-3, 18e-3, 14e-3, -14e-3, 14e-3);
    crt_rig rig;
    uint64_t seed = 2u;
    uint32_t several = 0u;
    open_boxes(&rig, &room, two_boxes, 2);
    const cr_scene *s = &rig.scene;
    for (int n = 0; n < 300; n++) {
        cr_pose pose =
            crt_pose(crt_uniform(&seed, -4e-3, 4e-3), crt_uniform(&seed, -6e-3, 6e-3), crt_uniform(&seed, -6e-3, 6e-3));
        pose.rot = crt_random_rotation(&seed);
        group(&rig, &pose);
        uint32_t label[CR_CLUSTERS_MAX], found = 0u;
        for (uint32_t i = 0; i < set.hit_count; i++) {
            label[i] = i;
        }
        for (int changed = 1; changed;) {
            changed = 0;
            for (uint32_t i = 0; i < set.hit_count; i++) {
                for (uint32_t j = 0; j < set.hit_count; j++) {
                    if (label[j] > label[i] && are_joined(s, &set.hits[i], &set.hits[j])) {
                        label[j] = label[i];
                        changed = 1;
                    }
                }
            }
        }
        for (uint32_t i = 0; i < set.hit_count; i++) {
            found += label[i] == i;
            for (uint32_t j = 0; j < i; j++) {
                assert_int_equal(label[i] == label[j], set.hits[i].area == set.hits[j].area);
            }
        }
        assert_int_equal(found, areas.count);
        several += found > 1u;
    }
    assert_true(several > 50u);
    crt_close(&rig);
}

static void zones_sums_of_an_area_add_up(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 30e-3, -40e-3, 0.0);
    crt_rig rig;
    cr_pose pose = crt_pose(0.0, 0.0, 2e-3);
    open_boxes(&rig, &block, two_boxes, 2);
    group(&rig, &pose);
    double hits = 0.0, total = 0.0, touched = 0.0, zones = 0.0;
    for (uint32_t i = 0; i < set.hit_count; i++) {
        hits += (double)set.hits[i].sum.area;
    }
    for (uint32_t i = 0; i < set.touch_count; i++) {
        touched += (double)set.touches[i].area_m2;
    }
    for (uint32_t a = 0; a < areas.count; a++) {
        total += (double)areas.areas[a].sum.area;
        for (uint32_t z = 0; z < areas.areas[a].zone_count; z++) {
            zones += (double)areas.areas[a].zones[z].area_m2;
        }
    }
    assert_true(fabs(hits - total) < 1e-5 * total && fabs(touched - zones) < 1e-5 * zones);
    crt_close(&rig);
}

static void zones_there_is_one_per_touched_patch(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 30e-3, -40e-3, 0.0);
    crt_rig rig;
    open_boxes(&rig, &block, one_box, 1);
    /* On the top (facet 2), on the side (facet 1), round the edge, round the vertex (facet 5 is +y). */
    const struct {
        double at[3];
        uint32_t patches[3], count;
    } cases[] = {{{-15e-3, 0.0, 5e-3}, {2}, 1},
                 {{5e-3, 0.0, -15e-3}, {1}, 1},
                 {{5e-3, 0.0, 5e-3}, {1, 2}, 2},
                 {{4e-3, 34e-3, 4e-3}, {1, 2, 5}, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cr_pose pose = crt_pose(cases[i].at[0], cases[i].at[1], cases[i].at[2]);
        group(&rig, &pose);
        assert_int_equal(areas.count, 1);
        assert_int_equal(areas.areas[0].zone_count, cases[i].count);
        for (uint32_t k = 0; k < cases[i].count; k++) {
            assert_non_null(zone_on(&areas.areas[0], cases[i].patches[k]));
        }
    }
    crt_close(&rig);
}

static void zones_planar_zone_has_its_facets_exact_plane(void **state) {
    (void)state;
    crt_solid wedge = crt_wedge(1.1, 40e-3, 30e-3);
    crt_rig rig;
    uint64_t seed = 6u;
    uint32_t seen = 0u;
    open_boxes(&rig, &wedge, one_box, 1);
    for (int n = 0; n < 200; n++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -12e-3, 12e-3), crt_uniform(&seed, -30e-3, 30e-3),
                                crt_uniform(&seed, -10e-3, 8e-3));
        pose.rot = crt_random_rotation(&seed);
        group(&rig, &pose);
        for (uint32_t a = 0; a < areas.count; a++) {
            for (uint32_t z = 0; z < areas.areas[a].zone_count; z++) {
                const cr_zone *zone = &areas.areas[a].zones[z];
                const struct cr_img_facet *facet = &rig.scene.facets[zone->patch];
                assert_memory_equal(&zone->normal_world, facet->normal, sizeof facet->normal);
                assert_memory_equal(&zone->offset_m, &facet->offset_m, sizeof(float));
                assert_int_equal(areas.areas[a].shapes[z].curved, 0);
                seen++;
            }
        }
    }
    assert_true(seen > 200u);
    crt_close(&rig);
}

static void zones_sphere_holds_the_touched_surface(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 30e-3, -40e-3, 0.0);
    crt_rig rig;
    cr_pose pose = crt_pose(3e-3, 2e-3, 6e-3);
    open_boxes(&rig, &block, one_box, 1);
    group(&rig, &pose);
    const cr_zone *zone = &areas.areas[0].zones[0];
    assert_true(fabsf(zone->centre_world_m.x - 3e-3f) < 1e-4f && fabsf(zone->centre_world_m.y - 2e-3f) < 1e-4f);
    assert_true(fabsf(zone->centre_world_m.z) < 1e-5f);
    /* The touched square reaches 8 sqrt 2 mm; the sphere may be larger by the longest cluster, an edge. */
    assert_true(zone->radius_m > 8e-3f * 1.41f - 1.5e-3f && zone->radius_m < 8e-3f * 1.42f + 8e-3f);
    crt_close(&rig);
}

static void zones_curved_zone_points_where_the_surface_points(void **state) {
    (void)state;
    crt_solid ball = crt_ball(20e-3);
    crt_rig rig;
    open_boxes(&rig, &ball, one_box, 1);
    for (int i = 0; i < 12; i++) {
        double turn = 0.5 * i, up[3] = {cos(turn), sin(turn), 0.3}, length = sqrt(1.09);
        cr_pose pose = crt_pose(27e-3 * up[0] / length, 27e-3 * up[1] / length, 27e-3 * up[2] / length);
        /* The same side of the cube towards the ball: turn z to the direction. */
        pose.rot = crt_turn(-up[1], up[0], 0.0, acos(up[2] / length));
        group(&rig, &pose);
        assert_int_equal(areas.count, 1);
        assert_int_equal(areas.areas[0].zone_count, 1);
        assert_int_equal(areas.areas[0].shapes[0].curved, 1);
        assert_true(areas.areas[0].shapes[0].spread_rad > 0.01f);
        cr_vec3 n = areas.areas[0].zones[0].normal_world;
        double cosine = ((double)n.x * up[0] + (double)n.y * up[1] + (double)n.z * up[2]) / length;
        assert_true(cosine > cos(1.0 * 3.14159 / 180.0));
    }
    crt_close(&rig);
}

/* Twenty posts in the floor: four more than there is room for. */
static void zones_merge_the_areas_that_do_not_fit_and_count_them(void **state) {
    (void)state;
    crt_solid block = crt_box(-60e-3, 60e-3, 50e-3, -40e-3, 0.0);
    crt_rig rig;
    double posts[20][6];
    for (int i = 0; i < 20; i++) {
        const double post[6] = {-40e-3 + 20e-3 * (i % 5), -30e-3 + 20e-3 * (i / 5), 0.0, 3e-3, 3e-3, 6e-3};
        memcpy(posts[i], post, sizeof post);
    }
    open_boxes(&rig, &block, (const double(*)[6])posts, 20);
    cr_pose pose = crt_pose(0.0, 0.0, 3e-3);
    group(&rig, &pose);
    assert_int_equal(areas.count, CR_AREAS_MAX);
    assert_int_equal(stats.areas_merged, 20 - CR_AREAS_MAX);
    for (uint32_t i = 0; i < set.hit_count; i++) {
        assert_true(set.hits[i].area < CR_AREAS_MAX);
    }
    crt_close(&rig);
}

/* Built by hand: an area on twelve patches keeps the eight most touched ones. */
static void zones_keep_the_most_touched_and_count_the_rest(void **state) {
    (void)state;
    struct cr_img_facet facets[12];
    struct cr_img_cluster cluster;
    const uint32_t start[2] = {0u, 0u};
    struct cr_img_meta meta;
    cr_scene s;
    memset(&s, 0, sizeof s);
    memset(facets, 0, sizeof facets);
    memset(&cluster, 0, sizeof cluster);
    memset(&meta, 0, sizeof meta);
    memset(&stats, 0, sizeof stats);
    memset(&set, 0, sizeof set);
    s.meta = &meta;
    s.facets = facets;
    s.clusters = &cluster;
    s.adj_start = start;
    s.adj = NULL;
    s.cluster_count = 1u;
    s.facet_count = 12u;
    uint16_t hit_of_cluster[1] = {CR_HIT_NONE};
    set.hit_count = 1u;
    set.hits[0].sum.area = 1.0f;
    set.touch_count = 12u;
    for (uint32_t i = 0; i < 12u; i++) {
        facets[i].patch = i;
        facets[i].normal[0] = 1.0f;
        facets[i].offset_m = (float)i;
        set.touches[i].facet = i;
        set.touches[i].area_m2 = 1e-4f * (float)(1u + (5u * i) % 12u);
        set.touches[i].normal_sum_m2 = v3(set.touches[i].area_m2, 0.0f, 0.0f);
    }
    cr_zones(&s, hit_of_cluster, &set, &areas, &stats);
    assert_int_equal(areas.count, 1);
    assert_int_equal(areas.areas[0].zone_count, CR_ZONES_MAX);
    assert_int_equal(stats.zones_dropped, 12 - CR_ZONES_MAX);
    for (uint32_t z = 0; z < CR_ZONES_MAX; z++) {
        assert_true(areas.areas[0].zones[z].area_m2 > 1e-4f * (12 - CR_ZONES_MAX));
    }
}

static int lanes_are_beside(const struct cr_img_cluster *c, int a, int b, double limit_m) {
    double x = (double)c->x[a] - (double)c->x[b], y = (double)c->y[a] - (double)c->y[b];
    double z = (double)c->z[a] - (double)c->z[b];
    return x * x + y * y + z * z < limit_m * limit_m;
}

/* What a cluster covers in one place is no part of what it covers in another. */
static void touches_tell_covered_lanes_apart_that_do_not_touch(void **state) {
    (void)state;
    crt_solid room = crt_room(-15e-3, 15e-3, 20e-3, -20e-3, 20e-3);
    crt_rig rig;
    static const double box[1][6] = {{2e-3, 0.0, 1e-3, 12e-3, 9e-3, 7e-3}};
    open_boxes(&rig, &room, box, 1);
    const double limit_m = 1.6 * 1.5e-3;
    uint64_t seed = 17u;
    uint32_t parted = 0u;
    for (int n = 0; n < 2000; n++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -12e-3, 12e-3), crt_uniform(&seed, -12e-3, 12e-3),
                                crt_uniform(&seed, -12e-3, 12e-3));
        pose.rot = crt_random_rotation(&seed);
        group(&rig, &pose);
        for (uint32_t h = 0; h < set.hit_count; h++) {
            const cr_hit *hit = &set.hits[h];
            const struct cr_img_cluster *c = &rig.scene.clusters[hit->cluster];
            for (uint32_t g = h + 1u; g < set.hit_count && set.hits[g].cluster == hit->cluster; g++) {
                parted++;
                assert_int_equal(hit->covered & set.hits[g].covered, 0);
                for (int a = 0; a < CR_LANES; a++) {
                    for (int b = 0; b < CR_LANES; b++) {
                        int both = ((hit->covered >> a) & 1) && ((set.hits[g].covered >> b) & 1);
                        assert_false(both && lanes_are_beside(c, a, b, limit_m));
                    }
                }
            }
        }
    }
    assert_true(parted > 10u);
    crt_close(&rig);
}

static void touches_found_in_pieces_are_the_same_to_the_bit(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    crt_open_cube(&rig, &block, 8e-3, 0.5e-3, VOXEL_M);
    cr_descent search;
    cr_motion motion;
    memset(&motion, 0, sizeof motion);
    motion.wake_count = rig.scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    uint64_t seed = 3u;
    uint32_t most = 0u;
    for (int i = 0; i < 100; i++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -9e-3, 9e-3), 0.0, crt_uniform(&seed, -9e-3, 9e-3));
        pose.rot = crt_random_rotation(&seed);
        const xform at = cr_xform_from_pose(&pose);
        const cr_detect_options options = {
            .skip = CR_SKIP_ALL, .lookups_max = LOOKUPS, .slices_max = CR_SEARCH_TICKS_MAX, .touches = 1u};
        crt_find_areas(&rig, &pose, CR_SKIP_ALL, CR_COVERAGE_SOFT, &set, &areas, &stats);
        memset(&search, 0, sizeof search);
        cr_motion_advance(&motion, &pose);
        int ended = 0;
        while (!ended) {
            memset(&stats, 0, sizeof stats);
            ended = cr_detect(&rig.field, &at, &options, &motion, &search, &pieces, &stats);
            assert_true(stats.points + stats.nodes <= LOOKUPS * CR_LANES);
        }
        most = search.calls > most ? search.calls : most;
        assert_int_equal(pieces.hit_count, set.hit_count);
        assert_int_equal(pieces.touch_count, set.touch_count);
        for (uint32_t h = 0; h < set.hit_count; h++) {
            pieces.hits[h].area = set.hits[h].area; /* set by the zones, which ran on one of the two */
            assert_memory_equal(&pieces.hits[h].sum, &set.hits[h].sum, sizeof set.hits[h].sum);
            assert_int_equal(pieces.hits[h].cluster, set.hits[h].cluster);
            assert_int_equal(pieces.hits[h].covered, set.hits[h].covered);
        }
        assert_memory_equal(pieces.touches, set.touches, set.touch_count * sizeof *set.touches);
    }
    assert_true(most > 3u);
    free(motion.wake_m);
    crt_close(&rig);
}

/* A cube face-on in a wall: all its face inside, the sides by the part below the wall. */
static void touches_coverage_of_a_face_is_exact(void **state) {
    (void)state;
    crt_solid block = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0);
    crt_rig rig;
    crt_open_cube(&rig, &block, 8e-3, 2e-3, VOXEL_M);
    for (uint32_t hard = 0; hard < 2u; hard++) {
        for (int i = 1; i < 8; i++) {
            double depth = 1e-3 + 0.7e-3 * i, up = 0.0, area = 0.0;
            cr_pose pose = crt_pose(0.0, 0.0, 8e-3 - depth);
            crt_find_areas(&rig, &pose, CR_SKIP_ALL, hard ? CR_COVERAGE_HARD : CR_COVERAGE_SOFT, &set, &areas, &stats);
            for (uint32_t h = 0; h < set.hit_count; h++) {
                up -= (double)set.hits[h].sum.az;
                area += (double)set.hits[h].sum.area;
            }
            double side = hard ? 2e-3 * floor((depth + 1e-3) / 2e-3) : depth;
            /* Edges and vertices have a thousandth of a sample each. */
            assert_true(fabs(up - 256e-6) < 3e-7);
            if (!(fabs(area - (256e-6 + 64e-3 * side)) < 64e-3 * 1e-5)) {
                fail_msg("depth %g m: area %g, expected %g", depth, area, 256e-6 + 64e-3 * side);
            }
        }
    }
    crt_close(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(zones_one_piece_of_tool_is_one_area),
        cmocka_unit_test(zones_two_pieces_of_tool_are_two_areas),
        cmocka_unit_test(zones_areas_are_the_connected_components_of_the_hits),
        cmocka_unit_test(zones_sums_of_an_area_add_up),
        cmocka_unit_test(zones_there_is_one_per_touched_patch),
        cmocka_unit_test(zones_planar_zone_has_its_facets_exact_plane),
        cmocka_unit_test(zones_sphere_holds_the_touched_surface),
        cmocka_unit_test(zones_curved_zone_points_where_the_surface_points),
        cmocka_unit_test(zones_merge_the_areas_that_do_not_fit_and_count_them),
        cmocka_unit_test(zones_keep_the_most_touched_and_count_the_rest),
        cmocka_unit_test(touches_tell_covered_lanes_apart_that_do_not_touch),
        cmocka_unit_test(touches_found_in_pieces_are_the_same_to_the_bit),
        cmocka_unit_test(touches_coverage_of_a_face_is_exact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
