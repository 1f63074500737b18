/* controller.c of the Cortex-M port, as it is, on a board made of simulated time: the drives at the other end of a wire on which every
 * frame takes its bits. An STM32 loop comes up there, or it does not. */
#include "image_builder.h"
#include "servo/servo_stages.h"
#include "wire.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* The loop's own main, with searches that take time, and the scene's place in flash. */
static uint32_t search_that_takes_time(cr_servo *servo, uint32_t work);
#define main controller_main
#define cr_servo_search search_that_takes_time
#include "../../firmware/port/cortex-m7/controller.c"
#undef cr_servo_search
#undef main

#define SCENE_ROOM "1048576"
_Alignas(64) uint8_t crt_flash[1048576];
__asm__(".globl _scene_start\n.set _scene_start, crt_flash\n"
        ".globl _scene_room_end\n.set _scene_room_end, crt_flash + " SCENE_ROOM "\n");

#define PERIOD_NS 1000000u
#define BIT_NS 1000u
#define REACTION_NS 20000u
#define TICK_COST_NS 210000u /* the budget: crease bus --schedule */
#define STEP_NS 21000u       /* a step of the search: a cube on an edge, on an emulated M7 */
#define CLOCK_NS 1000u       /* how far a look at the clock moves it */

static struct {
    cr_sim *sim;
    cr_wire *wire;
    uint64_t now_ns, due_ns;
    uint32_t periods, periods_max, slept_over, enabled_at;
    cr_servo_counters counters;
    uint32_t mode, faults;
    uint64_t step_ns; /* what a step of the search takes */
    uint64_t long_ns; /* and what each long_every-th one does, from long_from on until long_left are made */
    uint32_t long_from, long_every, long_left;
    uint32_t steps, oldest; /* made; contact that was felt, ticks */
    uint64_t late_ns;       /* of a SYNC after its time, at most, once the drives are enabled */
    jmp_buf over;
} board;

/* ---- board.h and can.h ----------------------------------------------------------------------------------------------- */

cr_servo_config board_settings(void) {
    cr_servo_config config = cr_servo_config_default();
    config.late_max_ticks = BOARD_LATE_MAX_TICKS;
    return config;
}
int board_start(void) { return 0; }
uint64_t board_due_ns(void) { return board.due_ns; }

static uint32_t search_that_takes_time(cr_servo *servo, uint32_t work) {
    const uint32_t done = cr_servo_search(servo, work);
    if (done > 0u) {
        const int is_long =
            board.long_left > 0u && board.steps >= board.long_from && board.steps % board.long_every == 0u;
        board.now_ns += is_long ? board.long_ns : board.step_ns;
        board.long_left -= is_long ? 1u : 0u;
        board.steps++;
    }
    return done;
}

uint32_t board_wait_period(void) {
    uint32_t slept_over = 0u;
    board.now_ns = board.now_ns < board.due_ns ? board.due_ns : board.now_ns;
    const uint64_t late_ns = board.now_ns - board.due_ns;
    board.late_ns = board.enabled_at > 0u && late_ns > board.late_ns ? late_ns : board.late_ns;
    for (; board.due_ns + PERIOD_NS <= board.now_ns; board.due_ns += PERIOD_NS) {
        slept_over++;
    }
    board.due_ns += PERIOD_NS;
    board.slept_over += board.enabled_at > 0u ? slept_over : 0u;
    return slept_over;
}

uint64_t board_now_ns(void) {
    board.now_ns += CLOCK_NS;
    return board.now_ns;
}

uint32_t board_commands(uint32_t mode) {
    board.enabled_at = board.enabled_at == 0u && mode >= CR_MODE_CALIBRATING && mode != CR_MODE_FAULT
                           ? board.periods
                           : board.enabled_at;
    return mode == CR_MODE_IDLE ? CR_COMMAND_START : 0u;
}

void board_keep(const cr_record *record) {
    board.mode = record->mode;
    board.faults = record->faults;
    board.counters = record->counters;
    const uint32_t late = record->contact_late_ticks == CR_NOT_FELT ? 0u : record->contact_late_ticks;
    board.oldest = late > board.oldest ? late : board.oldest;
    if (++board.periods == board.periods_max) {
        longjmp(board.over, 1);
    }
}

_Noreturn void board_stop(uint32_t why) {
    (void)why;
    abort();
}

int can_start(void) { return 0; }
void can_stop(void) {}
void can_wait(void) {}
int can_was_off(void) { return 0; }
uint32_t can_lost(void) { return 0u; }

int can_send(const cr_frame *frame) {
    cr_sim_frame out = {.id = frame->id, .len = frame->size};
    memcpy(out.data, frame->data, sizeof out.data);
    if (frame->id == 0x181u) {
        board.now_ns += TICK_COST_NS; /* the tick is over when its torque frame is handed over */
    }
    return cr_wire_put(board.wire, &out, board.now_ns);
}

int can_receive(cr_frame *frame) {
    cr_sim_frame in;
    uint64_t at_ns;
    if (!cr_wire_get(board.wire, board.now_ns, &in, &at_ns)) {
        return 0;
    }
    *frame = (cr_frame){(uint16_t)in.id, in.len, 0u, {0}};
    memcpy(frame->data, in.data, in.len);
    return 1;
}

/* ---- the tests ------------------------------------------------------------------------------------------------------- */

static void run_loop_with(uint32_t periods, uint64_t step_ns, uint64_t long_ns, uint32_t long_from, uint32_t long_every,
                          uint32_t long_left) {
    const cr_sim_params params = cr_sim_params_default();
    memset(&board, 0, sizeof board);
    board.long_ns = long_ns;
    board.long_from = long_from;
    board.long_every = long_every;
    board.long_left = long_left;
    board.sim = cr_sim_create(&params, 0u, 0u);
    board.wire = cr_wire_create(board.sim, BIT_NS, REACTION_NS, 0u);
    board.periods_max = periods;
    board.step_ns = step_ns;
    board.due_ns = PERIOD_NS;
    if (setjmp(board.over) == 0) {
        controller_main();
    }
    cr_wire_destroy(board.wire);
    cr_sim_destroy(board.sim);
}

static void run_loop(uint32_t periods, uint64_t step_ns) { run_loop_with(periods, step_ns, 0u, 0u, 1u, 0u); }

static int build_flash(void **state) {
    (void)state;
    const crt_solid block = crt_box(-0.06, 0.06, 0.06, -0.06, -0.028);
    const double centre_m[3] = {0.0, 0.0, 0.0}, half_m[3] = {0.03, 0.03, 0.03};
    uint32_t bytes = 0u;
    crt_tool cube = crt_tool_new(0.003); /* in contact from the start, and many steps of the search */
    crt_add_box(&cube, centre_m, half_m);
    uint8_t *image = crt_image(&block, &cube, 0.004, &bytes);
    assert_true(bytes <= sizeof crt_flash);
    memcpy(crt_flash, image, bytes);
    free(image);
    crt_tool_free(&cube);
    return 0;
}

static void loop_of_the_controller_comes_up_on_a_bus_with_bit_times(void **state) {
    (void)state;
    run_loop(3000u, STEP_NS);
    assert_int_equal(board.faults, 0);
    assert_true(cr_mode_is_rendering(board.mode));
    assert_in_range(board.enabled_at, 500u, 2000u);
    print_message("controller: enabled after %u periods, SYNC at most %.0f us late\n", (unsigned)board.enabled_at,
                  (double)board.late_ns * 1e-3);
}

static void loop_of_the_controller_misses_no_state_once_it_runs(void **state) {
    (void)state;
    run_loop(6000u, STEP_NS);
    const cr_servo_counters *c = &board.counters;
    assert_true(c->missing[0] == 0u && c->missing[1] == 0u && c->missing[2] == 0u);
    assert_true(c->late == 0u && c->send_failed == 0u && c->overruns == 0u && c->wrist_missing == 0u);
    assert_true(board.slept_over == 0u && board.late_ns < 50000u);
    print_message("%u steps of the search, contact up to %u ticks old\n", (unsigned)board.steps,
                  (unsigned)board.oldest);
    assert_true(board.steps > 50000u && board.oldest <= 10u); /* all of them where the loop waits */
}

/* Steps as long as those of a spanner on an emulated M7, and longer: SYNC does not wait, contact gets older. */
static void long_steps_of_the_search_hold_up_no_period(void **state) {
    (void)state;
    static const uint64_t step_ns[] = {60000u, 115000u};
    for (uint32_t i = 0; i < sizeof step_ns / sizeof *step_ns; i++) {
        run_loop(4000u, step_ns[i]);
        const cr_servo_counters *c = &board.counters;
        print_message("steps of %.0f us: %u made, contact up to %u ticks old, SYNC at most %.0f us late\n",
                      (double)step_ns[i] * 1e-3, (unsigned)board.steps, (unsigned)board.oldest,
                      (double)board.late_ns * 1e-3);
        assert_int_equal(board.faults, 0);
        assert_true(cr_mode_is_rendering(board.mode) && c->overruns == 0u && c->send_failed == 0u);
        assert_true(board.slept_over == 0u && board.late_ns < 50000u);
        assert_true(board.oldest >= 1u && board.oldest <= BOARD_LATE_MAX_TICKS);
    }
}

/* The loop has been in contact for a while, steps are short, and one takes most of a period. */
static void one_long_step_does_not_slow_the_search_for_good(void **state) {
    (void)state;
    run_loop(6000u, STEP_NS);
    const uint32_t without = board.steps;
    run_loop_with(6000u, STEP_NS, 700000u, without / 2u, 1u, 1u);
    print_message("%u steps of the search, one of them long; %u without it; contact up to %u ticks old\n",
                  (unsigned)board.steps, (unsigned)without, (unsigned)board.oldest);
    assert_true(board.long_left == 0u && board.slept_over == 0u);
    assert_true(board.faults == 0u && cr_mode_is_rendering(board.mode));
    assert_true(board.steps > without - without / 20u && board.oldest <= BOARD_LATE_MAX_TICKS);
}

/* One step of each answer takes longer than the others. */
static void a_long_step_that_comes_again_holds_up_no_period(void **state) {
    (void)state;
    run_loop_with(6000u, STEP_NS, 115000u, 0u, 300u, UINT32_MAX);
    print_message("SYNC at most %.0f us late\n", (double)board.late_ns * 1e-3);
    assert_true(board.faults == 0u && cr_mode_is_rendering(board.mode));
    assert_true(board.late_ns < 50000u && board.counters.overruns == 0u);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(loop_of_the_controller_comes_up_on_a_bus_with_bit_times),
        cmocka_unit_test(loop_of_the_controller_misses_no_state_once_it_runs),
        cmocka_unit_test(long_steps_of_the_search_hold_up_no_period),
        cmocka_unit_test(one_long_step_does_not_slow_the_search_for_good),
        cmocka_unit_test(a_long_step_that_comes_again_holds_up_no_period),
    };
    return cmocka_run_group_tests(tests, build_flash, NULL);
}
