/* cr_search and cr_feel: the letters between them under every interleaving, and what is felt whatever their rates. */
#include <stdint.h>
static void step(void);
#define CR_MAILBOX_STEP() step()
#include "contact/mailbox.h"
#include "contact/world.h"
#include "image_builder.h"
#include "rise.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>
#include <ucontext.h>

#include <cmocka.h>

#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define PERIOD_S 1e-3f
#define STIFFNESS_N_M 1000.0f
/* The distances of the image are rounded to this, and the force with them. */
#define ROUNDING_N 2e-3f

/* -------------------------------------------------------------------------------------------------------- letters */

#define WORDS 2u
#define PUTS 3u
#define TAKES 2u
#define STACK_BYTES 65536
#define STEPS_MAX 64u

enum { WRITER, READER, SIDES };

static struct {
    ucontext_t side[SIDES], here;
    int active[SIDES]; /* has not come to its end */
    int running;       /* the side at work, or SIDES */
    _Atomic uint32_t put, place[2u * WORDS];
    uint32_t put_whole; /* letters that are there */
    uint32_t taken, least,
        disturbed; /* by the reader: the last letter, how old it may be, steps of the writer meanwhile */
    uint32_t whole_takes, given_up, torn;
} run;
static uint8_t stacks[SIDES][STACK_BYTES] __attribute__((aligned(16)));

/* Before each access to memory the other side may go on. */
static void step(void) {
    if (run.running < SIDES) {
        (void)swapcontext(&run.side[run.running], &run.here);
    }
}

static void write_letters(void) {
    for (uint32_t n = 1; n <= PUTS; n++) {
        const uint32_t letter[WORDS] = {n, n};
        cr_mailbox_put(&run.put, run.place, letter, WORDS);
        run.put_whole = n;
    }
    run.active[WRITER] = 0;
}

static void read_letters(void) {
    uint32_t seen = 0u;
    for (uint32_t n = 0; n < TAKES; n++) {
        uint32_t letter[WORDS] = {0u, 0u};
        run.least = run.put_whole;
        run.disturbed = 0u;
        if (cr_mailbox_take(&run.put, run.place, letter, WORDS, &seen)) {
            run.torn += letter[0] != letter[1] || letter[0] != seen || letter[0] <= run.taken || letter[0] < run.least;
            run.taken = letter[0];
            run.whole_takes++;
        } else {
            /* nothing new, or disturbed at least once in each try */
            run.torn += run.least > run.taken && run.disturbed < CR_MAILBOX_TRIES;
            run.given_up += run.least > run.taken;
        }
    }
    run.active[READER] = 0;
}

static void start(int side, void (*what)(void)) {
    (void)getcontext(&run.side[side]);
    run.side[side].uc_stack.ss_sp = stacks[side];
    run.side[side].uc_stack.ss_size = STACK_BYTES;
    run.side[side].uc_link = &run.here;
    run.active[side] = 1;
    makecontext(&run.side[side], what, 0);
}

static void go_on(int side) {
    run.running = side;
    (void)swapcontext(&run.here, &run.side[side]);
    run.running = SIDES;
    run.disturbed += side == WRITER;
}

/* One run: side[0..given) as told, then the writer first. Returns how many turns there were a choice for; side says who had them. */
static uint32_t run_once(uint8_t *side, uint32_t given) {
    uint32_t choices = 0u;
    memset(&run, 0, sizeof run);
    run.running = SIDES;
    start(WRITER, write_letters);
    start(READER, read_letters);
    while (run.active[WRITER] || run.active[READER]) {
        int who = run.active[WRITER] ? WRITER : READER;
        if (run.active[WRITER] && run.active[READER]) {
            assert_true(choices < STEPS_MAX);
            if (choices >= given) {
                side[choices] = WRITER;
            }
            who = side[choices++];
        }
        go_on(who);
    }
    return choices;
}

static void mailbox_letters_are_whole_and_newest_whoever_goes_first(void **state) {
    (void)state;
    uint8_t side[STEPS_MAX];
    uint32_t given = 0u, runs = 0u, torn = 0u, whole = 0u, given_up = 0u;
    for (int more = 1; more;) {
        uint32_t choices = run_once(side, given);
        runs++;
        torn += run.torn;
        whole += run.whole_takes;
        given_up += run.given_up;
        /* the next one in order: the last turn of the writer is given to the reader */
        while (choices > 0u && side[choices - 1u] == READER) {
            choices--;
        }
        more = choices > 0u;
        if (more) {
            side[choices - 1u] = READER;
            given = choices;
        }
    }
    print_message("%u runs, %u letters taken, %u readings given up\n", runs, whole, given_up);
    assert_int_equal(torn, 0u);
    assert_true(runs > 10000u && whole > 10000u && given_up > 0u);
}

/* ------------------------------------------------------------------------------------------------------------- rates */

static crt_rig wall, edge;

static int open_rigs(void **state) {
    (void)state;
    const crt_solid flat = crt_box(-40e-3, 40e-3, 40e-3, -40e-3, 0.0), bent = crt_box(-40e-3, 0.0, 40e-3, -40e-3, 0.0);
    crt_open_cube(&wall, &flat, HALF_M, 0.5e-3, VOXEL_M);
    crt_open_cube(&edge, &bent, HALF_M, 0.5e-3, VOXEL_M);
    return 0;
}

static int close_rigs(void **state) {
    (void)state;
    crt_close(&wall);
    crt_close(&edge);
    return 0;
}

static void restart(crt_rig *rig) {
    cr_config config = cr_config_default();
    config.stiffness_N_m = STIFFNESS_N_M;
    crt_restart(rig, &config);
}

static cr_output feel(const crt_rig *rig, const cr_pose *pose) {
    cr_output out;
    memset(&out, 0xa5, sizeof out);
    cr_feel(rig->world, pose, PERIOD_S, &out);
    return out;
}

static void search_whole(const crt_rig *rig) {
    while (cr_search(rig->world, 64u) > 0u) {
    }
}

static cr_pose pressed(double depth_m) { return crt_pose(0.0, 0.0, HALF_M - depth_m); }

static void search_rests_until_a_pose_is_felt(void **state) {
    (void)state;
    restart(&wall);
    assert_int_equal(cr_search(wall.world, 64u), 0u);
    const cr_pose pose = pressed(1e-3);
    assert_int_equal(feel(&wall, &pose).area_count, 0u);
    assert_true(cr_search(wall.world, 64u) > 0u);
    search_whole(&wall);
    assert_int_equal(cr_search(wall.world, 64u), 0u);
    const cr_output out = feel(&wall, &pose);
    assert_int_equal(out.stats.late_ticks, 1u);
    assert_float_equal(out.force_world_N.z, STIFFNESS_N_M * 1e-3f, ROUNDING_N);
    assert_true(cr_search(wall.world, 64u) > 0u);
}

/* At rest it is what one tick answers, whatever the work of a slice: but for the rounding of what is carried. */
static void feel_at_rest_is_the_tick_whatever_the_slice(void **state) {
    (void)state;
    cr_pose pose = crt_pose(5e-3, 0.0, 6e-3);
    pose.rot = crt_turn(0.2, 1.0, 0.3, 0.5);
    restart(&edge);
    cr_output once;
    cr_tick(edge.world, &pose, PERIOD_S, &once);
    assert_true(once.depth_m > 0.5e-3f && once.stats.late_ticks == 0u);
    for (uint32_t work = 0u; work < 3000u; work = 3u * work + 1u) {
        restart(&edge);
        (void)feel(&edge, &pose);
        while (cr_search(edge.world, work) > 0u) {
        }
        const cr_output out = feel(&edge, &pose);
        assert_int_equal(out.area_count, once.area_count);
        assert_float_equal(v3_norm(v3_sub(out.force_world_N, once.force_world_N)), 0.0f, 1e-3f);
        assert_float_equal(v3_norm(v3_sub(out.torque_world_Nm, once.torque_world_Nm)), 0.0f, 1e-5f);
        assert_int_equal(out.zone_count, 0u);
    }
}

/* Ten feels to a slice, ten slices to a feel, or now so and now so, when an answer comes before the last has risen: a wall is carried exactly. Once the first answer has risen, how old its plane is shows in nothing but
 * late_ticks. */
static void feel_of_a_wall_is_that_of_the_pose_at_any_rate(void **state) {
    (void)state;
    uint32_t seed = 7u;
    for (uint32_t rate = 0; rate < 4u; rate++) {
        restart(&wall);
        uint32_t felt = 0u, oldest = 0u, before = 0u;
        crt_rise first = {0u, 0u, 0, 0u};
        for (int i = 0; i < 2000; i++) {
            const double depth = 1e-3 + 0.5e-3 * sin(0.01 * i);
            const cr_pose pose = pressed(depth);
            const cr_output out = feel(&wall, &pose);
            seed = seed * 1664525u + 1013904223u;
            const uint32_t slices[4] = {i % 10 == 0, 1u, 10u, (seed >> 30) * (uint32_t)(i / 20 % 3)};
            for (uint32_t n = 0; n < slices[rate]; n++) {
                (void)cr_search(wall.world, 48u);
            }
            felt += out.area_count > 0u;
            if (crt_has_risen(&first, felt > 0u, before, out.stats.late_ticks)) {
                assert_float_equal(out.force_world_N.z, STIFFNESS_N_M * (float)depth, ROUNDING_N);
                oldest = out.stats.late_ticks > oldest ? out.stats.late_ticks : oldest;
            }
            before = out.stats.late_ticks;
        }
        assert_true(felt > 1500u && oldest >= (rate == 2u ? 1u : 5u));
    }
}

/* The top of the block with an edge, as the bake describes it: 40 mm along x, 80 along y, with all of its ends or those alone that are given. */
static void describe_top(const crt_rig *rig, uint8_t ends) {
    struct cr_img_facet *top = (struct cr_img_facet *)crt_section(rig->image, CR_SEC_FACETS) + 2;
    assert_float_equal(top->normal[2], 1.0f, 0.0f);
    top->along[0] = 32767;
    top->along[1] = top->along[2] = 0;
    top->low_m[0] = top->low_m[1] = -40e-3f;
    top->high_m[0] = 0.0f;
    top->high_m[1] = 40e-3f;
    top->ends = ends;
}

/* A contact is searched for once, 10 mm of the cube over the block and 1 mm deep, and felt along a way from there.   Output  depths that were felt.
 * Returns how far its point was from the edge, m, in the middle of what is over the block, and half the size of that more. */
static float feel_along(crt_rig *rig, uint8_t ends, double x_m, double deeper_m, float *depth_m, int count) {
    float margin_m = 0.0f;
    restart(rig);
    describe_top(rig, ends);
    const cr_pose at = crt_pose(-2e-3, 0.0, HALF_M - 1e-3);
    (void)feel(rig, &at);
    search_whole(rig);
    for (int i = 0; i < count; i++) {
        const double part = (double)i / (count - 1);
        const cr_pose pose = crt_pose(-2e-3 + part * x_m, 0.0, HALF_M - 1e-3 - part * deeper_m);
        const cr_output out = feel(rig, &pose);
        assert_int_equal(out.faults, 0u);
        depth_m[i] = out.force_world_N.z / STIFFNESS_N_M;
        margin_m = i == 0 ? -out.areas[0].point_world_m.x : margin_m;
    }
    assert_float_equal(depth_m[0], 1e-3f, 2e-6f);
    assert_float_equal(margin_m, 5e-3f, 0.3e-3f);
    return margin_m + 0.5f * sqrtf(10e-3f * 16e-3f);
}

#define WAY 201
/* Slid over the edge a contact ends within the millimetre that it is deep once what was inside has left the face, as far as its size tells, and pressed it is felt to
 * the way out at the edge, not on and on. Where the surface goes on, or ends on the other side alone, it is felt as a plane without end. So near the edge the planes are 0.4 degrees askew. */
static void contact_is_not_felt_where_its_face_has_ended(void **state) {
    (void)state;
    static float slid_m[WAY], pressed_m[WAY];
    const uint8_t ends[3] = {15u, 2u, 4u | 8u | 1u};
    for (int k = 0; k < 3; k++) {
        const float margin_m = feel_along(&edge, ends[k], 20e-3, 0.0, slid_m, WAY);
        (void)feel_along(&edge, ends[k], 0.0, 20e-3, pressed_m, WAY);
        const float most_m = 1e-3f + margin_m;
        for (int i = 0; i < WAY; i++) {
            const float gone_m = 20e-3f * (float)i / (WAY - 1);
            if (k == 2) {
                assert_float_equal(slid_m[i], 1e-3f, 0.15e-3f);
                assert_float_equal(pressed_m[i], 1e-3f + gone_m, 4e-6f);
                continue;
            }
            assert_float_equal(slid_m[i], fmaxf(0.0f, fminf(1e-3f, most_m - gone_m)), 0.4e-3f);
            assert_float_equal(pressed_m[i], fminf(1e-3f + gone_m, most_m), 0.4e-3f);
        }
    }
}

static void feel_with_a_bad_pose_forgets_what_is_searched_for(void **state) {
    (void)state;
    restart(&wall);
    const cr_pose pose = pressed(1e-3), away = crt_pose(0.0, 0.0, 0.2), bad = crt_pose((double)NAN, 0.0, 0.0);
    (void)feel(&wall, &pose);
    (void)cr_search(wall.world, 32u); /* begun, not at its end */
    assert_int_equal(feel(&wall, &bad).faults, CR_FAULT_POSE);
    search_whole(&wall);
    cr_world_clear_fault(wall.world);
    cr_output out = feel(&wall, &away);
    assert_true(out.faults == 0u && out.area_count == 0u);
    out = feel(&wall, &pose);
    assert_int_equal(out.area_count, 0u);
    search_whole(&wall);
    assert_float_equal(feel(&wall, &pose).force_world_N.z, STIFFNESS_N_M * 1e-3f, ROUNDING_N);
}

/* A tool at rest, and answers that all say the same, each before the last has risen: whatever falls behind it, the force stays. */
static void answers_that_say_the_same_change_nothing(void **state) {
    (void)state;
    const cr_pose pose = pressed(1e-3);
    for (uint32_t count = 1u; count <= CR_AREAS_MAX; count++) {
        cr_hand answer = {.count = count};
        restart(&wall);
        cr_world *w = wall.world;
        for (uint32_t i = 0; i < count; i++) {
            answer.held[i] = (cr_held){
                .normal_world = {0.0f, 0.0f, 1.0f}, .offset_m = (float)HALF_M, .share = 1.0f, .facet = CR_FACET_NONE};
        }
        const float all_N = (float)count * STIFFNESS_N_M * 1e-3f;
        uint32_t next = 12u;
        for (uint32_t k = 1u; k < 200u; k++) {
            if (k == next) {
                answer.stamp = w->felt.stamp + 1u - (k == 12u ? 1u : 2u + k % 9u); /* the first is felt at once */
                answer.memory = w->felt.memory;
                cr_mailbox_put(&w->hands, w->hand_words, &answer, CR_WORDS_OF(cr_hand));
                next += 1u + k % 4u;
            }
            const cr_output out = feel(&wall, &pose);
            assert_float_equal(out.force_world_N.z, k < 12u ? 0.0f : all_N, ROUNDING_N);
        }
    }
}

/* As many half-spaces in hand as there is room for, and more that fall behind them: these are not felt, and counted. */
static void areas_beyond_room_are_counted(void **state) {
    (void)state;
    restart(&wall);
    cr_world *w = wall.world;
    const cr_pose pose = pressed(1e-3);
    const cr_held flat = {
        .normal_world = {0.0f, 0.0f, 1.0f}, .offset_m = (float)HALF_M, .share = 1.0f, .facet = CR_FACET_NONE};
    (void)feel(&wall, &pose);
    w->hand.count = CR_AREAS_MAX;
    w->behind.count = 2u;
    w->in_hand = CR_AREAS_MAX + 2u;
    for (uint32_t i = 0; i < CR_AREAS_MAX; i++) {
        w->hand.held[i] = flat;
    }
    for (uint32_t i = 0; i < 2u; i++) {
        w->behind.held[i] = flat;
        w->behind.share[i] = 1.0f;
    }
    w->taken = w->felt.stamp;
    w->hand.stamp = w->felt.stamp - 10u;
    w->rises = 10u; /* two tenths of it have risen at the next feel */
    const cr_output out = feel(&wall, &pose);
    assert_int_equal(out.area_count, CR_AREAS_MAX);
    assert_int_equal(out.stats.areas_merged, 2u);
    assert_float_equal(out.areas[0].depth_m, 0.2f * 1e-3f, ROUNDING_N / STIFFNESS_N_M);
    assert_float_equal(out.force_world_N.z, 0.2f * (float)CR_AREAS_MAX * STIFFNESS_N_M * 1e-3f, 0.1f);
}

/* A contact that answers of one feel say is gone falls over as many feels as nothing was said of it, whatever comes meanwhile; what comes then is felt in full. */
static void what_was_felt_falls_over_the_feels_that_it_was_not_corrected_for(void **state) {
    (void)state;
    const cr_pose pose = pressed(1e-3);
    for (uint32_t old = 1u; old < 9u; old++) {
        cr_hand answer = {.count = 0u};
        restart(&wall);
        cr_world *w = wall.world;
        for (uint32_t k = 0u; k < 20u; k++) {
            (void)feel(&wall, &pose);
        }
        w->hand.count = w->in_hand = 1u;
        w->hand.held[0] = (cr_held){
            .normal_world = {0.0f, 0.0f, 1.0f}, .offset_m = (float)HALF_M, .share = 1.0f, .facet = CR_FACET_NONE};
        w->hand.stamp = w->felt.stamp - old;
        answer.memory = w->felt.memory;
        for (uint32_t k = 1u; k < 20u; k++) {
            answer.stamp = w->felt.stamp;
            cr_mailbox_put(&w->hands, w->hand_words, &answer, CR_WORDS_OF(cr_hand));
            const float left = k < old ? 1.0f - (float)k / (float)old : 0.0f;
            assert_float_equal(feel(&wall, &pose).force_world_N.z, left * STIFFNESS_N_M * 1e-3f, ROUNDING_N);
        }
        answer.count = 1u;
        answer.held[0] = w->hand.held[0];
        answer.stamp = w->felt.stamp;
        cr_mailbox_put(&w->hands, w->hand_words, &answer, CR_WORDS_OF(cr_hand));
        assert_float_equal(feel(&wall, &pose).force_world_N.z, STIFFNESS_N_M * 1e-3f, ROUNDING_N);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(mailbox_letters_are_whole_and_newest_whoever_goes_first),
        cmocka_unit_test(search_rests_until_a_pose_is_felt),
        cmocka_unit_test(feel_at_rest_is_the_tick_whatever_the_slice),
        cmocka_unit_test(feel_of_a_wall_is_that_of_the_pose_at_any_rate),
        cmocka_unit_test(contact_is_not_felt_where_its_face_has_ended),
        cmocka_unit_test(feel_with_a_bad_pose_forgets_what_is_searched_for),
        cmocka_unit_test(answers_that_say_the_same_change_nothing),
        cmocka_unit_test(areas_beyond_room_are_counted),
        cmocka_unit_test(what_was_felt_falls_over_the_feels_that_it_was_not_corrected_for),
    };
    return cmocka_run_group_tests(tests, open_rigs, close_rigs);
}
