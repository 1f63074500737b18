/* controller.c of the Cortex-M port, as it is, on a board made of simulated time: the drives at the other end of a wire on which every
 * frame takes its bits, and the clock's interrupt in the middle of whatever the main loop does. An STM32 loop comes up there, or it does not. */
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

#define BIT_NS 1000u
#define REACTION_NS 20000u
#define TICK_COST_NS 210000u /* the budget: crease bus --schedule */
#define SLOW_TICK_NS 1600000u
#define STEP_NS 15400u /* a step of the search: a cube on an edge, at most 7,400 instructions of an emulated M7 */
#define STEP_WORK 1u
#define CLOCK_NS 1000u /* how far a look at the clock moves it */

static struct {
    cr_sim *sim;
    cr_wire *wire;
    uint64_t now_ns, begun_ns, slot_ns; /* the clock's next interrupt */
    uint32_t periods, periods_max, enabled_at;
    cr_servo_counters counters;
    uint32_t mode, faults;
    uint64_t step_ns;  /* what a step of the search takes */
    uint32_t slow_at;  /* from this tick on the core is slow */
    uint64_t stall_ns; /* what holds up the interrupt after tick stall_at */
    uint32_t stall_at;
    uint32_t steps, oldest; /* made; contact that was felt, ticks */
    uint64_t late_ns;       /* of a SYNC after its time, at most, once the drives are enabled */
    uint64_t tick_late_ns;  /* of a tick after its SYNC, at most */
    jmp_buf over;
} board;

/* ---- board.h and can.h ----------------------------------------------------------------------------------------------- */

cr_servo_config board_settings(void) {
    cr_servo_config config = cr_servo_config_default();
    config.late_max_ticks = BOARD_LATE_MAX_TICKS;
    return config;
}
int board_start(void) { return 0; }
void board_begin(void) {
    board.begun_ns = board.now_ns;
    board.slot_ns = board.now_ns + BOARD_SLOT_NS;
}

/* The next interrupt, at its time or when the last is through; those that were missed meanwhile are one. */
static void take_slot(void) {
    board.now_ns = board.now_ns < board.slot_ns ? board.slot_ns : board.now_ns;
    board.now_ns += board.periods > 0u && board.periods == board.stall_at ? board.stall_ns : 0u;
    board.stall_at = board.periods == board.stall_at ? 0u : board.stall_at;
    board.slot_ns += (1u + (board.now_ns - board.slot_ns) / BOARD_SLOT_NS) * BOARD_SLOT_NS;
    board_systick();
}

/* The main loop does something for so long. */
static void pass_time(uint64_t for_ns) {
    while (board.now_ns + for_ns >= board.slot_ns) {
        for_ns -= board.slot_ns > board.now_ns ? board.slot_ns - board.now_ns : 0u;
        take_slot();
    }
    board.now_ns += for_ns;
}

static uint32_t search_that_takes_time(cr_servo *servo, uint32_t work) {
    const uint32_t done = cr_servo_search(servo, work < STEP_WORK ? work : STEP_WORK);
    if (done > 0u) {
        pass_time(board.step_ns);
        board.steps++;
    }
    return done;
}

void board_sleep(const volatile uint32_t *count, uint32_t seen) {
    if (*count == seen) {
        take_slot();
    }
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
    board.faults = board.faults == 0u ? record->faults : board.faults; /* the first */
    board.counters = record->counters;
    const uint32_t late = record->contact_late_ticks == CR_NOT_FELT ? 0u : record->contact_late_ticks;
    const uint64_t waited_ns = record->now_ns - record->sync_ns;
    board.oldest = late > board.oldest ? late : board.oldest;
    board.tick_late_ns = board.enabled_at > 0u && waited_ns > board.tick_late_ns ? waited_ns : board.tick_late_ns;
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
int can_was_off(void) { return 0; }
uint32_t can_lost(void) { return 0u; }

int can_send(const cr_frame *frame) {
    cr_sim_frame out = {.id = frame->id, .len = frame->size};
    memcpy(out.data, frame->data, sizeof out.data);
    if (frame->id == 0x080u && board.enabled_at > 0u) {
        const uint64_t late_ns = (board.now_ns - board.begun_ns) % BOARD_PERIOD_NS;
        board.late_ns = late_ns > board.late_ns ? late_ns : board.late_ns;
    }
    if (frame->id == 0x181u) {
        /* the tick is over when its torque frame is handed over */
        board.now_ns += board.periods >= board.slow_at ? SLOW_TICK_NS : TICK_COST_NS;
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

/* How the next loops run: ticks of the largest cost that the bus leaves them. */
static void set_board(uint32_t periods, uint64_t step_ns) {
    memset(&board, 0, sizeof board);
    board.periods_max = periods;
    board.step_ns = step_ns;
    board.slow_at = UINT32_MAX;
}

static void run_board(void) {
    const cr_sim_params params = cr_sim_params_default();
    board.sim = cr_sim_create(&params, 0u, 0u);
    board.wire = cr_wire_create(board.sim, BIT_NS, REACTION_NS, 0u);
    memset(&period, 0, sizeof period);
    if (setjmp(board.over) == 0) {
        controller_main();
    }
    cr_wire_destroy(board.wire);
    cr_sim_destroy(board.sim);
}

static void run_loop(uint32_t periods, uint64_t step_ns) {
    set_board(periods, step_ns);
    run_board();
}

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
    assert_true(board.late_ns < 10000u);
    print_message("%u steps of the search, contact up to %u ticks old, ticks at most %.0f us after SYNC\n",
                  (unsigned)board.steps, (unsigned)board.oldest, (double)board.tick_late_ns * 1e-3);
    assert_true(board.steps > 50000u && board.oldest <= 10u);
}

/* Steps of a tenth of a period, of one and a half as an emulated M7 has them deep in a spanner, and of seven: the answers get older, the frames do not. */
static void a_step_longer_than_a_period_delays_no_frame(void **state) {
    (void)state;
    static const uint64_t step_ns[] = {115000u, 1500000u, 7000000u};
    for (uint32_t i = 0; i < sizeof step_ns / sizeof *step_ns; i++) {
        run_loop(4000u, step_ns[i]);
        const cr_servo_counters *c = &board.counters;
        print_message("steps of %.0f us: %u made, contact up to %u ticks old, SYNC at most %.0f us late, ticks at most "
                      "%.0f us after it\n",
                      (double)step_ns[i] * 1e-3, (unsigned)board.steps, (unsigned)board.oldest,
                      (double)board.late_ns * 1e-3, (double)board.tick_late_ns * 1e-3);
        assert_true(board.late_ns < 10000u && board.tick_late_ns < DEADLINE_NS + 10000u);
        assert_true(c->overruns == 0u && c->send_failed == 0u && c->late == 0u);
        assert_true(board.steps > 0u && board.oldest >= 1u);
        assert_true(board.faults == (board.oldest > BOARD_LATE_MAX_TICKS ? (uint32_t)CR_FAULT_LATE : 0u));
    }
    assert_int_equal(board.faults, CR_FAULT_LATE); /* of the last: contact that old is not felt */
}

/* An interrupt storm, a flash that stalls: one period missed is bridged, three are a fault. */
static void interrupts_that_are_held_up_are_counted_and_a_fault_after_three_periods(void **state) {
    (void)state;
    static const struct {
        uint64_t stall_ns;
        uint32_t overruns, faults;
    } held_up[] = {{1400000u, 1u, 0u}, {2400000u, 1u, 0u}, {3400000u, 1u, CR_FAULT_OVERRUN}};
    for (uint32_t i = 0; i < sizeof held_up / sizeof *held_up; i++) {
        set_board(4000u, STEP_NS);
        board.stall_at = 3000u;
        board.stall_ns = held_up[i].stall_ns;
        run_board();
        assert_int_equal(board.counters.overruns, held_up[i].overruns);
        assert_int_equal(board.faults & CR_FAULT_OVERRUN, held_up[i].faults);
        assert_true(cr_mode_is_rendering(board.mode) == (held_up[i].faults == 0u));
    }
}

/* A core on which a tick takes more than a period: it never renders; one that gets so slow while it renders faults after three. */
static void a_core_that_is_too_slow_for_the_tick_does_not_render(void **state) {
    (void)state;
    for (uint32_t slow_at = 0; slow_at <= 3000u; slow_at += 3000u) {
        set_board(4000u, STEP_NS);
        board.slow_at = slow_at;
        run_board();
        assert_false(cr_mode_is_rendering(board.mode));
        assert_true(board.counters.overruns >= 3u && board.enabled_at > 0u);
        assert_true((slow_at > 0u) == ((board.faults & CR_FAULT_OVERRUN) != 0u));
        assert_true((slow_at > 0u) == (board.counters.ticks_rendering > 0u));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(interrupts_that_are_held_up_are_counted_and_a_fault_after_three_periods),
        cmocka_unit_test(a_core_that_is_too_slow_for_the_tick_does_not_render),
        cmocka_unit_test(loop_of_the_controller_comes_up_on_a_bus_with_bit_times),
        cmocka_unit_test(loop_of_the_controller_misses_no_state_once_it_runs),
        cmocka_unit_test(a_step_longer_than_a_period_delays_no_frame),
    };
    return cmocka_run_group_tests(tests, build_flash, NULL);
}
