/* Servo and simulated drives in one process, tick after tick without leaving C: what a sweep over thousands of runs needs. */
#ifndef CR_LOCKSTEP_H
#define CR_LOCKSTEP_H

#include "handle.h"
#include "servo.h"

/* A function of the simulator, of whatever type: the two ends of the bus are in two extensions. */
typedef void (*cr_lockstep_fn)(void);

/* The drives at the other end, and the wire to them. Functions of sim/ by name: cr_wire_put, cr_wire_get, cr_sim_target,
 * cr_sim_read. */
typedef struct {
    void *sim;  /* cr_sim, lock-step; with at_once: wall-clock */
    void *wire; /* cr_wire; with at_once: one whose frames take no time */
    cr_lockstep_fn put, get, target, read;
    /* Not null: told of each frame when the host hands it over or has received it. */
    void (*seen)(uint64_t at_ns, const cr_frame *frame);
    /* Not null: a handle of six axes. Its wrist is what the drives sense; handle_rows[count] are written. */
    cr_handle *handle;
    cr_handle_row *handle_rows;
} cr_lockstep_drives;

/* State of the mechanism after a tick; frame of the base. */
typedef struct {
    double tip_pos_m[3], tip_vel_m_s[3], tip_acc_m_s2[3];
    double hand_force_N[3], hand_target_m[3], joint_torque[3];
} cr_lockstep_row;

/* Time goes from tick to tick. A tick starts when every drive has answered, at the latest deadline_ns after its SYNC.
 * at_once 0: the bus as it is, the torque of a tick acts from the next SYNC on. 1: there is no time between sample
 * and torque: the frame goes out with its SYNC, and the drives are set up (0x1401:2) to obey at once. */
typedef struct {
    uint64_t now_ns; /* of the last SYNC */
    uint64_t period_ns, deadline_ns;
    float period_s; /* as the servo is told */
    uint32_t at_once;
    uint64_t compute_ns;  /* how long a tick takes: its frames are handed over then */
    uint32_t search_work; /* of cr_servo_search after each tick; 0: none */
} cr_lockstep_clock;

/* Purpose  run both ends, one target a tick, until `count` are done or a mode of `stop_modes` (bit 1 << mode) is reached.
 * Shapes   targets[count][6]: tip in the frame of the base (m), wrist (rad), or null: the hand stays as it is; records[count],
 *          rows[count].
 * Output   ticks done.   Errors  none: see the records.   Cost  20 us a tick of the mechanism, and the haptic tick. */
size_t cr_lockstep_run(cr_servo *servo, const cr_lockstep_drives *drives, cr_lockstep_clock *clock,
                       const double *targets, size_t count, uint32_t stop_modes, cr_record *records,
                       cr_lockstep_row *rows);

#endif
