/* What relate makes of zones whose sums are given: each number that decides there, by what it stands for. Firmware's comments have the reasons. */
#include "contact/way_out.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define SPACING_M 1e-3f
#define WEIGHT_M3 1e-9f
/* Area of so many samples. */
#define SAMPLES(n) ((float)(n)*SPACING_M * SPACING_M)

static const xform at_home = {{1.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f}, {0.0f, 0.0f, 1.0f}, {0.0f, 0.0f, 0.0f}};
static struct cr_img_meta meta;
static struct cr_img_facet planes[4];
static cr_scene scene;
static cr_way_zones zones;
static cr_way_relations relations;
static cr_way_half halves[CR_WAY_ZONES_MAX];

static int clear(void **state) {
    (void)state;
    memset(&meta, 0, sizeof meta);
    memset(&scene, 0, sizeof scene);
    memset(&zones, 0, sizeof zones);
    memset(&relations, 0, sizeof relations);
    memset(halves, 0, sizeof halves);
    memset(planes, 0, sizeof planes);
    meta.spacing_m = meta.voxel_m = SPACING_M;
    scene.meta = &meta;
    scene.facets = planes;
    return 0;
}

static void assert_near(double is, double ought, double room) {
    if (!(fabs(is - ought) <= room)) {
        fail_msg("%g instead of %g", is, ought);
    }
}

/* One more zone, of a facet of its own and of the one piece: as deep as many samples. What it pushes is per weight of it. All are related. */
static cr_way_zone *add_zone(cr_vec3 normal, float weights, cr_vec3 push) {
    const uint32_t index = zones.count++;
    cr_way_zone *z = &zones.zones[index];
    z->key = (cr_way_key){index, 0u, 0u};
    z->flat = 1u;
    z->plane_normal = normal;
    z->weight_m3 = weights * WEIGHT_M3;
    z->area_m2 = SAMPLES(100);
    z->push_m3 = v3_scale(push, z->weight_m3);
    relations.unit[index] = normal;
    relations.order[index] = (uint8_t)index;
    relations.all_m3 += z->weight_m3;
    for (uint32_t i = 0; i <= index; i++) {
        relations.beside_m3[i] = relations.all_m3; /* it is a part of an overlap */
        relations.part[index][i] = relations.part[i][index] = 1.0f;
    }
    return z;
}

static void join(uint32_t zone) {
    static cr_way_cone cone;
    const uint32_t left = cr_way_join(&scene, &zones, zone, &relations, halves, &cone);
    while (left != 0u && !cr_way_turn(&zones, zone, &relations, halves, &cone)) {
    }
}

static const cr_way_half *join_first(void) {
    relations.half_count = 0u;
    join(0u);
    return &halves[0];
}

/* A floor, and a sum that leans from it by this sine, alone in the world. */
static cr_way_zone *add_leaning_floor(float sine) {
    return add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(sine, 0.0f, sqrtf(1.0f - sine * sine)));
}

/* How far the normal leans, of how far it leans when all that can be trusted is. */
static double lean_of(const cr_way_half *half) { return (double)(half->normal.x / half->normal.z); }

/* A quarter of the sum is what samples of a flat floor are wrong by; two fifths are not. */
static void small_leaning_is_sampling_error(void **state) {
    (void)state;
    add_leaning_floor(0.25f);
    assert_near(lean_of(join_first()), 0.0, 1e-6);
    clear(NULL);
    add_leaning_floor(0.4f);
    assert_true(lean_of(join_first()) > 0.05);
}

/* The mean normal of a surface that bends turns as its facets come and go: a sum that leans from it by less than they are spread is right. */
static void leaning_within_the_spread_of_a_bent_surface_is_trusted(void **state) {
    (void)state;
    const float sine = 0.087f, short_by = 0.03f; /* 5 deg; normals spread by sqrt(2 * 0.03) = 0.24 rad */
    cr_way_zone *z = add_leaning_floor(sine);
    z->flat = 0u;
    z->patch = 0u;
    z->normal_m3 = v3(0.0f, 0.0f, (1.0f - short_by) * z->weight_m3);
    assert_near(lean_of(join_first()), tan(asin((double)sine)), 1e-5);
    /* No further than they are spread: 0.02 rad. */
    z->normal_m3 = v3(0.0f, 0.0f, (1.0f - 2e-4f) * z->weight_m3);
    assert_near(lean_of(join_first()), 0.02, 1e-3);
    /* What no surface is near of does not bend. */
    z->normal_m3 = v3(0.0f, 0.0f, (1.0f - short_by) * z->weight_m3);
    z->patch = CR_FACET_NONE;
    assert_near(lean_of(join_first()), 0.0, 1e-6);
}

/* A floor and a round wall beside it that is cut into facets, which are gathered from the one end to the other or back. Returns the way that leads out. */
static cr_vec3 way_beside_round_wall(int facets, int back) {
    clear(NULL);
    add_zone(v3(0.0f, 0.0f, 1.0f), 0.6f, v3(0.0f, 0.0f, 1.0f));
    for (int k = 0; k < facets; k++) {
        const float turn = 0.07f * ((float)(back != 0 ? facets - 1 - k : k) - 0.5f * (float)(facets - 1));
        add_zone(v3(cosf(turn), sinf(turn), 0.0f), 0.4f / (float)facets, v3(1.0f, 0.0f, 0.4f));
    }
    return join_first()->normal;
}

/* How far the way out of two faces leans from the larger: each counts by its share of the larger side, of which the other is a part. */
static double lean_of_two(double apart_rad, double small, double part) {
    const double x = small * sin(apart_rad), z = small * cos(apart_rad);
    const double large_side = hypot(part * x, 1.0 + part * z), small_side = hypot(x, z + part);
    const double r = small_side / large_side, counts = r * (2.5 - 1.5 * r);
    return counts * x / (1.0 + counts * z);
}

static void faces_of_120_degrees_are_two_sides(void **state) {
    (void)state;
    const double degree = 3.14159265358979 / 180.0, small = 0.3;
    const double at_deg[4] = {90.0, 60.0, 50.0, 30.0}, part[4] = {0.0, 0.0, 0.28558, 0.73205};
    for (int k = 0; k < 4; k++) {
        const float s = (float)sin(at_deg[k] * degree), c = (float)cos(at_deg[k] * degree);
        clear(NULL);
        add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        add_zone(v3(s, 0.0f, c), 0.3f, v3(s, 0.0f, c));
        assert_near(lean_of(join_first()), lean_of_two(at_deg[k] * degree, small, part[k]), 0.01);
    }
}

/* Facets that turn little make one side: how a wall is cut, and what is gathered first, is all one. */
static void round_wall_counts_as_a_whole(void **state) {
    (void)state;
    const cr_vec3 one = way_beside_round_wall(1, 0);
    for (int facets = 3; facets <= 9; facets += 2) {
        for (int back = 0; back < 2; back++) {
            assert_near(v3_norm(v3_sub(way_beside_round_wall(facets, back), one)), 0.0, 0.02);
        }
    }
}

/* Of more planes than there is room for the weightiest bound the way out, whatever their order, each by what it weighs beyond the heaviest without room. */
static void weightiest_planes_bound_a_half_space(void **state) {
    (void)state;
    const uint32_t count = CR_WAY_BOUNDS_MAX + 3u;
    for (uint32_t back = 0; back < 2u; back++) {
        clear(NULL);
        for (uint32_t i = 0; i < count; i++) {
            const uint32_t k = back != 0u ? count - 1u - i : i;
            const float turn = 0.05f * (float)k;
            add_zone(v3(sinf(turn), 0.0f, cosf(turn)), (float)(1u + k), v3(0.0f, 0.0f, 1.0f));
        }
        const cr_way_half *half = join_first();
        assert_int_equal(half->bound_count, CR_WAY_BOUNDS_MAX);
        float least = 1.0f, sum = 0.0f;
        for (uint32_t b = 0; b < half->bound_count; b++) {
            least = fminf(least, half->bounds[b].weight_m3);
            sum += half->bounds[b].weight_m3;
        }
        assert_near((double)least, 1.0 * (double)WEIGHT_M3, 1e-12);
        assert_near((double)sum, (1.0 + 2.0 + 3.0 + 4.0 + 5.0 + 6.0) * (double)WEIGHT_M3, 1e-12);
    }
}

/* One sample tells nothing of a direction that no normal has, four tell as much as a hundred, two and a half tell half of it. */
static void few_samples_tell_no_new_direction(void **state) {
    (void)state;
    cr_way_zone *z = add_leaning_floor(0.8f);
    const double full = lean_of(join_first());
    z->area_m2 = SAMPLES(4.01);
    assert_near(lean_of(join_first()) / full, 1.0, 0.01);
    z->area_m2 = SAMPLES(2.5);
    assert_near(lean_of(join_first()) / full, 0.5, 0.1);
    z->area_m2 = SAMPLES(1.0);
    assert_near(lean_of(join_first()) / full, 0.0, 1e-6);
}

/* Nor do zones that hold half of all weight or less; three quarters are believed half. */
static void minority_tells_no_new_direction(void **state) {
    (void)state;
    add_leaning_floor(0.8f);
    const double full = lean_of(join_first());
    relations.all_m3 = WEIGHT_M3 / 0.75f;
    assert_near(lean_of(join_first()) / full, 0.5, 0.1);
    relations.all_m3 = WEIGHT_M3 / 0.49f;
    assert_near(lean_of(join_first()) / full, 0.0, 1e-6);
}

/* But those that hold all that is beside them, whatever else there is; 95 % are believed half, nine tenths not. */
static void all_of_an_overlap_tells_a_direction(void **state) {
    (void)state;
    add_leaning_floor(0.8f);
    const double full = lean_of(join_first());
    relations.all_m3 = 10.0f * WEIGHT_M3;
    relations.beside_m3[0] = 0.0f;
    assert_near(lean_of(join_first()) / full, 1.0, 1e-6);
    relations.beside_m3[0] = WEIGHT_M3 / 0.95f - WEIGHT_M3;
    assert_near(lean_of(join_first()) / full, 0.5, 0.1);
    relations.beside_m3[0] = WEIGHT_M3 / 0.89f - WEIGHT_M3;
    assert_near(lean_of(join_first()) / full, 0.0, 1e-6);
}

/* Each of its zones tells of what is beside it by what it weighs: which comes first does not matter, nor one that is hardly touched. */
static void what_is_beside_counts_by_weight(void **state) {
    (void)state;
    add_leaning_floor(0.8f);
    *add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 0.0f)) = zones.zones[0];
    relations.all_m3 = 20.0f * WEIGHT_M3;
    relations.beside_m3[0] = 0.0f;
    relations.beside_m3[1] = 0.2f * WEIGHT_M3;
    const double first = lean_of(join_first());
    relations.beside_m3[0] = 0.2f * WEIGHT_M3;
    relations.beside_m3[1] = 0.0f;
    assert_near(lean_of(join_first()), first, 1e-6);
    assert_true(first > 0.1);
    zones.zones[1].weight_m3 = 1e-6f * WEIGHT_M3;
    relations.beside_m3[0] = 10.0f * WEIGHT_M3;
    assert_near(lean_of(join_first()), 0.0, 1e-6);
}

/* How open a half-space is of whose sum the normal tells this part, and nothing else is believed. */
static double open_by(float part) {
    clear(NULL);
    add_leaning_floor(sqrtf(1.0f - part * part));
    relations.all_m3 = 2.0f * WEIGHT_M3;
    return (double)join_first()->open;
}

static void sum_that_normals_do_not_tell_does_not_lead(void **state) {
    (void)state;
    assert_near(open_by(0.19f), 0.0, 1e-6);
    assert_near(open_by(0.35f), 0.5, 0.15);
    assert_near(open_by(0.51f), 1.0, 1e-6);
}

/* What pushes from all sides has no direction: with a hundredth of its weight left over it has one, with half of that half. */
static void sum_that_cancels_fades(void **state) {
    (void)state;
    cr_way_zone *z = add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 0.011f));
    assert_near((double)join_first()->open, 1.0, 1e-6);
    z->push_m3.z = 0.005f * WEIGHT_M3;
    assert_near((double)join_first()->open, 0.5, 0.15);
}

/* A wall tells the way, a floor holds the rest of the weight: a quarter that faces the way is enough, of an eighth a quarter is felt. Four samples are believed. */
static void way_that_few_samples_tell_and_little_faces_fades(void **state) {
    static const float cases[3][3] = {{0.27f, 0.2f, 1.0f}, {0.125f, 0.2f, 0.25f}, {0.125f, 2.0f, 1.0f}};
    for (int i = 0; i < 3; i++) {
        clear(state);
        add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f - cases[i][0], v3(0.0f, 0.0f, 0.0f))->area_m2 = SAMPLES(cases[i][1]);
        add_zone(v3(1.0f, 0.0f, 0.0f), cases[i][0], v3(0.5f / cases[i][0], 0.0f, 0.0f))->area_m2 = SAMPLES(cases[i][1]);
        assert_near((double)join_first()->open, (double)cases[i][2], i == 1 ? 0.06 : 1e-3);
    }
}

/* Relations that differ by rounding make one half-space; by more, two. */
static void relations_are_the_same_to_a_thousandth(void **state) {
    (void)state;
    const float apart[2] = {0.7e-3f, 1.5e-3f};
    for (uint32_t i = 0; i < 2u; i++) {
        clear(NULL);
        add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        relations.part[0][1] = relations.part[1][0] = 1.0f - apart[i];
        join(0u);
        join(1u);
        assert_int_equal(relations.half_count, i + 1u);
    }
}

/* A pad whose moment is 1 m beside one of none, and their normals so far from each other: what of it stays with the first. */
static double own_arm(float apart) {
    clear(NULL);
    for (int h = 0; h < 2; h++) {
        const float tilt = h == 0 ? 0.0f : 2.0f * asinf(0.5f * apart);
        halves[h].normal = v3(sinf(tilt), 0.0f, cosf(tilt));
        halves[h].weight_m3 = halves[h].joined_m3 = WEIGHT_M3;
        halves[h].open = 1.0f;
        halves[h].own_m = v3(h == 0 ? 1.0f : 0.0f, 0.0f, 0.0f);
    }
    cr_way_share_arm(2u, 0u, halves);
    return (double)halves[0].arm_m.x;
}

/* Of one direction they share it; from a fifth on, 11 degrees, each has its own; half way the other counts half. */
static void half_spaces_of_one_direction_share_their_moment(void **state) {
    (void)state;
    assert_near(own_arm(0.0f), 0.5, 1e-6);
    assert_near(own_arm(0.1f), 1.0 / 1.5, 0.05);
    assert_near(own_arm(0.21f), 1.0, 1e-6);
}

/* Zones that touch nothing worth speaking of do not tell half-spaces apart: one that is related as a large zone but to them is as open. */
static void what_weighs_nothing_tells_no_relations_apart(void **state) {
    (void)state;
    add_zone(v3(0.0f, 0.0f, 1.0f), 0.01f, v3(0.0f, 0.0f, 1.0f));
    add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
    add_zone(v3(0.0f, 0.0f, 1.0f), 1e-9f, v3(0.0f, 0.0f, 1.0f));
    relations.part[0][2] = relations.part[2][0] = 0.5f;
    for (uint32_t z = 0; z < zones.count; z++) {
        join(z);
    }
    assert_int_equal(relations.half_count, 3);
    (void)cr_way_agree(&zones, &relations, relations.half_of[0], halves);
    assert_near((double)halves[relations.half_of[0]].open, 1.0, 1e-6);
}

/* A half-space that has its weight from zones which lead others is led by none: below a tenth it fades. */
static void half_space_without_a_leader_fades(void **state) {
    (void)state;
    const float led[2] = {0.11f, 0.05f}, open[2] = {1.0f, 0.5f};
    for (int i = 0; i < 2; i++) {
        relations.half_count = 1u;
        halves[0].normal = v3(0.0f, 0.0f, 1.0f);
        halves[0].weight_m3 = WEIGHT_M3;
        halves[0].led_m3 = led[i] * WEIGHT_M3;
        halves[0].open = 1.0f;
        (void)cr_way_agree(&zones, &relations, 0u, halves);
        assert_near((double)halves[0].open, (double)open[i], 0.15);
    }
}

/* Direction of a floor and a wall that push alike when the wall holds a share of the weight, of so many samples in all: that of z = 1 has this x. */
static double lean_to_wall(float share, double samples) {
    clear(NULL);
    const float floor = 1.0f - share;
    add_zone(v3(0.0f, 0.0f, 1.0f), floor, v3(0.0f, 0.0f, 0.5f / floor))->area_m2 = SAMPLES(samples);
    add_zone(v3(1.0f, 0.0f, 0.0f), share, v3(0.5f / share, 0.0f, 0.0f))->area_m2 = 0.0f;
    relations.all_m3 *= 2.0f; /* what is left over counts for nothing */
    return lean_of(join_first());
}

/* A surface that is r of the largest counts for 2.5 r^2 - 1.5 r^3 (WAY_OUT.md): the r that counts so much, from 0 to 1. */
static double share_of_largest(double counts) {
    double low = 0.0, high = 1.0;
    for (int i = 0; i < 50; i++) {
        const double r = 0.5 * (low + high);
        *(r * r * (2.5 - 1.5 * r) < counts ? &low : &high) = r;
    }
    return low;
}

/* Both push 0.5, and an eighth of the weight is 0.375 at most at first: of 0.875 in all it may be a quarter, 0.4375 of what the floor does. */
static void surface_counts_for_at_most_twice_what_is_inside(void **state) {
    (void)state;
    assert_near(share_of_largest(lean_to_wall(0.125f, 100.0)), 0.4375, 0.03);
    assert_near(lean_to_wall(0.5f, 100.0), 1.0, 1e-4);
}

/* Where next to nothing is inside, for ten times that: an eightieth of the weight for as much. */
static void surface_counts_for_more_where_few_samples_are_inside(void **state) {
    (void)state;
    assert_near(share_of_largest(lean_to_wall(0.0125f, 0.01)), 0.4375, 0.06);
    assert_near(lean_to_wall(0.05f, 0.01), 1.0, 1e-4);
}

/* Walls of a fifth and a twentieth of the weight, on a side where the floor pushes 0.5 too: the second may be 0.15 of all, 1.15, twice a fifth of which is 0.92. */
static void what_weighs_little_makes_a_sum_little_larger(void **state) {
    (void)state;
    add_zone(v3(0.0f, 0.0f, 1.0f), 0.75f, v3(0.0f, 0.5f / 0.75f, 0.5f / 0.75f));
    add_zone(v3(1.0f, 0.0f, 0.0f), 0.2f, v3(2.5f, 0.0f, 0.0f));
    add_zone(v3(0.0f, 1.0f, 0.0f), 0.05f, v3(0.0f, 0.0f, 0.0f));
    relations.all_m3 *= 2.0f; /* what is left over counts for nothing */
    assert_near(share_of_largest(lean_of(join_first())), 0.92, 0.03);
}

/* By surface, piece and side, whatever is gathered first. */
static void zones_are_in_the_order_of_their_keys(void **state) {
    (void)state;
    static const cr_way_key sorted[4] = {{3u, 0u, 1u}, {3u, 0u, 2u}, {CR_WAY_CURVED, 1u, 0u}, {CR_WAY_CURVED, 0u, 1u}};
    static const uint32_t gathered[2][4] = {{0u, 1u, 2u, 3u}, {2u, 0u, 3u, 1u}};
    for (int way = 0; way < 2; way++) {
        clear(NULL);
        for (uint32_t z = 0; z < 4u; z++) {
            cr_way_zone *made = add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
            made->key = sorted[gathered[way][z]];
            made->flat = made->key.surface < CR_WAY_CURVED;
            made->normal_m3 = v3(0.0f, 0.0f, WEIGHT_M3);
        }
        for (uint32_t z = 0; z < 4u; z++) {
            (void)cr_way_relate(&scene, &at_home, &zones, z, &relations);
        }
        for (uint32_t k = 0; k < 4u; k++) {
            assert_int_equal(gathered[way][relations.order[k]], k);
        }
    }
}

/* A zone between two that oppose each other leads as far as the weaker of them weighs little beside it. */
static void zones_in_conflict_count_by_their_weight(void **state) {
    (void)state;
    const float weighs[2] = {0.31f, 0.15f}, leads[2] = {0.0f, 0.5f};
    for (int i = 0; i < 2; i++) {
        clear(NULL);
        add_zone(v3(1.0f, 0.0f, 0.0f), weighs[i], v3(0.0f, 0.0f, 1.0f));
        add_zone(v3(-1.0f, 0.0f, 0.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        relations.part[0][1] = relations.part[1][0] = 0.0f;
        assert_int_equal(cr_way_lead(&zones, 2u, &relations), 3);
        assert_near((double)relations.lead[2], (double)leads[i], 0.15);
    }
}

/* Samples of a zone that leads by less than a half count for what leads by the rest, and by more than that for their own; in full from two thirds of a lead on. */
static void zones_that_do_not_lead_count_for_those_that_do(void **state) {
    (void)state;
    const float lead[3] = {0.3f, 0.3f, 0.75f}, other[3] = {1.0f, 0.5f, 1.0f};
    const float own[3] = {0.45f, 0.725f, 1.0f}, its[3] = {0.7f, 0.35f, 0.25f};
    for (int i = 0; i < 3; i++) {
        clear(NULL);
        for (uint32_t z = 0; z < 3u; z++) {
            add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
            relations.part[z][z] = relations.lead[z] = 1.0f;
        }
        relations.part[0][1] = relations.part[1][0] = relations.part[1][2] = relations.part[2][1] = 1.0f;
        relations.part[0][2] = relations.part[2][0] = 0.0f;
        relations.lead[0] = lead[i];
        relations.lead[1] = other[i];
        assert_int_equal(cr_way_tell_counts(3u, 0u, &relations), 3);
        assert_int_equal(relations.counts_for[0], 3u);
        assert_near((double)relations.part[0][0], (double)own[i], 0.05);
        assert_near((double)relations.part[0][1], (double)its[i], 1e-7);
        assert_int_equal(cr_way_tell_counts(3u, 2u, &relations), 0);
        assert_int_equal(relations.counts_for[2], 4u);
        assert_near((double)relations.part[2][2], 1.0, 0.0);
    }
}

/* Two level faces of one patch, so far from each other, the line between them rising by this sine: how far they have one way out. */
static double part_of_steps(float apart_m, float sine) {
    clear(NULL);
    for (int i = 0; i < 2; i++) {
        cr_way_zone *z = add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        const float far_m = i == 0 ? 0.0f : apart_m, high_m = far_m * sine;
        z->plane_offset_m = -high_m;
        z->centre_m4 = v3_scale(v3(far_m * sqrtf(1.0f - sine * sine), 0.0f, high_m), z->weight_m3);
    }
    for (uint32_t z = 0; z < 2u; z++) {
        (void)cr_way_relate(&scene, &at_home, &zones, z, &relations);
    }
    return (double)relations.part[0][1];
}

static double part_at_rise(float sine) { return part_of_steps(10e-3f, sine); }

/* Steps of a stair are apart from 12 degrees on, a sine of a fifth; half of that is half apart. */
static void what_lies_above_is_apart(void **state) {
    (void)state;
    assert_near(part_at_rise(0.0f), 1.0, 1e-6);
    assert_near(part_at_rise(0.1f), 0.5, 0.15);
    assert_near(part_at_rise(0.21f), 0.0, 1e-6);
}

/* What lies a sample beside may lie a sample higher by a sample more or less: it is told apart as at twice the distance, where half as steep is half apart. */
static void what_is_hardly_beside_is_half_apart(void **state) {
    (void)state;
    assert_near(part_of_steps(SPACING_M, 0.2f), 0.5, 0.15);
    assert_near(part_of_steps(4.0f * SPACING_M, 0.21f), 0.0, 1e-6);
    assert_near(part_of_steps(0.0f, 0.0f), 1.0, 1e-6);
}

/* Two level faces, the second 10 mm along x and so much lower. The first is 2 mm wide, with ends on those sides of it: how far they have one way out. */
static double part_beyond(uint8_t ends, float lower_m) {
    clear(NULL);
    planes[0] = (struct cr_img_facet){.normal = {0.0f, 0.0f, 1.0f},
                                      .ends = ends,
                                      .along = {32767, 0, 0},
                                      .low_m = {-1e-3f, -1e-3f},
                                      .high_m = {1e-3f, 1e-3f}};
    for (int i = 0; i < 2; i++) {
        cr_way_zone *z = add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        z->plane_normal = v3_unit(i == 0 ? v3(0.0f, 0.0f, 1.0f) : v3(lower_m, 0.0f, 10e-3f), 0.0f); /* both below it */
        z->plane_offset_m = i == 0 ? 0.0f : -v3_dot(z->plane_normal, v3(10e-3f, 0.0f, -lower_m));
        z->centre_m4 = v3_scale(i == 0 ? v3(0.0f, 0.0f, 0.0f) : v3(10e-3f, 0.0f, -lower_m), z->weight_m3);
        z->patch = (uint32_t)i;
    }
    for (uint32_t z = 0; z < 2u; z++) {
        (void)cr_way_relate(&scene, &at_home, &zones, z, &relations);
    }
    return (double)relations.part[0][1];
}

/* From a voxel beyond the end on it is 8 mm away, where one solid is 4 mm lower: a fifth of 10 mm less is apart, a tenth of it half. */
static void what_stands_beyond_an_end_is_apart(void **state) {
    (void)state;
    assert_near(part_beyond(2u, 0.0f), 0.0, 1e-6);
    assert_near(part_beyond(2u, 1.9e-3f), 0.0, 0.05);
    assert_near(part_beyond(2u, 3e-3f), 0.5, 0.1);
    assert_near(part_beyond(2u, 4.1e-3f), 1.0, 1e-6);
    assert_near(part_beyond(1u, 0.0f), 1.0, 1e-6); /* the end on the other side */
    assert_near(part_beyond(0u, 0.0f), 1.0, 1e-6);
}

/* A zone of another piece counts beside one on its own patch, and not on a patch that shares no crease with it. */
static void what_is_beside_a_zone_is_on_its_patch(void **state) {
    (void)state;
    for (uint32_t patch = 0; patch < 2u; patch++) {
        clear(NULL);
        (void)add_zone(v3(0.0f, 0.0f, 1.0f), 1.0f, v3(0.0f, 0.0f, 1.0f));
        cr_way_zone *other = add_zone(v3(0.0f, 0.0f, 1.0f), 2.0f, v3(0.0f, 0.0f, 1.0f));
        other->key.piece = 1u;
        other->patch = patch;
        for (uint32_t z = 0; z < 2u; z++) {
            (void)cr_way_relate(&scene, &at_home, &zones, z, &relations);
        }
        assert_near((double)(relations.beside_m3[0] / WEIGHT_M3), patch == 0u ? 2.0 : 0.0, 1e-6);
        assert_near((double)(relations.beside_m3[1] / WEIGHT_M3), patch == 0u ? 1.0 : 0.0, 1e-6);
        assert_near((double)relations.part[0][1], 0.0, 0.0);
    }
}

/* Two faces that turn by 18 degrees, pushed at the first alone: the middle normal. A sweep leaves cos^2 of the error: 64 sweeps a thousandth, 32 a thirtieth. */
static void faces_that_turn_little_are_told_apart(void **state) {
    (void)state;
    const float half_angle = 0.158780f;
    add_zone(v3(sinf(half_angle), 0.0f, cosf(half_angle)), 1.0f, v3(0.0f, 0.0f, 2.0f));
    add_zone(v3(-sinf(half_angle), 0.0f, cosf(half_angle)), 1.0f, v3(0.0f, 0.0f, 0.0f));
    relations.all_m3 *= 2.0f;
    assert_near(lean_of(join_first()), 0.0, 1e-3);
}

/* Three half-spaces that push, of two directions, and contacts for two: the least gives its push to the one along it, whatever their order. */
static void what_has_no_contact_pushes_along_another(void **state) {
    (void)state;
    static cr_contact_set set;
    static cr_way_work work;
    const xform at = cr_xform_from_pose(&(cr_pose){{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}});
    const cr_respond_input in = {.world_from_tool = &at, .set = &set};
    const cr_vec3 up = {0.0f, 0.0f, 1.0f}, aside = {1.0f, 0.0f, 0.0f};
    for (uint32_t first = 0; first < 3u; first++) {
        cr_stats stats = {0};
        cr_area areas[2];
        clear(NULL);
        for (uint32_t i = 0; i < 3u; i++) {
            const uint32_t h = (first + i) % 3u;
            cr_way_zone *z = add_zone(h == 0u ? aside : up, 1.0f, v3(0.0f, 0.0f, 0.0f));
            z->flat = 0u;
            z->patch = CR_FACET_NONE;
            z->centre_m4 = v3_scale(up, z->weight_m3);
            work.half[i] = (cr_way_half){.zones = 1u << i, .normal = h == 0u ? aside : up, .weight_m3 = z->weight_m3};
            work.push_m[i] = 1e-3f * (float)(3u - h);
            work.relations.half_of[i] = i;
        }
        set.way = zones;
        work.relations.half_count = 3u;
        assert_int_equal(cr_way_answer(&in, &work, areas, 2u, &stats), 2);
        assert_int_equal(stats.areas_merged, 1);
        for (int i = 0; i < 2; i++) {
            assert_near((double)areas[i].depth_m, 3e-3, 1e-9);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(small_leaning_is_sampling_error, clear),
        cmocka_unit_test_setup(leaning_within_the_spread_of_a_bent_surface_is_trusted, clear),
        cmocka_unit_test_setup(round_wall_counts_as_a_whole, clear),
        cmocka_unit_test_setup(faces_of_120_degrees_are_two_sides, clear),
        cmocka_unit_test_setup(weightiest_planes_bound_a_half_space, clear),
        cmocka_unit_test_setup(few_samples_tell_no_new_direction, clear),
        cmocka_unit_test_setup(minority_tells_no_new_direction, clear),
        cmocka_unit_test_setup(all_of_an_overlap_tells_a_direction, clear),
        cmocka_unit_test_setup(what_is_beside_counts_by_weight, clear),
        cmocka_unit_test_setup(sum_that_normals_do_not_tell_does_not_lead, clear),
        cmocka_unit_test_setup(sum_that_cancels_fades, clear),
        cmocka_unit_test_setup(way_that_few_samples_tell_and_little_faces_fades, clear),
        cmocka_unit_test_setup(relations_are_the_same_to_a_thousandth, clear),
        cmocka_unit_test_setup(half_spaces_of_one_direction_share_their_moment, clear),
        cmocka_unit_test_setup(half_space_without_a_leader_fades, clear),
        cmocka_unit_test_setup(what_weighs_nothing_tells_no_relations_apart, clear),
        cmocka_unit_test_setup(surface_counts_for_at_most_twice_what_is_inside, clear),
        cmocka_unit_test_setup(surface_counts_for_more_where_few_samples_are_inside, clear),
        cmocka_unit_test_setup(what_weighs_little_makes_a_sum_little_larger, clear),
        cmocka_unit_test_setup(zones_are_in_the_order_of_their_keys, clear),
        cmocka_unit_test_setup(zones_in_conflict_count_by_their_weight, clear),
        cmocka_unit_test_setup(zones_that_do_not_lead_count_for_those_that_do, clear),
        cmocka_unit_test_setup(what_lies_above_is_apart, clear),
        cmocka_unit_test_setup(what_is_hardly_beside_is_half_apart, clear),
        cmocka_unit_test_setup(what_stands_beyond_an_end_is_apart, clear),
        cmocka_unit_test_setup(what_is_beside_a_zone_is_on_its_patch, clear),
        cmocka_unit_test_setup(faces_that_turn_little_are_told_apart, clear),
        cmocka_unit_test_setup(what_has_no_contact_pushes_along_another, clear),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
