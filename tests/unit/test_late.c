/* A search for contact that needs more lookups than one tick may make: what it finds, and what is felt meanwhile. */
#include "contact/way_out.h"
#include "contact/world.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define PERIOD_S 1e-3f
#define STIFFNESS_N_M 1000.0f
#define LOOKUPS 96u
/* Work of one step of an answer at most: a hit that is looked up, a surface of it that is told, a half-space of 16 lanes that are looked at, and one of them called for. */
#define STEP_MOST (4u + 2u + 5u + 1u)
/* The distances of the image are rounded to this, and the force with them. */
#define ROUNDING_N 2e-3f

static crt_rig wall, edge;
static uint32_t within; /* calls that ended within a cluster */
static cr_contact_set whole, pieces;

static void open_cube(crt_rig *rig, const crt_solid *solid) { crt_open_cube(rig, solid, HALF_M, 0.5e-3, VOXEL_M); }

static int open_rigs(void **state) {
    (void)state;
    const crt_solid flat = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0), bent = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    open_cube(&wall, &flat);
    open_cube(&edge, &bent);
    return 0;
}

static int close_rigs(void **state) {
    (void)state;
    crt_close(&wall);
    crt_close(&edge);
    return 0;
}

static cr_config few_lookups(void) {
    cr_config config = cr_config_default();
    config.stiffness_N_m = STIFFNESS_N_M;
    config.lookups_max = LOOKUPS;
    return config;
}

static void restart_with_few_lookups(crt_rig *rig) {
    const cr_config config = few_lookups();
    crt_restart(rig, &config);
}

static cr_output tick(const crt_rig *rig, const cr_pose *pose) {
    cr_output out;
    memset(&out, 0xa5, sizeof out);
    cr_tick(rig->world, pose, PERIOD_S, &out);
    return out;
}

static cr_pose pressed(double depth_m) { return crt_pose(0.0, 0.0, HALF_M - depth_m); }

static cr_quat minus(cr_quat q) { return (cr_quat){-q.w, -q.x, -q.y, -q.z}; }

/* Searches at a pose, in as many calls as it takes, with so many lookups in each. Returns how many it took. */
static uint32_t gather_in_calls(cr_motion *motion, const cr_pose *pose, uint32_t lookups, cr_contact_set *set) {
    const xform at = cr_xform_from_pose(pose);
    const cr_detect_options options = {.skip = CR_SKIP_ALL, .lookups_max = lookups, .slices_max = UINT32_MAX};
    cr_descent search;
    cr_stats stats;
    memset(&search, 0, sizeof search);
    memset(&stats, 0, sizeof stats);
    cr_motion_advance(motion, pose);
    for (int ended = 0; !ended;) {
        memset(&stats, 0, sizeof stats);
        ended = cr_detect(&edge.field, &at, &options, motion, &search, set, &stats);
        within += search.hand == CR_HAND_ADDING;
        assert_true(lookups == UINT32_MAX || stats.points + stats.nodes <= lookups * CR_LANES);
    }
    return search.calls;
}

/* The zones of way_out are gathered while the search goes on. */
static void zones_gathered_in_pieces_are_the_same_to_the_bit(void **state) {
    (void)state;
    cr_motion motion;
    memset(&motion, 0, sizeof motion);
    motion.wake_count = edge.scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    uint64_t seed = 4u;
    uint32_t most = 0u, zones = 0u;
    within = 0u;
    for (int i = 0; i < 100; i++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -9e-3, 9e-3), 0.0, crt_uniform(&seed, -9e-3, 9e-3));
        pose.rot = crt_random_rotation(&seed);
        assert_int_equal(gather_in_calls(&motion, &pose, UINT32_MAX, &whole), 1);
        /* every other time with so little that it ends within a cluster */
        const uint32_t calls = gather_in_calls(&motion, &pose, i % 2 == 0 ? LOOKUPS : 2u, &pieces);
        most = calls > most ? calls : most;
        zones += whole.way.count;
        assert_int_equal(pieces.hit_count, whole.hit_count);
        assert_int_equal(pieces.way.count, whole.way.count);
        assert_memory_equal(pieces.way.zones, whole.way.zones, whole.way.count * sizeof *whole.way.zones);
        assert_memory_equal(pieces.way.reach, whole.way.reach, whole.hit_count * sizeof *whole.way.reach);
    }
    assert_true(most > 3u && zones > 100u && within > 5u);
    free(motion.wake_m);
}

static uint32_t among; /* calls that ended among the lanes of a half-space */

/* What is found at a pose, measured with so much work in each call. Returns how many calls it took. */
static uint32_t measure_in_calls(const cr_pose *pose, uint32_t lookups, cr_contact_set *set, cr_way_work *work) {
    const xform at = cr_xform_from_pose(pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &edge.field, .world_from_tool = &at, .set = set, .config = &config};
    uint32_t calls = 1u;
    cr_way_begin(&in, work);
    while (!cr_way_measure(&in, work, lookups)) {
        assert_true(work->spent / CR_WORK_PARTS >= lookups && work->spent / CR_WORK_PARTS < lookups + STEP_MOST);
        within += work->surfaces_done + work->done > 0u;
        among += work->left != 0u;
        work->spent = 0u;
        calls++;
    }
    return calls;
}

/* The half-spaces are found and measured zone by zone and hit by hit. */
static void depths_measured_in_pieces_are_the_same_to_the_bit(void **state) {
    (void)state;
    static cr_way_work at_once, in_pieces;
    cr_motion motion;
    memset(&motion, 0, sizeof motion);
    motion.wake_count = edge.scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    uint64_t seed = 5u;
    uint32_t most = 0u, deep = 0u;
    within = among = 0u;
    for (int i = 0; i < 100; i++) {
        cr_pose pose = crt_pose(crt_uniform(&seed, -9e-3, 9e-3), 0.0, crt_uniform(&seed, -9e-3, 9e-3));
        pose.rot = crt_random_rotation(&seed);
        (void)gather_in_calls(&motion, &pose, UINT32_MAX, &whole);
        assert_int_equal(measure_in_calls(&pose, UINT32_MAX, &whole, &at_once), 1);
        /* every other time with so little that it ends after each step */
        const uint32_t calls = measure_in_calls(&pose, i % 2 == 0 ? LOOKUPS : 1u, &whole, &in_pieces);
        const uint32_t count = at_once.relations.half_count;
        most = calls > most ? calls : most;
        assert_int_equal(in_pieces.relations.half_count, count);
        for (uint32_t h = 0; h < count; h++) {
            const cr_way_half *a = &at_once.half[h], *b = &in_pieces.half[h];
            assert_true(a->depth_m == b->depth_m && a->open == b->open);
            assert_memory_equal(&a->normal, &b->normal, sizeof a->normal);
            assert_memory_equal(&a->arm_m, &b->arm_m, sizeof a->arm_m);
            deep += a->depth_m > 1e-3f;
        }
    }
    assert_true(most > 2u && deep > 50u && within > 5u && among > 5u);
    free(motion.wake_m);
}

/* As many zones as there may be, of one piece over curved surfaces that bend this way and that; one hit, which counts for none. */
static void make_zones(cr_contact_set *set) {
    uint64_t seed = 6u;
    memset(set, 0, sizeof *set);
    set->hit_count = 1u;
    set->way.count = CR_WAY_ZONES_MAX;
    for (uint32_t i = 0; i < CR_WAY_ZONES_MAX; i++) {
        cr_way_zone *z = &set->way.zones[i];
        const float x = (float)crt_uniform(&seed, -1.0, 1.0), y = (float)crt_uniform(&seed, -1.0, 1.0);
        const cr_vec3 n = v3_unit(v3(x, y, 0.5f), 0.0f);
        z->key = (cr_way_key){CR_WAY_CURVED | i, 4u, 0u};
        z->weight_m3 = (float)crt_uniform(&seed, 0.1e-9, 1e-9);
        z->area_m2 = 1e-5f;
        z->deep_m = 1e-3f;
        z->push_m3 = z->normal_m3 = v3_scale(n, z->weight_m3);
        z->centre_m4 = v3_scale(v3(1e-3f * x, 1e-3f * y, (float)crt_uniform(&seed, -1e-3, 0.0)), z->weight_m3);
    }
}

/* They are related, join and agree zone by zone and half-space by half-space: none of these steps is much, however many there are. */
static void zones_that_join_in_steps_are_the_same_to_the_bit(void **state) {
    (void)state;
    static cr_way_work at_once, in_steps;
    const cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    const xform at = cr_xform_from_pose(&pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &edge.field, .world_from_tool = &at, .set = &whole, .config = &config};
    uint32_t steps = 0u;
    make_zones(&whole);
    cr_way_begin(&in, &at_once);
    assert_int_equal(cr_way_measure(&in, &at_once, UINT32_MAX), 1);
    cr_way_begin(&in, &in_steps);
    for (int ended = 0; !ended; steps++) {
        const int agrees = in_steps.next >= 3u * CR_WAY_ZONES_MAX;
        in_steps.spent = CR_WORK_PARTS - 1u; /* so that one step ends it */
        ended = cr_way_measure(&in, &in_steps, 1u);
        assert_true(!agrees || in_steps.spent < 4u * CR_WORK_PARTS);
    }
    const uint32_t count = at_once.relations.half_count;
    assert_true(count > CR_WAY_ZONES_MAX / 2u && steps > 3u * CR_WAY_ZONES_MAX + 2u * count);
    assert_int_equal(in_steps.relations.half_count, count);
    assert_memory_equal(&in_steps.relations, &at_once.relations, sizeof at_once.relations);
    assert_memory_equal(in_steps.half, at_once.half, count * sizeof *at_once.half);
}

/* A tool of some 1,700 clusters, all over the surface: more than fit into a tick, and more than a search may take ticks for. */
static void what_a_search_cannot_see_in_its_time_is_left_out(void **state) {
    (void)state;
    const double centre[3] = {0.0, 0.0, 0.0}, half[3] = {60e-3, 60e-3, 2e-3};
    crt_tool slab = crt_tool_new(1e-3);
    crt_rig rig;
    cr_motion motion;
    memset(&motion, 0, sizeof motion);
    crt_add_box(&slab, centre, half);
    const crt_solid block = crt_box(-80e-3, 80e-3, 80e-3, -20e-3, 0.0);
    crt_open(&rig, &block, &slab, 4e-3, NULL);
    motion.wake_count = rig.scene.group_count * CR_LANES;
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    const cr_pose pose = crt_pose(0.0, 0.0, 0.5e-3);
    const xform at = cr_xform_from_pose(&pose);
    const cr_detect_options all = {.lookups_max = UINT32_MAX, .slices_max = CR_SEARCH_TICKS_MAX},
                            few = {.lookups_max = LOOKUPS, .slices_max = CR_SEARCH_TICKS_MAX};
    cr_descent search;
    cr_stats stats;
    memset(&search, 0, sizeof search);
    memset(&stats, 0, sizeof stats);
    cr_motion_advance(&motion, &pose);
    assert_int_equal(cr_detect(&rig.field, &at, &all, &motion, &search, &whole, &stats), 1);
    assert_true(stats.clusters_dropped > 0u && whole.hit_count == CR_CLUSTERS_MAX);
    memset(&search, 0, sizeof search);
    memset(&stats, 0, sizeof stats);
    while (!cr_detect(&rig.field, &at, &few, &motion, &search, &pieces, &stats)) {
    }
    assert_int_equal(search.calls, CR_SEARCH_TICKS_MAX);
    assert_true(stats.clusters_dropped > 0u && pieces.hit_count > 0u);
    free(motion.wake_m);
    crt_close(&rig);
    crt_tool_free(&slab);
}

/* Straight into a flat wall the plane is the wall's: carried along, the depth is that of the pose at hand, once the first answer has risen. */
static void late_force_of_a_wall_is_that_of_the_pose(void **state) {
    (void)state;
    restart_with_few_lookups(&wall);
    uint32_t late = 0u, felt = 0u, rises = 0u;
    for (int i = 0; i < 200; i++) {
        const double depth = 1e-3 + 0.5e-3 * sin(0.1 * i);
        const cr_pose pose = pressed(depth);
        const cr_output out = tick(&wall, &pose);
        late += out.stats.late_ticks > 0u;
        rises = felt == 0u ? out.stats.late_ticks : rises;
        felt += out.area_count > 0u;
        if (felt >= rises) {
            assert_float_equal(out.force_world_N.z, STIFFNESS_N_M * (float)depth, ROUNDING_N);
            assert_float_equal(out.depth_m, (float)depth, ROUNDING_N / STIFFNESS_N_M);
        }
    }
    assert_true(late > 150u && felt > 180u);
}

static void late_force_ends_where_the_tool_leaves(void **state) {
    (void)state;
    cr_config damped = few_lookups();
    damped.damping_Ns_m = 50.0f;
    crt_restart(&wall, &damped);
    cr_pose pose = pressed(1e-3);
    for (int i = 0; i < 40; i++) {
        (void)tick(&wall, &pose);
    }
    uint32_t silent = 0u;
    for (int i = 0; i < 40; i++) {
        /* out of the wall and, still out of it, back towards it: nothing is felt, not even damping */
        const int step = i < 20 ? i : 31 - i / 2;
        pose = pressed(1e-3 - 0.1e-3 * step);
        const cr_output out = tick(&wall, &pose);
        assert_true(out.force_world_N.z >= 0.0f);
        assert_float_equal(v3_norm(out.normal_world), out.area_count > 0u ? 1.0f : 0.0f, 1e-5f);
        if (step > 10) {
            assert_float_equal(out.force_world_N.z, 0.0f, 0.0f);
            silent += out.area_count == 0u;
        }
    }
    assert_true(silent > 25u);
}

/* An answer that took n ticks is felt to the n-th part at first, and in full n - 1 ticks later. */
static void late_answer_rises_over_the_ticks_it_took(void **state) {
    (void)state;
    cr_config config = few_lookups();
    config.skip = 0u; /* each answer takes as long as the one before */
    crt_restart(&wall, &config);
    const cr_pose pose = pressed(1e-3);
    uint32_t rises = 0u, felt = 0u;
    for (int i = 0; i < 60; i++) {
        const cr_output out = tick(&wall, &pose);
        rises = felt == 0u ? out.stats.late_ticks : rises;
        felt += out.area_count > 0u;
        const float share = min_f(1.0f, (float)felt / (float)rises);
        assert_float_equal(out.force_world_N.z, felt > 0u ? share * STIFFNESS_N_M * 1e-3f : 0.0f, ROUNDING_N);
        assert_float_equal(out.depth_m, felt > 0u ? share * 1e-3f : 0.0f, ROUNDING_N / STIFFNESS_N_M);
    }
    assert_true(rises > 2u && felt > 40u);
}

/* Where the newest answer differs from the one before, the force goes from this one to that one in equal steps, in as many as it took. */
static void late_answer_takes_over_in_equal_steps(void **state) {
    (void)state;
    cr_pose beside = crt_pose(5e-3, 0.0, 6e-3), on = crt_pose(-4e-3, 0.0, 8.5e-3);
    beside.rot = on.rot = crt_turn(0.2, 1.0, 0.3, 0.5);
    on.rot = minus(on.rot); /* a leap of 9 mm: nothing to look ahead by */
    crt_restart(&edge, NULL);
    const cr_output prompt = tick(&edge, &on);
    restart_with_few_lookups(&edge);
    cr_output out = tick(&edge, &beside);
    for (int i = 0; i < 60; i++) {
        out = tick(&edge, &beside);
    }
    cr_vec3 steps[60], before = tick(&edge, &on).force_world_N, from = before;
    uint32_t rises = 0u, moved = 0u;
    for (int i = 0; i < 60; i++) {
        out = tick(&edge, &on);
        steps[i] = v3_sub(out.force_world_N, before);
        before = out.force_world_N;
        if (v3_norm(steps[i]) > 1e-3f) {
            rises = moved == 0u ? out.stats.late_ticks : rises;
            moved++;
            const cr_vec3 step = v3_scale(v3_sub(prompt.force_world_N, from), 1.0f / (float)rises);
            assert_float_equal(v3_norm(v3_sub(steps[i], step)), 0.0f, 2e-3f);
        }
    }
    assert_true(rises > 2u && moved == rises);
    assert_true(v3_norm(v3_sub(prompt.force_world_N, from)) > 0.5f);
    assert_float_equal(v3_norm(v3_sub(before, prompt.force_world_N)), 0.0f, 2e-3f);
}

#define SLIDES 200

/* Slides along the wall and presses or lifts, so fast a tick, with few lookups. Returns how many searches looked ahead; each where that is: on along the way by
 * one and a half times its age but for the first tick, and no more than half as deep again, or as little. */
static uint32_t slide(const cr_config *config, double first_m, double along_m, double into_m, int flips) {
    cr_pose poses[SLIDES];
    uint32_t ahead = 0u, begun = UINT32_MAX;
    int minus_it = 0;
    crt_restart(&wall, config);
    cr_world *w = wall.world;
    for (int i = 0; i < SLIDES; i++) {
        poses[i] = crt_pose(along_m * i, 0.0, HALF_M - first_m - into_m * i);
        minus_it ^= flips && !w->search.open && !w->found; /* as a search begins */
        poses[i].rot = minus_it ? minus(poses[i].rot) : poses[i].rot;
        const cr_felt last = w->answered;
        const cr_output out = tick(&wall, &poses[i]);
        assert_true(v3_is_finite(out.force_world_N));
        if (w->searched.stamp == begun) {
            continue;
        }
        begun = w->searched.stamp;
        const cr_vec3 at = w->motion.last.pos_m, now = poses[begun - 1u].pos_m;
        const uint32_t age = begun - last.stamp;
        if (!w->looks_ahead) {
            assert_float_equal(v3_norm(v3_sub(at, now)), 0.0f, 0.0f);
            continue;
        }
        assert_true(age > 1u);
        const double deep_m = HALF_M - (double)now.z, ticks = 1.5 * (age - 1u), near = 0.1 / 1.5 * ticks;
        const double then_m = fmax(0.5 * deep_m, fmin(1.5 * deep_m, deep_m + into_m * ticks));
        assert_true(fabs((double)(at.x - now.x) - along_m * ticks) < 1e-6 + along_m * near);
        assert_true(fabs((double)at.z - (HALF_M - then_m)) < 1e-6 + 0.06 * fabs(then_m - deep_m) + fabs(into_m) * near);
        ahead++;
    }
    return ahead;
}

static void search_looks_ahead_of_a_steady_motion(void **state) {
    (void)state;
    cr_config config = few_lookups();
    config.skip = 0u;
    assert_true(slide(&config, 1e-3, 1e-5, 0.0, 0) > 5u);
    assert_true(slide(&config, 1e-3, 2e-5, 1e-5, 0) > 5u);
    assert_true(slide(&config, 0.1e-3, 0.0, 2e-5, 0) > 5u);   /* more than half as deep again by then, if it went on */
    assert_true(slide(&config, 1e-3, 0.0, -4e-6, 0) > 5u);    /* and less than half */
    assert_int_equal(slide(&config, 1e-3, 1e-5, 0.0, 1), 0u); /* -q after q: as a turn that is too large */
    config.lookups_max = CR_LOOKUPS_MAX;
    assert_int_equal(slide(&config, 1e-3, 1e-5, 1e-5, 0), 0u); /* each answer in its tick */
}

/* A tool that slides off a block, its last half millimetre on it, and halts: where a search expects it to have left it is in contact still. */
static void contact_is_felt_until_it_is_left(void **state) {
    (void)state;
    cr_config config = few_lookups();
    config.skip = 0u;
    uint32_t again = 0u, halted = 0u;
    for (int k = 0; k < 20; k++) {
        uint32_t late = 0u;
        crt_restart(&edge, &config);
        const cr_world *w = edge.world;
        for (int i = 0; i < 160; i++) {
            const double on_m =
                fmax(1.2e-3 - 1.5e-5 * i, 0.05e-3 + 0.02e-3 * k); /* so far the block reaches below the tool */
            const cr_pose pose = crt_pose(HALF_M - on_m, 0.0, HALF_M - 0.02e-3);
            const cr_output out = tick(&edge, &pose);
            late += out.area_count > 0u;
            again += w->again;
            halted += on_m < 0.5e-3;
            assert_true(late < 40u || out.force_world_N.z > 0.5f * STIFFNESS_N_M * 0.02e-3f);
        }
        assert_true(late > 100u);
    }
    print_message("%u searches again\n", again);
    assert_true(again > 0u && halted > 100u);
}

/* A search that looks ahead and ends in its tick answers for another pose than that of the tick: it is told as late. */
static void answer_of_a_pose_ahead_is_late(void **state) {
    (void)state;
    cr_config config = few_lookups();
    config.skip = 0u;
    crt_restart(&wall, &config);
    cr_world *w = wall.world;
    int i = 0;
    for (; i < 40 || w->search.open || w->found; i++) {
        const cr_pose pose = crt_pose(1e-5 * i, 0.0, HALF_M - 1e-3);
        (void)tick(&wall, &pose);
    }
    config.lookups_max = CR_LOOKUPS_MAX;
    assert_int_equal(cr_world_configure(w, &config), CR_OK);
    const cr_pose first = crt_pose(1e-5 * i, 0.0, HALF_M - 1e-3), second = crt_pose(1e-5 * (i + 1), 0.0, HALF_M - 1e-3);
    cr_output out = tick(&wall, &first);
    assert_true(w->looks_ahead && !w->search.open && !w->found);
    assert_int_equal(out.stats.late_ticks, 1u);
    assert_int_equal(out.zone_count, 0u);
    assert_float_equal(out.force_world_N.z, 1.0f, ROUNDING_N);
    out = tick(&wall, &second);
    assert_true(!w->looks_ahead);
    assert_int_equal(out.stats.late_ticks, 0u);
    assert_true(out.zone_count > 0u);
    assert_float_equal(out.force_world_N.z, 1.0f, ROUNDING_N);
}

/* A tool at rest: the late answer is that of an unlimited search, but for rounding. */
static void late_force_at_rest_is_the_whole_one(void **state) {
    (void)state;
    cr_pose pose = crt_pose(5e-3, 0.0, 6e-3);
    pose.rot = crt_turn(0.2, 1.0, 0.3, 0.5);
    crt_restart(&edge, NULL);
    const cr_output prompt = tick(&edge, &pose);
    restart_with_few_lookups(&edge);
    cr_output out = tick(&edge, &pose);
    assert_int_equal(prompt.stats.late_ticks, 0u);
    assert_true(out.stats.late_ticks > 0u && out.area_count == 0u);
    for (int i = 0; i < 40; i++) {
        out = tick(&edge, &pose);
    }
    assert_true(prompt.depth_m > 0.5e-3f && out.stats.late_ticks > 0u);
    assert_float_equal(v3_norm(v3_sub(out.force_world_N, prompt.force_world_N)), 0.0f, 1e-3f);
    assert_float_equal(v3_norm(v3_sub(out.torque_world_Nm, prompt.torque_world_Nm)), 0.0f, 1e-5f);
    assert_float_equal(v3_norm(v3_sub(out.display_pose.pos_m, prompt.display_pose.pos_m)), 0.0f, 1e-6f);
}

/* How old an answer is: it counts up from that of a search's pose, and is zero again when one tick is enough. */
static void late_ticks_tell_the_age_of_the_answer(void **state) {
    (void)state;
    restart_with_few_lookups(&wall);
    const cr_pose pose = pressed(1e-3), away = crt_pose(0.0, 0.0, 0.2);
    uint32_t before = 0u;
    for (int i = 0; i < 60; i++) {
        const cr_output out = tick(&wall, &pose);
        assert_true(out.stats.late_ticks == before + 1u || (out.stats.late_ticks <= before && out.area_count > 0u));
        assert_true(out.stats.late_ticks < 20u);
        before = out.stats.late_ticks;
    }
    cr_output out = tick(&wall, &away);
    for (int i = 0; i < 20; i++) {
        out = tick(&wall, &away);
    }
    assert_int_equal(out.stats.late_ticks, 0u);
    assert_int_equal(out.area_count, 0u);
}

static void late_contact_is_forgotten_by_a_fault(void **state) {
    (void)state;
    restart_with_few_lookups(&wall);
    const cr_pose pose = pressed(1e-3), away = crt_pose(0.0, 0.0, 0.2), bad = crt_pose((double)NAN, 0.0, 0.0);
    for (int i = 0; i < 30; i++) {
        (void)tick(&wall, &pose);
    }
    assert_true(tick(&wall, &bad).faults != 0u);
    cr_world_clear_fault(wall.world);
    const cr_output out = tick(&wall, &away);
    assert_int_equal(out.faults, 0u);
    assert_int_equal(out.area_count, 0u);
    assert_float_equal(v3_norm(out.force_world_N), 0.0f, 0.0f);
}

static void late_settings_begin_the_search_anew(void **state) {
    (void)state;
    restart_with_few_lookups(&wall);
    const cr_pose pose = pressed(1e-3);
    assert_true(tick(&wall, &pose).stats.late_ticks > 0u);
    const cr_config config = cr_config_default();
    assert_int_equal(cr_world_configure(wall.world, &config), CR_OK);
    const cr_output out = tick(&wall, &pose);
    assert_int_equal(out.stats.late_ticks, 0u);
    assert_float_equal(out.force_world_N.z, 1.0f, ROUNDING_N);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_a_search_cannot_see_in_its_time_is_left_out),
        cmocka_unit_test(zones_gathered_in_pieces_are_the_same_to_the_bit),
        cmocka_unit_test(depths_measured_in_pieces_are_the_same_to_the_bit),
        cmocka_unit_test(zones_that_join_in_steps_are_the_same_to_the_bit),
        cmocka_unit_test(late_force_of_a_wall_is_that_of_the_pose),
        cmocka_unit_test(late_force_ends_where_the_tool_leaves),
        cmocka_unit_test(late_answer_rises_over_the_ticks_it_took),
        cmocka_unit_test(late_answer_takes_over_in_equal_steps),
        cmocka_unit_test(search_looks_ahead_of_a_steady_motion),
        cmocka_unit_test(answer_of_a_pose_ahead_is_late),
        cmocka_unit_test(contact_is_felt_until_it_is_left),
        cmocka_unit_test(late_force_at_rest_is_the_whole_one),
        cmocka_unit_test(late_ticks_tell_the_age_of_the_answer),
        cmocka_unit_test(late_contact_is_forgotten_by_a_fault),
        cmocka_unit_test(late_settings_begin_the_search_anew),
    };
    return cmocka_run_group_tests(tests, open_rigs, close_rigs);
}
