/* an500: board.h and can.h on QEMU's mps2-an500, a Cortex-M7, so that controller.c runs as it is: `make hil-m7`. CAN is slcan on UART 0, whose interrupt
 * stands for the FIFO of a CAN controller; the records go to a file of the emulator's machine, and the operator is a script.
 *
 * QEMU runs with -icount shift=3, 8 ns to an instruction, and a second of the device is SLOWER seconds of the emulator: 480 million instructions. Slower, since a
 * character takes the emulator and its host some microseconds, a period brings a hundred, and their number must not matter. What the drives time by their own
 * clock is as much slower. Sources: Arm DAI0400 (UART, IRQ 0; FPGA counter), DDI0403 (SysTick, NVIC). */
#include "board.h"
#include "can.h"
#include "contact/image.h"
#include "semihost.h"
#include "slcan.h"

/* 3.84: eight ns of the emulator are one cycle of 480 MHz. Of its clock, 25 MHz, a slot has so many, and one is so many ns of the device. */
#define SLOWER 4u /* rounded up, for timeouts */
#define SLOT_CYCLES (BOARD_SLOT_NS * 12u / 125u)
/* Frames that have come and not been taken: as the CAN controller of the device. */
#define FRAMES_MAX 64u

/* The operator, in ticks. */
#define IDLE_SEEN 20u  /* before a start */
#define FAULT_SEEN 30u /* before the first fault is cleared, and after the second the end */
/* After the second start: the interrupt is held up in one tick, later in three in a row, each time for longer than a tick may be late. */
#define HELD_UP_ONCE 150u
#define HELD_UP_ALWAYS 170u
#define HELD_UP_NS 2300000u /* from tick to tick: one period too late */
#define TICKS_MAX 20000u    /* a loop that takes longer has failed */

#define RECORD_FILE "m7.crr"

#define REG(address) (*(volatile uint32_t *)(address))
#define UART_DATA REG(0x40004000u)
#define UART_STATE REG(0x40004004u)
#define UART_CTRL REG(0x40004008u)
#define UART_INT REG(0x4000400Cu)
#define UART_BAUDDIV REG(0x40004010u)
#define STATE_TX_FULL 1u
#define STATE_RX_FULL 2u
#define CTRL_TX_RX_AND_RX_INTERRUPT 0xBu
#define INT_RX 2u
#define UART_IRQ 1u /* << 0 */
#define FPGA_COUNTER REG(0x40028018u)
#define SYSTICK_CTRL REG(0xE000E010u)
#define SYSTICK_LOAD REG(0xE000E014u)
#define SYSTICK_NOW REG(0xE000E018u)
#define NVIC_ISER0 REG(0xE000E100u)

extern const uint8_t _scene_start[];

static slcan line;
static cr_frame frames[FRAMES_MAX];
static uint32_t frames_in, frames_out, frames_lost, unsent, cycles_before, cycles_over;
static uint64_t whole_ns;
static int file;

/* What came over the line. The clock's interrupt, which takes the frames, neither interrupts this nor is interrupted by it. */
void board_irq0(void) {
    cr_frame frame;
    UART_INT = INT_RX; /* before the look: a character that comes after it is pending again */
    while ((UART_STATE & STATE_RX_FULL) != 0u) {
        if (!slcan_read(&line, (char)UART_DATA, &frame)) {
            continue;
        }
        if (frames_in - frames_out == FRAMES_MAX) {
            frames_lost++;
        } else {
            frames[frames_in++ % FRAMES_MAX] = frame;
        }
    }
}

cr_servo_config board_settings(void) {
    cr_servo_config config = cr_servo_config_default();
    config.late_max_ticks = BOARD_LATE_MAX_TICKS;
    config.bus.host_timeout_ms *= SLOWER;
    config.bus.torque_timeout_ms *= SLOWER;
    return config;
}

/* The head of the recording, with the settings that controller.c takes. */
static int start_record(void) {
    static uint8_t head[CR_RECORDS_AT];
    const cr_servo_config config = board_settings();
    const struct cr_img_header *image = (const void *)_scene_start;
    cr_record_head_write(&config, _scene_start, image->size_bytes, head);
    file = semihost_create(RECORD_FILE);
    return file >= 0 && semihost_write(file, head, sizeof head) == 0 ? 0 : -1;
}

int board_start(void) {
    __asm volatile("cpsid i" ::: "memory");
    cycles_before = FPGA_COUNTER;
    return start_record();
}

void board_begin(void) {
    SYSTICK_LOAD = SLOT_CYCLES - 1u;
    SYSTICK_NOW = 0u;
    SYSTICK_CTRL = 7u;
    __asm volatile("cpsie i" ::: "memory");
}

void board_sleep(const volatile uint32_t *slots, uint32_t seen) {
    __asm volatile("cpsid i" ::: "memory"); /* wfi wakes all the same, and no interrupt slips in before it */
    if (*slots == seen) {
        __asm volatile("dsb\n wfi" ::: "memory");
    }
    __asm volatile("cpsie i" ::: "memory");
}

uint64_t board_now_ns(void) {
    const uint32_t now = FPGA_COUNTER, passed = now - cycles_before + cycles_over;
    cycles_before = now;
    cycles_over = passed % 12u; /* 12 cycles are 125 ns of the device */
    whole_ns += (uint64_t)(passed / 12u) * 125u;
    return whole_ns + cycles_over * 125u / 12u;
}

/* Says how it went, and stands still in the clock's interrupt, which nothing else interrupts: an emulator that ended would take the interface away from under
 * the drives. */
_Noreturn static void end(int failed) {
    semihost_close(file);
    semihost_print(failed ? "the loop has failed: stack " : "the loop has ended: stack ");
    semihost_print_decimal(board_stack_used());
    semihost_print("\n");
    for (;;) {
        __asm volatile("wfi" ::: "memory");
    }
}

/* Ticks that the loop has been in this mode; a limit that acts is no other mode. */
static uint32_t ticks_in(uint32_t mode) {
    static uint32_t last = CR_MODE_COUNT, ticks;
    const uint32_t now = mode == CR_MODE_LIMITED ? (uint32_t)CR_MODE_RENDERING : mode;
    ticks = now == last ? ticks + 1u : 0u;
    last = now;
    return ticks;
}

/* A flash that stalls, interrupts of somebody else. */
static void hold_up(uint64_t until_ns) {
    while (board_now_ns() < until_ns) {
        /* nothing runs but this */
    }
}

uint32_t board_commands(uint32_t mode) {
    static uint32_t starts;
    static uint64_t last_ns;
    const uint32_t ticks = ticks_in(mode);
    const int rendering = mode == CR_MODE_RENDERING || mode == CR_MODE_LIMITED;
    if (rendering && starts == 2u && (ticks == HELD_UP_ONCE || ticks >= HELD_UP_ALWAYS)) {
        hold_up(last_ns + HELD_UP_NS);
    }
    last_ns = board_now_ns();
    if (mode == CR_MODE_FAULT && ticks == FAULT_SEEN) {
        if (starts == 2u) {
            end(line.refused + frames_lost + unsent > 0u);
        }
        return CR_COMMAND_CLEAR;
    }
    if (mode == CR_MODE_IDLE && ticks == IDLE_SEEN) {
        starts++;
        return CR_COMMAND_START;
    }
    return 0u;
}

void board_keep(const cr_record *record) {
    if (semihost_write(file, record, sizeof *record) != 0 || record->tick >= TICKS_MAX) {
        end(1);
    }
}

int can_start(void) {
    UART_BAUDDIV = 16u; /* the fastest; the emulator sends at once */
    UART_CTRL = CTRL_TX_RX_AND_RX_INTERRUPT;
    NVIC_ISER0 = UART_IRQ;
    while (!line.open) {
        __asm volatile("dsb\n wfi\n cpsie i\n isb\n cpsid i" ::: "memory");
    }
    return 0;
}

int can_send(const cr_frame *frame) {
    char text[SLCAN_LINE_MAX];
    const uint32_t size = slcan_write(frame, text);
    for (uint32_t i = 0; i < size; i++) {
        if ((UART_STATE & STATE_TX_FULL) != 0u) {
            unsent++;
            return -1;
        }
        UART_DATA = (uint8_t)text[i];
    }
    return size > 0u ? 0 : -1;
}

int can_receive(cr_frame *frame) {
    if (frames_out == frames_in) {
        return 0;
    }
    *frame = frames[frames_out++ % FRAMES_MAX];
    return 1;
}

/* A serial line is never off the bus. */
int can_was_off(void) { return 0; }
uint32_t can_lost(void) { return line.refused + frames_lost; }
void can_stop(void) { UART_CTRL = 0u; }
