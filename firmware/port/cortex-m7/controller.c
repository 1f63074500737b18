/* controller: the device without an operating system. One loop, 1 kHz, paced by the board; no interrupt but its clock.
 *
 * Each period: SYNC, the drives' answers, the tick, its frames. Where the loop would wait, for a frame or for the next period, it searches for
 * contact, a step at a time, and begins none that by the longest one of the last periods would end too late, but for one after each tick.
 * The answer to SYNC k acts from SYNC k + 1 on, as on Linux.
 * The wrist's angles come over the bus too, from drive Z. */
#include "board.h"
#include "can.h"

/* After SYNC: the tick starts then at the latest. The three states take up to 675 us, with what may be in their way (`crease bus
 * --schedule`). */
#define DEADLINE_NS 700000u
/* A servo and a world with 421 groups of the shell (host/crease/replay/devices.toml); set-up fails when a scene needs more. */
#define MEMORY_BYTES (80u * 1024u)

/* Work of one step of the search. */
#define STEP_WORK 1u
/* Periods that the longest step counts for, at least; at most twice as many. Counted in steps it would either be forgotten before the next answer has one as
 * long, or, where it leaves time for one step a period, be remembered until contact is too old. */
#define PERIODS_KEPT 16u
_Static_assert(2u * PERIODS_KEPT < BOARD_LATE_MAX_TICKS, "one long step is forgotten before contact is too old");

extern const uint8_t _scene_start[], _scene_room_end[];

int main(void);

static _Alignas(64) uint8_t memory[MEMORY_BYTES];
/* The longest step of these periods, and of the PERIODS_KEPT before them. */
static struct {
    uint64_t now_ns, before_ns;
    uint32_t periods;
} longest;

static cr_servo *make_servo(const cr_servo_config *config) {
    cr_scene scene;
    cr_servo *servo = NULL;
    cr_err err = cr_scene_open(&scene, _scene_start, (uintptr_t)_scene_room_end - (uintptr_t)_scene_start);
    err = err == CR_OK ? cr_servo_init(&servo, memory, sizeof memory, &scene, config) : err;
    return err == CR_OK ? servo : NULL;
}

static void send_all(cr_servo *servo, const cr_tx *tx) {
    for (uint32_t i = 0; i < tx->count; i++) {
        if (can_send(&tx->frames[i]) != 0) {
            cr_servo_input(servo, CR_INPUT_SEND_FAILED);
        }
    }
}

/* A step of the search, if it will end before then.   Output  1 when one was made. */
static int search_until(cr_servo *servo, uint64_t until_ns) {
    const uint64_t from_ns = board_now_ns();
    const uint64_t longest_ns = longest.now_ns > longest.before_ns ? longest.now_ns : longest.before_ns;
    if (from_ns + longest_ns >= until_ns || cr_servo_search(servo, STEP_WORK) == 0u) {
        return 0;
    }
    const uint64_t took_ns = board_now_ns() - from_ns;
    longest.now_ns = took_ns > longest.now_ns ? took_ns : longest.now_ns;
    return 1;
}

/* A step that took long once, for a cold cache or an interrupt, does not slow the search for good. */
static void count_period(void) {
    longest.periods++;
    if (longest.periods == PERIODS_KEPT) {
        longest.before_ns = longest.now_ns;
        longest.now_ns = 0u;
        longest.periods = 0u;
    }
}

/* Frames until all drives have answered, or until then. */
static void collect(cr_servo *servo, uint64_t until_ns) {
    cr_frame frame;
    int waiting = 1;
    while (waiting) {
        while (can_receive(&frame)) {
            cr_servo_rx(servo, &frame);
        }
        waiting = board_now_ns() < until_ns && !cr_servo_get_status(servo).ready;
        if (waiting && !search_until(servo, until_ns)) {
            can_wait();
        }
    }
    cr_servo_rx_drops(servo, can_lost());
    if (can_was_off()) {
        cr_servo_input(servo, CR_INPUT_BUS_OFF);
    }
}

static void run_period(cr_servo *servo, const cr_servo_config *config, uint64_t *last_ns) {
    cr_tx tx;
    collect(servo, 0u);
    const uint64_t sync_ns = board_now_ns();
    cr_servo_sync(servo, sync_ns, &tx);
    send_all(servo, &tx);
    collect(servo, sync_ns + DEADLINE_NS);
    cr_servo_input(servo, board_commands(cr_servo_get_status(servo).mode));
    const uint32_t since_ns = (uint32_t)(sync_ns - *last_ns); /* periods are far below 4 s */
    const float period_s = *last_ns == 0u ? config->period_s : (float)since_ns * 1e-9f;
    cr_servo_tick(servo, board_now_ns(), period_s <= 1.0f ? period_s : 1.0f, &tx);
    send_all(servo, &tx);
    board_keep(cr_servo_get_record(servo));
    count_period();
    *last_ns = sync_ns;
}

int main(void) {
    static cr_servo_config config;
    config = board_settings();
    cr_servo *servo = make_servo(&config);
    uint64_t last_ns = 0u;
    if (servo == NULL || board_start() != 0 || can_start() != 0) {
        return 1;
    }
    for (;;) {
        (void)search_until(servo, UINT64_MAX); /* one after each tick, however long steps are */
        while (search_until(servo, board_due_ns())) {
            /* till there is nothing to search for, or no time */
        }
        board_wait_period();
        run_period(servo, &config, &last_ns);
    }
}
