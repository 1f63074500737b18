/* What the port asks of a board: time, a pace, a switch, a way to stop. One file of the port implements it for each board. */
#ifndef CORTEX_BOARD_H
#define CORTEX_BOARD_H

#include "servo.h"

#define BOARD_STOP_DONE 0u
#define BOARD_STOP_FAILED 1u
#define BOARD_STOP_FAULT 99u

/* Pattern of stack that was never used. */
#define BOARD_STACK_FILL 0x5AA5C33Cu

/* Purpose  the end: no torque any more, and nothing else. On a device the node falls silent, so that the drives, which watch
 *          its heartbeat, go to zero torque by themselves; in an emulator the program ends with this status. */
_Noreturn void board_stop(uint32_t why);

/* The clock's interrupt comes so often, and so often in a period of the servo. */
#define BOARD_SLOT_NS 100000u
#define BOARD_SLOTS 10u
#define BOARD_PERIOD_NS (BOARD_SLOTS * BOARD_SLOT_NS)

/* The clock's interrupt, SysTick: controller.c. A program that has none stops there. */
void board_systick(void);

/* The first peripheral's interrupt, of the same priority: neither interrupts the other. A program that has none stops there. */
void board_irq0(void);

/* How many ticks old the contact may be that is searched for beside them. */
#define BOARD_LATE_MAX_TICKS 50u

/* Purpose  the device behind this board, and how the loop runs it. */
cr_servo_config board_settings(void);

/* Purpose  clocks, pins, watchdog.   Output  0; -1: a clock does not start. */
int board_start(void);

/* Purpose  from now on the clock's interrupt comes every BOARD_SLOT_NS. One that finds the last still running comes after it; more than one are one. */
void board_begin(void);

/* Purpose  of the main loop: sleep or wait until an interrupt, unless *slots, which the clock's interrupt counts up, is no more what was seen. */
void board_sleep(const volatile uint32_t *slots, uint32_t seen);

/* Nanoseconds since board_start; never back. Asked at least once a second; from the interrupt once that has begun. */
uint64_t board_now_ns(void);

/* Purpose  what the operator wants: CR_COMMAND_START when the switch goes on (CR_COMMAND_CLEAR in a fault), CR_COMMAND_STOP while it
 *          is off. */
uint32_t board_commands(uint32_t mode);

/* Purpose  the record of a tick, for whoever keeps it; the watchdog stays quiet for as long as they come. */
void board_keep(const cr_record *record);

/* Purpose  most bytes of stack used since reset. */
uint32_t board_stack_used(void);

#endif
