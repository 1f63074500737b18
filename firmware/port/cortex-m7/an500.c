/* an500: board.h and can.h on QEMU's mps2-an500, a Cortex-M7, so that the whole loop of controller.c runs: `make hil-m7`. CAN is slcan on
 * UART 0, the records go to a file of the emulator's machine, and the operator is a script. It checks what the loop does, not how fast.
 *
 * Interrupts stay masked: a pending one ends the sleep and is asked for, so that nothing interrupts the loop here either. Time is counted
 * in steps of SysTick, SLOWER than the emulator's: a character takes the emulator and its host some microseconds, a period brings a
 * hundred, and their number must not matter. What the drives time by their own clock is as much slower. Sources: Arm DAI0400 (UART, IRQ 0), DDI0403 (SysTick, NVIC). */
#include "board.h"
#include "can.h"
#include "contact/image.h"
#include "semihost.h"
#include "slcan.h"

#define SLOWER 4u
#define STEP_NS 200000u
#define STEPS_PER_PERIOD 5u
#define STEP_CYCLES (SLOWER * STEP_NS / 40u) /* of 25 MHz */
/* How long the other end may take to open the channel, or to take a character. */
#define OPEN_STEPS 50000u
#define SEND_STEPS 100u
#define CLOSE_STEPS 50000u

/* The operator, in ticks. */
#define IDLE_SEEN 20u    /* before a start */
#define FAULT_SEEN 30u   /* before the fault is cleared */
#define LAST_RENDER 100u /* after the second start */
#define TICKS_MAX 10000u /* a loop that takes longer has failed */

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
#define SYSTICK_CTRL REG(0xE000E010u)
#define SYSTICK_LOAD REG(0xE000E014u)
#define SYSTICK_NOW REG(0xE000E018u)
#define NVIC_ISER0 REG(0xE000E100u)
#define NVIC_ICER0 REG(0xE000E180u)
#define NVIC_ICPR0 REG(0xE000E280u)
#define SCB_ICSR REG(0xE000ED04u)
#define ICSR_SYSTICK_PENDS (1u << 26)
#define ICSR_SYSTICK_CLEAR (1u << 25)

extern const uint8_t _scene_start[];

static slcan line;
static uint64_t steps, due;
static uint32_t unsent;
static int file;

static uint64_t step_now(void) {
    if ((SCB_ICSR & ICSR_SYSTICK_PENDS) != 0u) {
        SCB_ICSR = ICSR_SYSTICK_CLEAR;
        steps++;
    }
    return steps;
}

/* A character that nobody takes would end the sleep at once, again and again. */
static void sleep_for_clock(void) {
    NVIC_ICER0 = UART_IRQ;
    __asm volatile("dsb\n wfi" ::: "memory");
}

void can_wait(void) {
    NVIC_ISER0 = UART_IRQ;
    __asm volatile("dsb\n wfi" ::: "memory");
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
    SYSTICK_LOAD = STEP_CYCLES - 1u;
    SYSTICK_NOW = 0u;
    SYSTICK_CTRL = 7u;
    return start_record();
}

uint64_t board_due_ns(void) { return due * STEP_NS; }

uint32_t board_wait_period(void) {
    while (step_now() < due) {
        sleep_for_clock();
    }
    const uint32_t slept_over = (uint32_t)(steps - due) / STEPS_PER_PERIOD;
    due += (uint64_t)(1u + slept_over) * STEPS_PER_PERIOD;
    return slept_over;
}

uint64_t board_now_ns(void) { return step_now() * STEP_NS; }

/* Says that it is through, and waits for the other end: a line that hangs up takes the interface away from under the drives. */
_Noreturn static void end(uint32_t why) {
    cr_frame none;
    const uint64_t until = step_now() + CLOSE_STEPS;
    semihost_close(file);
    semihost_print("the loop has ended\n");
    while (line.open && step_now() < until) {
        (void)can_receive(&none);
        can_wait();
    }
    board_stop(line.open ? BOARD_STOP_FAILED : why);
}

/* Ticks that the loop has been in this mode; a limit that acts is no other mode. */
static uint32_t ticks_in(uint32_t mode) {
    static uint32_t last = CR_MODE_COUNT, ticks;
    const uint32_t now = mode == CR_MODE_LIMITED ? (uint32_t)CR_MODE_RENDERING : mode;
    ticks = now == last ? ticks + 1u : 0u;
    last = now;
    return ticks;
}

uint32_t board_commands(uint32_t mode) {
    static uint32_t starts, stopping;
    const uint32_t ticks = ticks_in(mode);
    const int rendering = mode == CR_MODE_RENDERING || mode == CR_MODE_LIMITED;
    if (stopping > 0u || (rendering && starts == 2u && ticks >= LAST_RENDER)) {
        if (++stopping > 3u) {
            end(line.refused == 0u && unsent == 0u ? BOARD_STOP_DONE : BOARD_STOP_FAILED);
        }
        return stopping == 1u ? CR_COMMAND_STOP : CR_COMMAND_OFF;
    }
    if (mode == CR_MODE_FAULT) {
        return ticks == FAULT_SEEN ? CR_COMMAND_CLEAR : 0u;
    }
    if (mode == CR_MODE_IDLE && ticks == IDLE_SEEN) {
        starts++;
        return CR_COMMAND_START;
    }
    return 0u;
}

void board_keep(const cr_record *record) {
    if (semihost_write(file, record, sizeof *record) != 0 || record->tick >= TICKS_MAX) {
        end(BOARD_STOP_FAILED);
    }
}

int can_start(void) {
    cr_frame none;
    UART_BAUDDIV = 16u; /* the fastest; the emulator sends at once */
    UART_CTRL = CTRL_TX_RX_AND_RX_INTERRUPT;
    while (!line.open && step_now() < OPEN_STEPS) {
        (void)can_receive(&none);
        can_wait();
    }
    due = steps + STEPS_PER_PERIOD;
    return line.open ? 0 : -1;
}

int can_send(const cr_frame *frame) {
    char text[SLCAN_LINE_MAX];
    const uint32_t size = slcan_write(frame, text);
    for (uint32_t i = 0; i < size; i++) {
        const uint64_t until = step_now() + SEND_STEPS;
        while ((UART_STATE & STATE_TX_FULL) != 0u && step_now() < until) {
            sleep_for_clock();
        }
        if ((UART_STATE & STATE_TX_FULL) != 0u) {
            unsent++;
            return -1;
        }
        UART_DATA = (uint8_t)text[i];
    }
    return size > 0u ? 0 : -1;
}

int can_receive(cr_frame *frame) {
    /* Before the look: a character that comes after it is pending again. */
    UART_INT = INT_RX;
    NVIC_ICPR0 = UART_IRQ;
    while ((UART_STATE & STATE_RX_FULL) != 0u) {
        if (slcan_read(&line, (char)UART_DATA, frame)) {
            return 1;
        }
    }
    return 0;
}

/* A serial line is never off the bus, and holds back what it has no room for. */
int can_was_off(void) { return 0; }
uint32_t can_lost(void) { return line.refused; }
void can_stop(void) { UART_CTRL = 0u; }
