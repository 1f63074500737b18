/* What the port asks of a board: time, a 1 kHz pace, a way to stop. One file of the port implements it for each board. */
#ifndef CORTEX_BOARD_H
#define CORTEX_BOARD_H

#include <stdint.h>

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

/* Purpose  most bytes of stack used since reset. */
uint32_t board_stack_used(void);

#endif
