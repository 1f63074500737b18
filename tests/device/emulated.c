/* The job runner on an emulated board: what tests/check/replay_hash.c is on Linux. The job lies where the scene would lie. Prints the
 * same line, and the stack that was used. A file made.bin is written when the job is a recording. */
#include "board.h"
#include "job.h"
#include "semihost.h"

#define STATE_MAX (160u * 1024u)

extern const uint8_t _scene_start[], _scene_room_end[];

int main(void);
void device_tick_end(void);

/* The plugin of tests/device/count.c closes a tick here. */
__attribute__((noinline)) void device_tick_end(void) { __asm volatile("" ::: "memory"); }

static void print_field(const char *name, uint32_t value) {
    semihost_print(name);
    semihost_print_decimal(value);
}

static int run(job *j, int made) {
    for (uint32_t i = 0; i < j->ticks; i++) {
        job_tick(j, i);
        device_tick_end();
        job_hash(j);
        if (made >= 0 && semihost_write(made, cr_servo_get_record(j->servo), sizeof(cr_record)) != 0) {
            return 1;
        }
    }
    return 0;
}

int main(void) {
    static job j;
    static _Alignas(64) uint8_t memory[STATE_MAX];
    const size_t room = (uintptr_t)_scene_room_end - (uintptr_t)_scene_start;
    const char *wrong = job_open(&j, _scene_start, room, memory, sizeof memory);
    if (wrong != NULL) {
        semihost_print(wrong);
        semihost_print("\n");
        return 1;
    }
    const int made = j.records != NULL ? semihost_create("made.bin") : -1;
    if (run(&j, made) != 0) {
        semihost_print("made.bin cannot be written\n");
        return 1;
    }
    semihost_print("answers ");
    semihost_print_hex(j.answers, 16);
    semihost_print(" all ");
    semihost_print_hex(j.all, 16);
    print_field(" ticks ", j.ticks);
    print_field(" touching ", j.touching);
    print_field(" overflows ", j.overflows);
    print_field(" different ", j.rerun.different);
    print_field(" state ", j.state_bytes);
    print_field(" stack ", board_stack_used());
    semihost_print("\n");
    if (made >= 0) {
        semihost_close(made);
    }
    return 0;
}
