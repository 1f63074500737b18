/* A servo drive as CiA 402-2 has it, in cyclic synchronous torque. Internal to the simulator. */
#ifndef CR_SIM_DRIVE_H
#define CR_SIM_DRIVE_H

#include "canopen.h"

typedef enum {
    CR_DRIVE_NOT_READY = 0,
    CR_DRIVE_SWITCH_ON_DISABLED = 1,
    CR_DRIVE_READY = 2,
    CR_DRIVE_SWITCHED_ON = 3,
    CR_DRIVE_ENABLED = 4,
    CR_DRIVE_QUICK_STOP = 5,
    CR_DRIVE_FAULT_REACTION = 6,
    CR_DRIVE_FAULT = 7
} cr_drive_state;

typedef struct {
    cr_node node;
    cr_drive_state state;
    uint16_t controlword; /* as last acted on */
    uint8_t limited;      /* target torque was beyond 0x6072 */
    int32_t counts;       /* position of the last sample */
    uint8_t sampled;
} cr_drive;

/* Purpose  power-on. */
void cr_drive_init(cr_drive *drive, uint8_t axis, uint64_t now_us);

/* Purpose  a frame, SYNC excepted.   Output  1 when it was for this drive. */
int cr_drive_receive(cr_drive *drive, const cr_sim_frame *frame, uint64_t now_us);

/* Purpose  SYNC: position and torque are sampled and sent, then what waited for the SYNC acts.
 * Units    counts; permille of rated.   Output  none: see cr_drive_torque. */
void cr_drive_sync(cr_drive *drive, int32_t counts, double torque_permille, double period_s, uint64_t now_us);

void cr_drive_poll(cr_drive *drive, uint64_t now_us);

/* Purpose  fault now, with zero torque. */
void cr_drive_fault(cr_drive *drive, uint16_t error_code);

/* Purpose  torque demand for the amplifier.   Output  permille of rated, within 0x6072; 0 unless operation is enabled, the mode is
 *          cyclic synchronous torque and the node is operational. */
int16_t cr_drive_torque(const cr_drive *drive);

#endif
