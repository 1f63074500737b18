/* controller: the device without an operating system. The clock's interrupt is the servo: ten slots to a period of 1 kHz. The main loop is the search for
 * contact, which every slot interrupts wherever it is: no step of it holds up a frame.
 *
 * Each slot takes the frames that have come. The first of a period sends SYNC; the first in which all drives have answered, or the one at the deadline, ticks
 * and sends its frames. The answer to SYNC k acts from SYNC k + 1 on, as on Linux. The wrist's angles come over the bus too, from drive Z.
 *
 * The bus, the servo's period and what is felt belong to the interrupt; the main loop calls cr_servo_search only (Threads, servo.h). */
#include "board.h"
#include "can.h"

/* After SYNC: the tick starts then at the latest. The three states take up to 675 us, with what may be in their way (`crease bus
 * --schedule`). */
#define DEADLINE_NS 700000u
/* A slot is the one at a time that it comes this near to, whatever it had to wait for. */
#define NEAR_NS (BOARD_SLOT_NS / 2u)
/* A servo and a world with 289 groups of the shell (host/crease/replay/devices.toml); set-up fails when a scene needs more. */
#define MEMORY_BYTES (80u * 1024u)
/* Work of one call of the search: after it the search of a servo that began anew is dropped. */
#define SLICE_WORK 64u

extern const uint8_t _scene_start[], _scene_room_end[];

int main(void);

static _Alignas(64) uint8_t memory[MEMORY_BYTES];

/* Of the interrupt. */
static struct {
    cr_servo *servo;
    uint64_t due_ns, sync_ns, last_ns; /* the next period, its SYNC and that before; 0: none yet */
    uint32_t waiting;                  /* 1: SYNC is out, its tick has not been */
} period;
/* Written by the interrupt, read by the main loop. */
static volatile uint32_t slots;

/* Apart from main: under the search lies nothing of it on the stack. */
__attribute__((noinline)) static cr_servo *make_servo(void) {
    static cr_servo_config config;
    cr_scene scene;
    cr_servo *servo = NULL;
    config = board_settings();
    cr_err err = cr_scene_open(&scene, _scene_start, (uintptr_t)_scene_room_end - (uintptr_t)_scene_start);
    err = err == CR_OK ? cr_servo_init(&servo, memory, sizeof memory, &scene, &config) : err;
    return err == CR_OK ? servo : NULL;
}

static void send_all(cr_servo *servo, const cr_tx *tx) {
    for (uint32_t i = 0; i < tx->count; i++) {
        if (can_send(&tx->frames[i]) != 0) {
            cr_servo_input(servo, CR_INPUT_SEND_FAILED);
        }
    }
}

static void collect(cr_servo *servo) {
    cr_frame frame;
    while (can_receive(&frame)) {
        cr_servo_rx(servo, &frame);
    }
    cr_servo_rx_drops(servo, can_lost());
    if (can_was_off()) {
        cr_servo_input(servo, CR_INPUT_BUS_OFF);
    }
}

static void run_tick(cr_servo *servo) {
    cr_tx tx;
    const uint64_t since_ns = period.last_ns == 0u ? BOARD_PERIOD_NS : period.sync_ns - period.last_ns;
    cr_servo_input(servo, board_commands(cr_servo_get_status(servo).mode));
    cr_servo_tick(servo, board_now_ns(), since_ns < 1000000000u ? (float)(uint32_t)since_ns * 1e-9f : 1.0f, &tx);
    send_all(servo, &tx);
    board_keep(cr_servo_get_record(servo));
    period.last_ns = period.sync_ns;
    period.waiting = 0u;
}

static void begin_period(cr_servo *servo, uint64_t now_ns) {
    cr_tx tx;
    cr_servo_sync(servo, now_ns, &tx);
    send_all(servo, &tx);
    period.sync_ns = now_ns;
    period.waiting = 1u;
    const uint32_t late_ns = (uint32_t)(now_ns + NEAR_NS - period.due_ns); /* far below 4 s */
    period.due_ns += (uint64_t)(1u + late_ns / BOARD_PERIOD_NS) * BOARD_PERIOD_NS;
}

void board_systick(void) {
    cr_servo *servo = period.servo;
    const uint64_t now_ns = board_now_ns();
    slots++;
    collect(servo);
    if (period.waiting &&
        (cr_servo_get_status(servo).ready || now_ns + NEAR_NS >= period.sync_ns + (uint64_t)DEADLINE_NS)) {
        run_tick(servo);
    }
    if (!period.waiting && now_ns + NEAR_NS >= period.due_ns) {
        begin_period(servo, board_now_ns());
    }
}

int main(void) {
    cr_servo *servo = make_servo();
    if (servo == NULL || board_start() != 0 || can_start() != 0) {
        return 1;
    }
    period.servo = servo;
    period.due_ns = board_now_ns() + BOARD_PERIOD_NS;
    board_begin();
    for (;;) {
        const uint32_t seen = slots;
        if (cr_servo_search(servo, SLICE_WORK) == 0u) {
            board_sleep(&slots, seen);
        }
    }
}
