/* A handle of six axes in the closed loop: the servo's three over the bus, a motored wrist beside it, and between them a held tool.
 *
 * After each tick of the servo the coupling is asked at the pose of the drives' states and the wrist's encoders. The force goes out with the servo's own
 * torque frame, the torque to the wrist's motors in the same period: the servo's contact is left out, and its modes, faults and drives stay what they are. */
#ifndef CR_HANDLE_H
#define CR_HANDLE_H

#include "couple.h"
#include "servo.h"

/* One tick of the handle; world frame. Of the hand's tool: where the encoders have it. */
typedef struct {
    float hand_pos_m[3], hand_rot[4];
    float held_pos_m[3], held_rot[4];
    float contact_force_N[3], contact_torque_Nm[3]; /* of the spring, about the origin of the hand's tool */
    float force_N[3], torque_Nm[3];                 /* sent, after controller and limits */
    float motor_Nm[3];                              /* sent to the wrist's motors */
    float wrist_rad[3];                             /* as it is, not as its encoders read */
    float wrist_rad_s[3];
    float hand_torque_Nm[3]; /* that the simulated hand feels about the wrist's axes */
    float drawn_m;           /* the spring, along; 0 where nothing presses */
    float inside_m, energy_J;
    uint32_t pressing, contacts, near, lookups, late, left_out, faults, limits, tick_ns;
} cr_handle_row;

/* Advances a wrist: cr_sim_wrist_advance, of another extension. */
typedef void (*cr_handle_advance)(void *wrist, const double *target_rad, const double *torque_Nm);

typedef struct {
    cr_coupled *coupled;
    const cr_world *world;
    cr_couple_passivity *passivity;
    const cr_servo_config *config; /* of the servo: arm, rated and peak torques */
    void *wrist;                   /* cr_sim_wrist */
    cr_handle_advance advance;
    uint32_t delay_ticks; /* as of the passivity: 1 over the bus */
    uint32_t rendering;   /* written: the servo rendered in the last tick */
    double target[6];     /* where the hand wants the tip, frame of the base, m, and the wrist, rad */
    double sent_Nm[CR_COUPLE_DELAY_MAX + 1u][3];
    float before[6]; /* force and torque of the last tick */
} cr_handle;

/* Purpose  after a tick of the servo: wrench of the held tool, added to the torque frame in tx; and *row. The hand pulls the wrist to handle->target.
 * Output   finite. No wrench unless the servo renders; half of the last one, halved on, while states are missing; none from a fault of
 *          the coupling on: that of `row->faults`, which latches. The wrist moves on by one period. */
void cr_handle_tick(cr_handle *handle, const cr_record *record, cr_tx *tx, cr_handle_row *row);

#endif
