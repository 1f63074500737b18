/* startup: from reset to main on any Cortex-M with an FPU. Vectors, memory, FPU; a fault ends in board_stop. */
#include "board.h"

#include <stdint.h>

/* From the linker script. */
extern uint32_t _data_load, _data_start, _data_end, _bss_start, _bss_end, _stack_bottom, _stack_top;

#define SCB_VTOR (*(volatile uint32_t *)0xE000ED08u)
#define SCB_CPACR (*(volatile uint32_t *)0xE000ED88u)
#define FPU_FPDSCR (*(volatile uint32_t *)0xE000EF3Cu)
#define CPACR_FPU (0xFu << 20)
#define FPSCR_MODES (0x1Fu << 22 | 1u << 19) /* AHP DN FZ RMode, FZ16 */

int main(void);
void reset(void);
void trap(void);

/* No return address: reset is where the processor begins. */
void reset(void) {
    const uint32_t *from = &_data_load;
    SCB_CPACR |= CPACR_FPU;
    __asm volatile("dsb\n isb" ::: "memory");
    /* Round to nearest, denormals kept, not-a-numbers passed on: what IEEE 754 says, and what every other target does. The other
     * bits stay: on a Cortex-M55 they hold the width of its vectors. */
    uint32_t fpscr;
    __asm volatile("vmrs %0, fpscr" : "=r"(fpscr));
    __asm volatile("vmsr fpscr, %0" ::"r"(fpscr & ~FPSCR_MODES));
    FPU_FPDSCR &= ~FPSCR_MODES;
    for (uint32_t *to = &_data_start; (uintptr_t)to < (uintptr_t)&_data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = &_bss_start; (uintptr_t)to < (uintptr_t)&_bss_end; to++) {
        *to = 0u;
    }
    for (uint32_t *to = &_stack_bottom; (uintptr_t)to < (uintptr_t)__builtin_frame_address(0) - 64u; to++) {
        *to = BOARD_STACK_FILL;
    }
    board_stop(main() == 0 ? BOARD_STOP_DONE : BOARD_STOP_FAILED);
}

void trap(void) { board_stop(BOARD_STOP_FAULT); }

/* Of a program that has none. */
__attribute__((weak)) void board_systick(void) { trap(); }
__attribute__((weak)) void board_irq0(void) { trap(); }

uint32_t board_stack_used(void) {
    const uint32_t *at = &_stack_bottom;
    while ((uintptr_t)at < (uintptr_t)&_stack_top && *at == BOARD_STACK_FILL) {
        at++;
    }
    return (uint32_t)((uintptr_t)&_stack_top - (uintptr_t)at);
}

typedef union {
    const void *stack;
    void (*handler)(void);
} vector;

/* The system exceptions, and one peripheral. */
__attribute__((section(".vectors"), used)) static const vector vectors[17] = {
    {.stack = &_stack_top},     {.handler = reset},     {.handler = trap}, {.handler = trap}, {.handler = trap},
    {.handler = trap},          {.handler = trap},      {.handler = trap}, {.handler = trap}, {.handler = trap},
    {.handler = trap},          {.handler = trap},      {.handler = trap}, {.handler = trap}, {.handler = trap},
    {.handler = board_systick}, {.handler = board_irq0}};
