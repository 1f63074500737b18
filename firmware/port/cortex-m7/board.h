/* What the port asks of a board: time, a 1 kHz pace, a switch, a way to stop. One file of the port implements it for each board. */
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

/* SysTick's exception. */
void board_systick(void);

/* How many ticks old the contact may be that is searched for beside them. */
#define BOARD_LATE_MAX_TICKS 50u

/* Purpose  the device behind this board, and how the loop runs it. */
cr_servo_config board_settings(void);

/* Purpose  clocks, pins, watchdog; the pace begins.   Output  0; -1: a clock does not start. */
int board_start(void);

/* When the next period begins, by board_now_ns. */
uint64_t board_due_ns(void);

/* Purpose  sleep until the next period begins, and keep the watchdog quiet.   Output  periods that were slept over, 0 as a rule. */
uint32_t board_wait_period(void);

/* Nanoseconds since board_start; never back. Asked at least once a second. */
uint64_t board_now_ns(void);

/* Purpose  what the operator wants: CR_COMMAND_START when the switch goes on (CR_COMMAND_CLEAR in a fault), CR_COMMAND_STOP while it
 *          is off. */
uint32_t board_commands(uint32_t mode);

/* Purpose  the record of a tick, for whoever keeps it. */
void board_keep(const cr_record *record);

/* Purpose  most bytes of stack used since reset. */
uint32_t board_stack_used(void);

#endif
