/* servo: one period of the device. Frames of the motor bus in, frames of the motor bus out.
 *
 * Flow     cr_servo_init; then each period: cr_servo_sync -> send; cr_servo_rx for what arrives; cr_servo_tick -> send; with late_max_ticks above 0
 *          also cr_servo_search, in a thread of its own or in a main loop that the other calls interrupt.
 *          SYNC k samples the drives; the torque computed from that sample acts from SYNC k+1 to SYNC k+2.
 * Memory   the caller's: cr_servo_size bytes, 64-byte aligned. Holds the servo and its world. No heap.
 * Threads  none inside: all calls from the one thread of the loop, except the reading end of the record ring and cr_servo_search.
 * Time     an argument: nanoseconds of any clock that only goes forward. No clock, no I/O, no globals: outputs are a pure
 *          function of (scene, config, sequence of calls), so that a recording re-runs to the bit. With a search beside the
 *          ticks each record tells how old the contact was, and a re-run looks for it at that pose.
 * Units    SI. Axis 0 is the guide (m, N), axes 1 and 2 the arm (rad, N m): "joint unit" is m or rad, "joint torque" N or N m.
 * Trouble  a limit reduces the torque, keeps running and is counted; a fault commands zero torque in the same tick and
 *          latches until CR_COMMAND_CLEAR. Every number on the bus and in the record is finite.
 * Bus      CANopen as servo/SPEC.md has it: CiA 301, CiA 402, three drives in cyclic synchronous torque. */
#ifndef CREASE_SERVO_H
#define CREASE_SERVO_H

#include "crease.h"

#ifdef __cplusplus
extern "C" {
#endif

#define CR_AXES 3

/* Frames of interest taken in one period. The drives send at most 11 (3 states, wrist, 3 heartbeats, 3 EMCY, 1 SDO answer):
 * more is a babbling node. The record of a tick holds them all, hence no more. */
#define CR_RX_MAX 12
/* Frames one call may ask to send: torque, 3 control words, NMT, SDO, heartbeat. */
#define CR_TX_MAX 8

/* ------------------------------------------------------------------------------------------------- configuration */

/* Geometry of the arm. Base frame: X along the guide, Y forward, Z up. The arm is a parallelogram with both motors at the
 * carriage, so that the two joints are the elevations of the links themselves, not of one against the other:
 *     tip = (guide, upper cos u + fore cos f, upper sin u + fore sin f),    elbow = u - f. */
typedef struct {
    cr_pose world_from_base;
    cr_pose tip_from_tool; /* how the tool sits on the last wrist axis; the tip is where the wrist axes meet */
    float upper_m, fore_m; /* link lengths, 0.05..5 */
    float joint_min[CR_AXES], joint_max[CR_AXES];
    float elbow_min_rad, elbow_max_rad;       /* inside 0..pi: the arm is singular at both ends */
    float wrist_min_rad[3], wrist_max_rad[3]; /* yaw about Z, then pitch about Y, then roll about X */
    float margin_min;                         /* 0..1: singularity margin |sin elbow| below which force fades */
    float range_slack; /* joint units beyond joint_min/max that a sample may lie before it is a fault */
} cr_arm_config;

typedef struct {
    float step;           /* joint units per encoder count; negative when the encoder counts backwards */
    float offset;         /* joint at zero counts */
    float rated;          /* joint torque at 1000 per mille of CiA 402 (0x6076) */
    float torque_max;     /* joint torque, peak; never exceeded on the bus */
    float jump_max;       /* joint units in one period: more is a fault */
    float gravity;        /* joint torque that holds the link when level, times cos(joint); for the guide: constant */
    float coulomb;        /* joint torque of dry friction */
    float friction_speed; /* joint units per s at which half of the friction is compensated */
    float stuck; /* joint torque: a joint that rests through a swing of more than this is suspect; 0: not watched */
} cr_axis_config;

typedef struct {
    float contact_damping_Ns_m; /* along the contact force; never makes it pull */
    float free_damping_Ns_m;    /* always, in all directions */
    float friction_share;       /* 0..1 of coulomb that is compensated; 1 would make the hand feel none */
    float force_max_N;          /* on |force| at the tip */
    float force_rate_max_N_s;   /* on its growth; release is free, so that a limit never holds the hand */
    float power_max_W;          /* on what the device gives to the hand */
    float speed_max_m_s;        /* above it, force that would speed up the tip fades to nothing at twice the speed */
    float passivity_damping_max_Ns_m; /* of the passivity controller; 0: observe only */
    float
        own_damping_Ns_m; /* viscous friction of the mechanism that the controller counts on: less than any axis has */
    float ramp_s;         /* force grows from nothing to full after start */
    uint32_t window;      /* periods the velocity estimate may look back, 2..CR_WINDOW_MAX */
} cr_control_config;
#define CR_WINDOW_MAX 32

typedef struct {
    uint32_t heartbeat_ms;     /* of the host and of the drives */
    uint32_t host_timeout_ms;  /* a drive without the host's heartbeat goes to zero torque after this (0x1016) */
    uint32_t drive_timeout_ms; /* the host without a drive's heartbeat faults after this */
    uint32_t missing_max;      /* periods in a row without a drive's state, or a tick, that are bridged; then a fault */
    uint32_t sdo_timeout_ms;
    uint32_t enable_timeout_ms; /* from the last SDO to OPERATION ENABLED */
    uint32_t listen_ms;         /* silence at start: nobody else may speak for the host */
    uint32_t rest_ticks;        /* calibrating ends after so many periods with the joints at rest */
    uint32_t
        torque_timeout_ms; /* a drive without torque frames goes to zero torque after this (0x1401:5); 0: does not */
    uint32_t stuck_ticks;  /* how long a joint has to rest, then to be pushed in vain, before its encoder is stuck */
    uint32_t vendor_id, product_code,
        revision; /* 0x1018:1..3 that every drive must have; of the revision the major half */
} cr_bus_config;

typedef struct {
    cr_arm_config arm;
    cr_axis_config axis[CR_AXES];
    float wrist_step_rad; /* per count */
    cr_control_config control;
    cr_bus_config bus;
    cr_config world;
    float period_s;       /* nominal; 0.2e-3..0.1 */
    float overrun_s;      /* from tick to tick: one after more is late, and bridged as bus.missing_max says */
    float stuck_travel_m; /* how far the other joints have to move the tip before a resting one can count as stuck */
    /* 0: a tick searches for contact itself, as cr_tick. Else cr_servo_search does, beside the ticks, and contact so many felt
     * poses old may be felt; older is not, and is a fault while rendering. What falls as it rises may be twice as old. Up to
     * CR_LATE_MAX. A period without a drive's state feels no pose and does not count: with bus.missing_max in a row between any
     * two, it is 1 + missing_max times as many periods. */
    uint32_t late_max_ticks;
} cr_servo_config;
#define CR_LATE_MAX 255u

/* Purpose  the LHifAM of sim/DESIGN.md. Every number of it is assumed, none is measured on a device. */
cr_servo_config cr_servo_config_default(void);

/* Purpose  what is wrong with a configuration.   Output  null when it is valid, else a static line that names the field and
 *          its range. */
const char *cr_servo_config_error(const cr_servo_config *config);

/* -------------------------------------------------------------------------------------------------- kinematics */

typedef struct {
    float joint[CR_AXES]; /* m, rad, rad */
    float wrist_rad[3];
} cr_joints;

enum {
    CR_RANGE_JOINT = 1u, /* << axis: beyond its limits */
    CR_RANGE_ELBOW = 8u,
    CR_RANGE_WRIST = 16u /* << angle */
};

typedef struct {
    cr_pose world_from_tool;
    cr_vec3 tip_world_m;
    cr_vec3 column[CR_AXES]; /* of the Jacobian: motion of the tip in the world for a unit of each joint */
    float margin;            /* |sin elbow|: 1 best, 0 singular */
    uint32_t range;          /* CR_RANGE_* bits */
} cr_kinematics;

/* Purpose  joint values to pose, Jacobian, limits and margin.
 * Output   finite for any input; position within 0.5 um of exact for joints in range, rotation within 7e-7 (test_pose).
 * Cost     about 60 ns. */
void cr_kinematics_solve(const cr_arm_config *arm, const cr_joints *joints, cr_kinematics *out);

/* Purpose  the joints that put the tool at a pose (elbow up).
 * Output   *joints.   Errors  CR_ERR_VALUE: out of reach, *joints untouched. Limits are not asked: see range. */
cr_err cr_joints_from_pose(const cr_arm_config *arm, const cr_pose *world_from_tool, cr_joints *joints);

/* Purpose  sine and cosine without libm.   Output  within 1.2e-7 of exact for |angle| <= 100; sin 0, cos 1 beyond or for
 *          not-a-number. */
void cr_sincos(float angle_rad, float *sine, float *cosine);
/* Purpose  angle of (x, y), -pi..pi, without libm.   Output  within 4e-7 rad of exact; 0 at the origin or not-a-number. */
float cr_atan2(float y, float x);

/* --------------------------------------------------------------------------------------------------------- bus */

/* A classical data frame with an 11-bit identifier. */
typedef struct {
    uint16_t id;
    uint8_t size;  /* 0..8 */
    uint8_t flags; /* CR_FRAME_EARLY, set by cr_servo_rx */
    uint8_t data[8];
} cr_frame;
#define CR_FRAME_EARLY 1u /* came before this period's SYNC: the answer to the one before */

typedef struct {
    uint32_t count;
    cr_frame frames[CR_TX_MAX]; /* to be sent in this order */
} cr_tx;

/* ------------------------------------------------------------------------------------------------ modes and trouble */

typedef enum {
    CR_MODE_INIT = 0,    /* listening, then waiting for the drives */
    CR_MODE_BUS_UP,      /* setting up and enabling the drives */
    CR_MODE_CALIBRATING, /* drives enabled, zero torque, waiting for the joints to rest */
    CR_MODE_IDLE,        /* ready, zero torque */
    CR_MODE_RENDERING,
    CR_MODE_LIMITED, /* rendering, and a limit reduced the torque in this tick */
    CR_MODE_FAULT,   /* zero torque until CR_COMMAND_CLEAR */
    CR_MODE_COUNT
} cr_mode;

enum {
    CR_COMMAND_START = 1u,
    CR_COMMAND_STOP = 2u,
    CR_COMMAND_CLEAR = 4u,
    CR_COMMAND_OFF = 64u,       /* zero torque, drives switched off in this tick, then from the start; not in fault */
    CR_INPUT_BUS_OFF = 8u,      /* the controller left the bus */
    CR_INPUT_SEND_FAILED = 16u, /* a frame of the last call could not be sent */
    CR_INPUT_NO_SYNC = 32u      /* in records only: the tick came without its SYNC */
};

enum {
    CR_LIMIT_FORCE = 1u,
    CR_LIMIT_RATE = 2u,
    CR_LIMIT_TORQUE = 4u,
    CR_LIMIT_POWER = 8u,
    CR_LIMIT_SPEED = 16u,
    CR_LIMIT_PASSIVITY = 32u,
    CR_LIMIT_WORKSPACE = 64u, /* near the singularity or at a joint limit */
    CR_LIMIT_STALE = 128u     /* a drive's state or a tick is missing: the last torque, halved for each period */
};
#define CR_LIMIT_COUNT 8

enum {
    CR_FAULT_SILENT = 1u,       /* a drive's state, or the wrist, is missing for longer than missing_max */
    CR_FAULT_HEARTBEAT = 2u,    /* a drive's heartbeat is overdue */
    CR_FAULT_RESET = 4u,        /* a drive booted or left NMT operational */
    CR_FAULT_DRIVE = 8u,        /* a drive's status word says fault */
    CR_FAULT_DRIVE_STATE = 16u, /* a drive is not, or not in time, OPERATION ENABLED */
    CR_FAULT_EMCY = 32u,        /* a drive sent an emergency */
    CR_FAULT_JUMP = 64u,        /* an encoder moved faster than jump_max */
    CR_FAULT_RANGE = 128u,      /* a joint is where it cannot be */
    CR_FAULT_NOT_FINITE = 256u, /* a number that is none, or a pose that the world refuses */
    CR_FAULT_OVERRUN = 512u,    /* more than missing_max periods in a row went by without a tick, while rendering */
    CR_FAULT_BAD_STATE = 1024u, /* calls out of order, time going back, or a period out of range */
    CR_FAULT_ALIEN = 2048u,     /* somebody else speaks with the host's or twice with a drive's identifiers */
    CR_FAULT_BABBLE = 4096u,    /* more than CR_RX_MAX frames in a period, or more than a drive has reason for */
    CR_FAULT_BUS_OFF = 8192u,   /* the bus cannot be reached */
    CR_FAULT_SDO = 16384u,      /* a drive refused its set-up, or did not answer */
    CR_FAULT_STUCK = 32768u, /* an encoder did not move, to the bit, while the torque on it and the other joints did */
    CR_FAULT_MISMATCH = 65536u, /* a drive is of another make, rating or limit, or did not keep what was written */
    CR_FAULT_LATE =
        131072u /* the contact in hand is more than late_max_ticks felt poses old: the search does not answer */
};
#define CR_FAULT_COUNT 18

/* Purpose  lower-case name of a mode, of one limit bit, of one fault bit.   Output  static text, never null. */
const char *cr_mode_text(uint32_t mode);
const char *cr_limit_text(uint32_t bit);
const char *cr_servo_fault_text(uint32_t bit);

/* Since init; they wrap. */
typedef struct {
    uint32_t ticks_rendering, ticks_limited;
    uint32_t limits[CR_LIMIT_COUNT]; /* ticks in which limit bit i reduced */
    uint32_t faults;                 /* times the servo went to fault */
    uint32_t missing[CR_AXES];       /* states of a drive that were not there at the tick */
    uint32_t late;                   /* frames that came after their tick */
    uint32_t twice;                  /* second states of a drive in one period */
    uint32_t malformed;              /* frames of a wrong length or with a wrong content */
    uint32_t alien;                  /* frames on the host's own identifiers */
    uint32_t babbled;                /* frames beyond what a period may bring */
    uint32_t emcy;
    uint32_t sdo_retries;
    uint32_t overruns; /* late ticks */
    uint32_t send_failed;
    uint32_t rx_drops;      /* frames the operating system lost, as the port reports them */
    uint32_t wrist_missing; /* wrist frames that did not come */
} cr_servo_counters;

/* ------------------------------------------------------------------------------------------------------ record */

/* One tick: all its inputs, so that it can be run again, and what came of them. 512 bytes, little-endian; see servo/SPEC.md. */
typedef struct {
    /* inputs */
    uint32_t tick;
    uint32_t inputs; /* CR_COMMAND_*, CR_INPUT_* taken in this tick */
    uint64_t sync_ns, now_ns;
    float period_s;
    uint32_t rx_drops;
    uint32_t rx_babbled;
    uint32_t frame_count;
    cr_frame frames[CR_RX_MAX];
    /* outputs */
    uint32_t mode, faults, limits;
    int32_t counts[CR_AXES];
    int32_t wrist_counts[3];
    uint16_t status[CR_AXES];
    int16_t target[CR_AXES]; /* per mille of rated, as sent */
    int16_t actual[CR_AXES]; /* per mille of rated, as the drive told */
    uint16_t fresh;          /* bit a: axis a answered this period's SYNC; bit 3: the wrist came */
    cr_joints joints;
    cr_pose world_from_tool;
    cr_vec3 velocity_world_m_s; /* of the tip */
    cr_vec3 contact_force_world_N, contact_torque_world_Nm;
    cr_vec3 force_world_N; /* commanded at the tip */
    float torque[CR_AXES]; /* commanded joint torques, compensation included */
    float energy_J;        /* given by the contact since it began, less what friction burnt of it; above 0: active */
    float depth_m, margin;
    uint32_t area_count, zone_count;
    cr_servo_counters counters;
    uint32_t trouble_axis;          /* drive of the last SDO, EMCY or drive fault; CR_AXES: none */
    uint32_t sdo_object;            /* index << 8 | sub that the last fault sdo or mismatch is about */
    uint32_t sdo_found, sdo_wanted; /* with CR_FAULT_MISMATCH */
    uint32_t sdo_abort;             /* with CR_FAULT_SDO: CiA 301 abort code, 0xffffffff for no answer */
    uint32_t contact_late_ticks;    /* age of the contact felt, see below; CR_NOT_FELT in ticks that asked for none */
    uint32_t spare;                 /* 0 */
    /* of the port, not of the servo: not compared by a re-run */
    uint32_t wake_late_ns; /* start of the period after its time */
    uint32_t tick_ns;      /* cost of the tick */
} cr_record;
#define CR_RECORD_BYTES 512
/* contact_late_ticks counts felt poses since the one whose contact it is; late_max_ticks + 1: too old, nothing was felt. */
#define CR_NOT_FELT 0xffffffffu

/* Head of a recording file; cr_servo_config follows, then records from records_at on. */
typedef struct {
    char magic[8]; /* "CRRECORD" */
    uint32_t version, record_bytes, config_bytes, records_at;
    uint32_t scene_crc32, scene_bytes;
} cr_record_head;
#define CR_RECORD_VERSION 5u
#define CR_RECORDS_AT 1024u

/* Purpose  first bytes of a recording file.   Shapes  out[CR_RECORDS_AT], all written. */
void cr_record_head_write(const cr_servo_config *config, const void *image, size_t image_bytes, uint8_t *out);
/* Purpose  read them back.   Shapes  bytes[CR_RECORDS_AT].
 * Errors   MAGIC, VERSION, SIZE: not a recording this library wrote; CONFIG: of an invalid configuration. Untouched then. */
cr_err cr_record_head_read(const uint8_t *bytes, cr_record_head *head, cr_servo_config *config);

/* Ring between the loop (writes, never waits) and one other thread (reads, writes the file). */
typedef struct cr_record_ring cr_record_ring;

/* Purpose  bytes for a ring of `records`, a power of two of 2..2^20.   Output  0 when it is not. */
size_t cr_record_ring_size(uint32_t records);
/* Errors   NULL, ALIGN (64), SIZE, CONFIG. */
cr_err cr_record_ring_init(cr_record_ring **ring, void *memory, size_t size_bytes, uint32_t records);
/* Purpose  put one record in, or count it as lost when there is no room.   Threads  the writer's.   Cost  one copy. */
void cr_record_push(cr_record_ring *ring, const cr_record *record);
/* Purpose  take up to `max` records out, oldest first.   Output  how many.   Threads  the reader's. */
uint32_t cr_record_pop(cr_record_ring *ring, cr_record *out, uint32_t max);
/* Purpose  records that did not fit, so far.   Threads  any. */
uint32_t cr_record_lost(const cr_record_ring *ring);

/* ------------------------------------------------------------------------------------------------------- servo */

typedef struct cr_servo cr_servo;

typedef struct {
    uint32_t mode, faults, limits;
    uint32_t first_fault;  /* the bits of the tick in which the servo went to fault */
    uint32_t axes_seen;    /* bit a: drive a has spoken */
    uint32_t sdo_abort;    /* CiA 301 abort code, 0xffffffff for no answer; valid with CR_FAULT_SDO */
    uint32_t trouble_axis; /* drive of the last SDO, EMCY or drive fault; CR_AXES: none */
    uint16_t emcy_code;
    uint16_t ready; /* 1: every drive has answered this period's SYNC, the tick need not wait */
    cr_servo_counters counters;
} cr_servo_status;

/* Purpose  bytes of memory a servo for this scene needs.   Output  0 when scene or config is invalid. */
size_t cr_servo_size(const cr_scene *scene, const cr_servo_config *config);

/* Purpose  build a servo in the caller's memory (64-byte aligned). Starts in CR_MODE_INIT, nothing sent.
 * Errors   NULL, ALIGN, SIZE, CONFIG. */
cr_err cr_servo_init(cr_servo **servo, void *memory, size_t size_bytes, const cr_scene *scene,
                     const cr_servo_config *config);

/* Purpose  begin a period: the SYNC frame, once the listening at start is over.   Output  *tx. */
void cr_servo_sync(cr_servo *servo, uint64_t now_ns, cr_tx *tx);

/* Purpose  a frame from the bus. Only kept; looked at by the tick. Frames of no interest cost nothing. */
void cr_servo_rx(cr_servo *servo, const cr_frame *frame);

/* Purpose  the tick: frames -> drive states -> joints -> pose -> wrench -> torques -> frames.
 * Units    period_s: from the last tick's SYNC to this one's, within a factor of two of config.period_s.
 * Output   *tx: the torque frame first, then whatever else is due. Finite, within the limits.
 * Errors   none: see faults and counters.   Cost  cr_tick, or cr_feel with late_max_ticks, plus about 1 us. */
void cr_servo_tick(cr_servo *servo, uint64_t now_ns, float period_s, cr_tx *tx);

/* Purpose  with late_max_ticks above 0: one slice of the search for contact at the newest pose, beside the ticks.
 * Units    work: as of cr_search.   Output  work done; 0: nothing to do before the next tick.
 * Threads  one other thread, or a main loop that all other calls interrupt. Neither waits for the other. */
uint32_t cr_servo_search(cr_servo *servo, uint32_t work);

/* Purpose  CR_COMMAND_* and CR_INPUT_* bits for the next tick. START counts in idle only, CLEAR in fault only. */
void cr_servo_input(cr_servo *servo, uint32_t bits);
/* Purpose  what the operating system says it lost, in total: for the record. */
void cr_servo_rx_drops(cr_servo *servo, uint32_t total);

cr_servo_status cr_servo_get_status(const cr_servo *servo);
/* Purpose  the last tick.   Output  valid until the next one. */
const cr_record *cr_servo_get_record(const cr_servo *servo);
/* Purpose  what the haptic tick answered in the last tick: areas for a display, and zones where the answer is of this pose. */
const cr_output *cr_servo_get_output(const cr_servo *servo);

typedef struct {
    uint32_t records;               /* re-run */
    uint32_t different;             /* of these, not the same to the bit in every output field */
    uint32_t first;                 /* tick of the first of them */
    uint32_t gap;                   /* 1: a record is missing before `first`; re-running stopped there */
    cr_pose felt[CR_LATE_MAX + 1u]; /* the last poses, for contact that was searched beside the ticks */
} cr_rerun;

/* Purpose  feed the inputs of recorded ticks to a fresh servo and compare every output.
 * Shapes   records[count], the first one is the servo's first tick.   Output  *result, zeros at first, is added to, so that a long file can
 *          come in pieces, with the same result for all of them; out[count], when not null, gets the records of the re-run.
 * Threads  it searches for contact itself where the recording did beside the ticks: no cr_servo_search meanwhile.
 * Errors   NULL. */
cr_err cr_servo_rerun(cr_servo *servo, const cr_record *records, size_t count, cr_rerun *result, cr_record *out);

#ifdef __cplusplus
}
#endif

#endif
