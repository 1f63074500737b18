/* The other end of the bus: mechanism with operator in ODE, three CiA 402 drives, faults on request. The one public header.
 *
 * Flow     cr_sim_create -> cr_sim_receive / cr_sim_poll -> cr_sim_send, over and over -> cr_sim_destroy
 * Memory   heap, at create only. A cr_sim belongs to one thread at a time; several may live side by side.
 * Time     an argument, us since any origin, never going back. No clock, no I/O outside port/.
 * Lock-step  each SYNC samples the encoders, sends the replies, applies the torques that arrived before it and moves the
 *          mechanism by one period: the same frames in give the same frames out, to the bit.
 * Wall     the same, but the mechanism moves with the time given to cr_sim_receive and cr_sim_poll.
 * Units    SI unless the name says otherwise. X is along the guide; the arm moves in the Y-Z plane.
 *          tip = (x, l0 cos q1 + l1 cos q2, l0 sin q1 + l1 sin q2), q1 upper link, q2 forearm, both against +Y (parallelogram
 *          drive: both motors stand on the carriage). Elbow angle = pi - (q1 - q2). Joint torque: N for X, N m for the arm. */
#ifndef CR_SIM_H
#define CR_SIM_H

#include <stddef.h>
#include <stdint.h>

#define CR_SIM_AXES 3
/* Entries of the fault table. Enough for one fault every 50th tick of 2 s, and some. */
#define CR_SIM_FAULTS_MAX 64
/* Frames waiting for cr_sim_send; what does not fit is counted in frames_dropped. A drive sends at most 6 in one period. */
#define CR_SIM_QUEUE_MAX 512
/* Longest declared torque delay. */
#define CR_SIM_DELAY_MAX_MS 50

typedef struct {
    uint32_t id; /* 11 bits */
    uint8_t len; /* 0..8 */
    uint8_t data[8];
} cr_sim_frame;

/* One axis, felt at the tip: X along the guide; Y by the upper link, Z by the forearm, at their link length. */
typedef struct {
    double mass_kg;      /* apparent */
    double viscous_Ns_m; /* at the motor */
    double coulomb_N;    /* at the motor */
    double mode_Hz;      /* first vibration mode, motor against load */
    double mode_damping; /* ratio, 0..1 */
    double motor_share;  /* part of the mass that turns with the motor, 0..1 */
    double step_m;       /* one encoder count; 0: no quantisation */
} cr_sim_axis;

typedef struct {
    cr_sim_axis axes[CR_SIM_AXES];
    double stroke_m;  /* of the guide, about x = 0 */
    double link_m[2]; /* upper link, forearm */
    double elbow_min_rad, elbow_max_rad;
    double start_rad[2];   /* q1, q2 at create; x = 0 */
    double amplifier_Hz;   /* first order; 0: no lag */
    double gravity_N;      /* what the counterweights leave, at the tip, along -Z */
    double wrist_step_rad; /* of the three sensed angles; 0: no quantisation */
    double hand_mass_kg;   /* 0: nobody holds the tool */
    double hand_damping_Ns_m, hand_stiffness_N_m;
    double path_Hz;        /* the hand follows its target through a second-order low-pass at this frequency */
    double torque_delay_s; /* beyond the SYNC that applies the torque, whole sub-steps, at most CR_SIM_DELAY_MAX_MS */
    double period_s;
    uint32_t substeps; /* of the mechanism in one period */
    uint32_t rigid;    /* 1: motor and load are one */
} cr_sim_params;

/* Purpose  the default device: the table of sim/DESIGN.md, every number of it assumed. */
cr_sim_params cr_sim_params_default(void);

/* Purpose  the same masses and viscous friction without anything else, for checks against theory: rigid, no Coulomb friction, no
 *          amplifier lag, no quantisation, no gravity residual, no hand. */
cr_sim_params cr_sim_params_linear(void);

/* What can be known of the mechanism. */
typedef struct {
    double joint[CR_SIM_AXES];        /* motor side: m, rad, rad */
    double joint_rate[CR_SIM_AXES];   /* m/s, rad/s */
    double joint_torque[CR_SIM_AXES]; /* what the amplifiers put out: N, N m, N m */
    int32_t counts[CR_SIM_AXES];      /* what the encoders read */
    int32_t wrist_counts[3];          /* in wrist_step_rad; of 1e-6 rad when that is 0 */
    double tip_pos_m[3], tip_vel_m_s[3];
    double tip_acc_m_s2[3];   /* mean over the last period */
    double hand_force_N[3];   /* of the device on the hand, mean over the last period: what is felt */
    double hand_target_m[3];  /* after the low-pass */
    uint64_t time_us;         /* of the mechanism since create */
    uint32_t limits, padding; /* bit i: axis i has touched a mechanical stop since create (bit 1 and 2: elbow) */
} cr_sim_state;

/* ------------------------------------------------------------------------------------------------------------ mechanism alone */

typedef struct cr_mech cr_mech;

/* Purpose  a mechanism at rest at its start.   Output  null when a parameter is not finite or out of range, or memory is out. */
cr_mech *cr_mech_create(const cr_sim_params *params);
void cr_mech_destroy(cr_mech *mech);

/* Purpose  torque demand of every axis from now on (after the declared delay). Units  N, N m, N m. Not finite counts as 0. */
void cr_mech_command(cr_mech *mech, const double torque[CR_SIM_AXES]);

/* Purpose  where the operator wants the tip to be, and how the wrist stands. Units  m; rad. */
void cr_mech_target(cr_mech *mech, const double target_m[3], const double wrist_rad[3]);

/* Purpose  give one axis a velocity.   Units  m/s for X, rad/s for the arm. */
void cr_mech_kick(cr_mech *mech, uint32_t axis, double rate);

/* Purpose  knock against the tip: an impulse within the next sub-step. Not finite: nothing.   Units  N s, frame of the base. */
void cr_mech_bump(cr_mech *mech, const double impulse_Ns[3]);

/* Purpose  move on by some sub-steps.   Cost  about 2 us a sub-step on a 3 GHz core. */
void cr_mech_advance(cr_mech *mech, uint32_t substeps);

void cr_mech_read(const cr_mech *mech, cr_sim_state *state);

/* Purpose  a spring -stiffness (x - x at start) on one axis, sampled and held over each period: the textbook virtual wall.
 * Output   position of that axis at each of the count samples; the run ends early with zeros once it exceeds 10 times what it
 *          had at most in the first tenth.   Units  N/m or N m/rad; m or rad. */
void cr_mech_wall(cr_mech *mech, uint32_t axis, double stiffness, double *samples, size_t count);

/* ----------------------------------------------------------------------------------------------------------- motored wrist */

/* Three motors on the wrist's axes (yaw, pitch, roll) and the hand that turns them. Beside the bus: its own controller has its encoders and
 * torques with each SYNC. Each axis is a mass on its own: what one turns of the others is left out. */
typedef struct {
    double inertia_kgm2[3];    /* motor and handle, 1e-6..10 */
    double viscous_Nms_rad[3]; /* 0..10 */
    double coulomb_Nm[3];      /* 0..10 */
    double torque_max_Nm[3];   /* 0..100 */
    double step_rad;           /* of the encoders, 0..0.1; 0: no quantisation */
    double hand_inertia_kgm2, hand_damping_Nms_rad, hand_stiffness_Nm_rad; /* 0..10, 0..10, 0..1e3 */
    double path_Hz;             /* the hand follows its target through a second-order low-pass, 0.1..1e3 */
    double period_s;            /* 1e-4..0.1 */
    uint32_t substeps, padding; /* of one period, 1..1000 */
} cr_sim_wrist_params;

typedef struct {
    cr_sim_wrist_params p;
    double angle_rad[3], rate_rad_s[3];
    double path_rad[3], path_rad_s[3]; /* the target after the low-pass */
    double motor_Nm[3];                /* in the last period, within the limits */
    double hand_torque_Nm[3];          /* of the wrist on the hand, mean over the last period: what is felt */
    int32_t counts[3], padding;        /* what the encoders read; of 1e-6 rad when step_rad is 0 */
} cr_sim_wrist;

/* Purpose  the default wrist: the table of sim/DESIGN.md, every number of it assumed. */
cr_sim_wrist_params cr_sim_wrist_params_default(void);

/* Purpose  a wrist at rest at these angles.   Output  0; -1 when a number is not finite or out of range: nothing written. */
int cr_sim_wrist_init(cr_sim_wrist *wrist, const cr_sim_wrist_params *params, const double angle_rad[3]);

/* Purpose  move on by one period. Units  rad: where the hand wants the axes; N m: of the motors, cut to torque_max_Nm. Not finite
 *          counts as 0 for torques, as before for targets. */
void cr_sim_wrist_advance(cr_sim_wrist *wrist, const double target_rad[3], const double torque_Nm[3]);

/* Purpose  knock against the handle: an impulse about each axis, at once. Not finite: nothing.   Units  N m s. */
void cr_sim_wrist_bump(cr_sim_wrist *wrist, const double impulse_Nms[3]);

/* -------------------------------------------------------------------------------------------------------------------- faults */

typedef enum {
    CR_SIM_FAULT_NONE = 0,
    CR_SIM_FAULT_DROP = 1,      /* a frame is lost */
    CR_SIM_FAULT_DELAY = 2,     /* it comes value ticks later */
    CR_SIM_FAULT_DUPLICATE = 3, /* it comes twice */
    CR_SIM_FAULT_REORDER = 4,   /* it comes after the frames that it should have been before */
    CR_SIM_FAULT_CORRUPT =
        5,                   /* byte (value >> 8) is exclusive-ored with value & 0xff; of a frame without bytes: lost */
    CR_SIM_FAULT_BABBLE = 6, /* the drive sends value more frames of identifier id each tick */
    CR_SIM_FAULT_SILENT =
        7, /* the drive neither sends nor hears, its power stage runs on until its own rules stop it */
    CR_SIM_FAULT_ENCODER_JUMP = 8,  /* value counts are added, and stay when the fault ends */
    CR_SIM_FAULT_ENCODER_STUCK = 9, /* the encoder keeps its reading */
    CR_SIM_FAULT_DRIVE_RESET = 10,  /* power-on again, once */
    CR_SIM_FAULT_BUS_OFF = 11, /* the drive's controller leaves the bus, the drive notices: zero torque, error 0x8140 */
    CR_SIM_FAULT_DRIVE_ERROR = 12, /* the drive faults with error code value, once */
    CR_SIM_FAULT_COUNT
} cr_sim_fault_kind;

enum { CR_SIM_FROM_DRIVES = 0, CR_SIM_TO_DRIVES = 1 };
#define CR_SIM_ANY_AXIS 255u

/* One fault: what, when, to whom. Ticks count the SYNC frames seen since create, the first is tick 1. */
typedef struct {
    uint32_t kind;      /* cr_sim_fault_kind */
    uint32_t tick;      /* first tick */
    uint32_t ticks;     /* how many ticks; 0 counts as 1 */
    uint32_t axis;      /* 0..2, or CR_SIM_ANY_AXIS */
    uint32_t id;        /* of the frames it acts on, or that a babbling drive sends */
    uint32_t direction; /* CR_SIM_FROM_DRIVES, CR_SIM_TO_DRIVES */
    int32_t value;
} cr_sim_fault;

/* --------------------------------------------------------------------------------------------------------- drives on the bus */

typedef struct cr_sim cr_sim;

/* Counters since create. */
typedef struct {
    uint64_t ticks;          /* SYNC frames seen */
    uint64_t frames_in;      /* frames heard */
    uint64_t frames_out;     /* frames sent */
    uint64_t frames_ignored; /* heard, and meant for nobody here */
    uint64_t frames_dropped; /* lost because the queue was full */
    uint64_t faults_done;    /* times a fault of the table acted */
} cr_sim_counters;

/* What a drive is about, for tests and displays. */
typedef struct {
    uint8_t nmt;             /* 0 initialising, 4 stopped, 5 operational, 127 pre-operational */
    uint8_t state;           /* cr_drive_state of drive.h */
    uint16_t statusword;     /* 0x6041 */
    uint16_t error_code;     /* 0x603F */
    int16_t torque_permille; /* demand that reaches the amplifier */
} cr_sim_drive;

/* Purpose  three drives just switched on, and the mechanism at its start. Their boot-up frames wait in the queue.
 * Units    wall_clock 0: lock-step; 1: the mechanism moves with time.   Output  null as cr_mech_create. */
cr_sim *cr_sim_create(const cr_sim_params *params, uint32_t wall_clock, uint64_t now_us);
void cr_sim_destroy(cr_sim *sim);

/* Purpose  a frame came over the bus.   Errors  none: frames that are not for the drives are counted. */
void cr_sim_receive(cr_sim *sim, const cr_sim_frame *frame, uint64_t now_us);

/* Purpose  let time pass: heartbeats, time-outs and, with wall_clock, the mechanism. Call at least once a millisecond. */
void cr_sim_poll(cr_sim *sim, uint64_t now_us);

/* Purpose  take what the drives send, in the order in which arbitration lets it through.
 * Output   frames written, at most frames_max; 0 when nothing waits. */
size_t cr_sim_send(cr_sim *sim, cr_sim_frame *frames, size_t frames_max);

/* Purpose  a wire (wire.h) keeps the time of the frames: a babbling drive is no longer held to what a period has room for. */
void cr_sim_on_wire(cr_sim *sim);

/* Purpose  where the operator wants the tip to be, and how the wrist stands. Units  m; rad. */
void cr_sim_target(cr_sim *sim, const double target_m[3], const double wrist_rad[3]);

/* Purpose  let the operator go through targets, one row a tick, from the first tick in which every drive is enabled; the last row
 *          holds. It replaces what cr_sim_target says.
 * Shapes   rows[count][6]: tip (m), wrist (rad); copied.   Output  0; -1 when memory is out or a number is not finite. */
int cr_sim_set_path(cr_sim *sim, const double *rows, size_t count);

/* Purpose  replace the fault table.   Output  0; -1 when a row is out of range: nothing changed. */
int cr_sim_set_faults(cr_sim *sim, const cr_sim_fault *faults, size_t count);

/* Purpose  see cr_mech_bump. */
void cr_sim_bump(cr_sim *sim, const double impulse_Ns[3]);

void cr_sim_read(const cr_sim *sim, cr_sim_state *state);
void cr_sim_read_drive(const cr_sim *sim, uint32_t axis, cr_sim_drive *drive);
cr_sim_counters cr_sim_count(const cr_sim *sim);

#endif
