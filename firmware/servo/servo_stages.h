/* The stages of the servo, in flow order, and what passes between them. Internal: users include servo.h.
 *
 *     frames -> bus -> joints -> pose -> (cr_tick) -> modes -> velocity -> control -> bus -> frames
 *
 * Each stage is a pure function of its arguments. */
#ifndef CR_SERVO_STAGES_H
#define CR_SERVO_STAGES_H

#include "contact/math3.h"
#include "servo.h"

/* -------------------------------------------------------------------------------------------------------- bus */

typedef enum {
    CR_PHASE_LISTEN = 0, /* nothing sent: somebody else may be the host */
    CR_PHASE_RESET,      /* NMT reset sent, waiting for the drives to boot */
    CR_PHASE_SET_UP,     /* SDO by SDO */
    CR_PHASE_ENABLE,     /* NMT started, control words up to OPERATION ENABLED */
    CR_PHASE_RUN
} cr_bus_phase;

typedef struct {
    int32_t counts;
    int16_t actual;
    uint16_t status;
    uint32_t state_count; /* states since SYNC */
    uint32_t other_count; /* other frames since SYNC */
    uint32_t twice_row;   /* periods in a row with more than one */
    uint32_t missing_row; /* periods in a row with none */
    uint64_t heard_ns;    /* last heartbeat */
    uint16_t control_word;
    uint8_t nmt_state;
    uint8_t seen; /* 1: spoke since the last reset */
    uint8_t has_state;
    uint8_t send_control; /* 1: control word is due */
} cr_drive;

/* The three sensed angles, which one drive reads and sends with every second SYNC. */
typedef struct {
    int32_t counts[3];
    uint32_t fresh; /* 1: came in this period */
    uint32_t age;   /* periods since it came */
} cr_wrist;

typedef struct {
    uint32_t phase;
    cr_drive drive[CR_AXES];
    cr_wrist wrist;
    uint64_t start_ns, reset_ns, sdo_ns, enable_ns, beat_ns, control_ns;
    uint32_t has_start;
    uint32_t refused; /* 1: a fault came before the first word; silent until cr_bus_reset */
    uint32_t sdo_axis, sdo_step, sdo_tries, sdo_waiting;
    uint32_t sdo_reading;                       /* 1: the step was written and is being read back */
    uint32_t sdo_object, sdo_found, sdo_wanted; /* of the last trouble: index << 8 | sub */
    uint32_t rated[CR_AXES], limit[CR_AXES];    /* what 0x6076 and 0x6072 have to say */
    uint32_t reset_due, start_due, reset_wait_ms;
    uint32_t faults; /* found by receive and check, taken by the caller */
    uint32_t sdo_abort, trouble_axis;
    uint16_t emcy_code;
} cr_bus;

/* Purpose  to the beginning: listening, all drives unknown. `axis`: what the drives must be rated for. */
void cr_bus_reset(cr_bus *bus, const cr_axis_config axis[CR_AXES]);

/* Purpose  the servo is in fault: a bus on which nothing has been sent stays silent, since another host may run it. Otherwise
 *          nothing: drives that have been set up need SYNC, zero torques and heartbeats. */
void cr_bus_refuse(cr_bus *bus);

/* Purpose  a period begins: the SYNC frame, unless listening. */
void cr_bus_sync(cr_bus *bus, cr_tx *tx);

/* Output  1 when a frame of this identifier means anything to the host. */
int cr_bus_is_of_interest(uint16_t id);

/* Purpose  one received frame.   Errors  faults go to bus->faults, oddities to counters. */
void cr_bus_receive(const cr_bus_config *config, cr_bus *bus, const cr_frame *frame, uint64_t now_ns,
                    cr_servo_counters *counters);

/* Purpose  what the period's frames, or their absence, mean: silent, unhealthy or doubled drives; steps the phases. */
void cr_bus_check(const cr_bus_config *config, cr_bus *bus, uint64_t now_ns, cr_servo_counters *counters);

/* Purpose  the frames that are due: torque first. `off` asks the drives to switch off. */
void cr_bus_transmit(const cr_bus_config *config, cr_bus *bus, const int16_t target[CR_AXES], int off, uint64_t now_ns,
                     cr_servo_counters *counters, cr_tx *tx);

/* Purpose  a joint torque in per mille of rated, rounded to nearest, clamped to `limit` and to int16; 0 for not-a-number. */
int16_t cr_per_mille(float torque, float rated, float limit);

/* ------------------------------------------------------------------------------------------------------ modes */

/* What moves the state machine. */
enum {
    CR_EVENT_DRIVES_SEEN = 1u,
    CR_EVENT_DRIVES_ENABLED = 2u,
    CR_EVENT_RESTED = 4u,
    CR_EVENT_START = 8u,
    CR_EVENT_STOP = 16u,
    CR_EVENT_CLEAR = 32u,
    CR_EVENT_FAULT = 64u,
    CR_EVENT_LIMIT = 128u
};

/* Purpose  the mode after these events. FAULT wins over all, STOP over START; one step per tick. */
uint32_t cr_mode_next(uint32_t mode, uint32_t events);
/* Output  1 in rendering and limited: the only modes whose torque may differ from zero. */
int cr_mode_is_rendering(uint32_t mode);

/* --------------------------------------------------------------------------------------------------- velocity */

/* Purpose  speed of one joint from its last counts: first-order adaptive windowing. The window is the longest one, up to
 *          `window`, whose end-to-end line passes within one count of every sample in it; the speed is the least-squares
 *          slope over it. Long and quiet when slow or steady, short and quick when the motion bends.
 * Why      One count in one period is 60 mm/s on the guide: the plain difference is useless for damping, and a fixed
 *          low-pass of equal noise lags always, this one only at constant speed, where lag costs nothing.
 * Measured (60 um steps, 1 kHz, window 16; tests/unit/test_control_velocity.c): noise 1.9, 0.5, 0.8, 0.5 mm/s RMS at 1, 5, 20,
 *          100 mm/s; lag 6.3 ms in 50 mm at 1 Hz, 4.3 ms in 5 mm at 5 Hz, 2.8 ms in 1 mm at 20 Hz. A first-order low-pass of the
 *          difference with 4 ms lag has 2.7, 4.1, 4.2, 4.3 mm/s; with this noise it lags 8 to 16 ms.
 * Source   Janabi-Sharifi, Hayward, Chen 2000. */
typedef struct {
    int32_t counts[CR_WINDOW_MAX + 1]; /* ring */
    uint32_t head, filled;
} cr_velocity;

void cr_velocity_reset(cr_velocity *velocity);
/* Purpose  one sample, `periods` after the last: 1 as a rule, more after lost states. Samples in between are put on a straight line.
 * Output   counts per period; finite.   Errors  none: a gap of more than CR_WINDOW_MAX starts anew. */
float cr_velocity_step(cr_velocity *velocity, int32_t counts, uint32_t periods, uint32_t window);

/* ---------------------------------------------------------------------------------------------------- control */

/* Periods between the tick that computes a force and the sample at the end of its action: the work in the step from
 * sample k-1 to sample k was done by the force of tick k-2, which went out with SYNC k-1. */
#define CR_FORCE_DELAY 2

typedef struct {
    cr_velocity velocity[CR_AXES];
    cr_vec3 tip_before_m;
    cr_vec3 applied_N[CR_FORCE_DELAY]; /* [0] of the last tick */
    cr_vec3 bridged_N;                 /* sum of the forces that acted in the periods since the last sample */
    cr_vec3 force_N;                   /* of the last tick, after the limits: where the rate limit starts */
    float torque[CR_AXES];
    float energy_J;
    float ramp; /* 0..1 */
    uint32_t has_before;
    uint32_t bridged;    /* periods since the last sample */
    uint32_t free_ticks; /* since the last contact force */
} cr_control;

typedef struct {
    const cr_kinematics *kinematics;
    cr_vec3 contact_force_N; /* from the haptic tick, world */
    float joint[CR_AXES];
    float speed[CR_AXES]; /* joint units per s */
    float period_s;
} cr_control_input;

typedef struct {
    float torque[CR_AXES]; /* joint torques, finite, within torque_max */
    cr_vec3 force_N;       /* what of them acts at the tip beyond compensation */
    cr_vec3 velocity_m_s;
    float energy_J;
    uint32_t limits;
    uint32_t finite; /* 0: the sums met a number that is none; torque and force are zero then */
} cr_control_output;

/* Purpose  forget motion, energy and force: the next tick starts from nothing. */
void cr_control_reset(cr_control *control);

/* Purpose  speeds of the joints, from counts; to be called in every tick.
 * Shapes   periods[a]: since the last sample of axis a; 0: none came, its speed is 0 and nothing is kept. */
void cr_control_speeds(const cr_servo_config *config, cr_control *control, const int32_t counts[CR_AXES],
                       const uint32_t periods[CR_AXES], float speed[CR_AXES]);

/* Purpose  one tick of rendering: damping, passivity, limits, compensation, joint torques.
 * Errors   none: out->limits.   Cost  about 0.2 us.   Source  DESIGN.md "Control". */
void cr_control_step(const cr_servo_config *config, cr_control *control, const cr_control_input *in,
                     cr_control_output *out);

/* Purpose  a tick without a fresh sample: a share of the last torque. */
void cr_control_bridge(cr_control *control, float share, cr_control_output *out);

/* ------------------------------------------------------------------------------------------------------ servo */

/* What a joint that does not move has been through. */
typedef struct {
    int32_t counts; /* that it has kept */
    uint32_t ticks; /* samples since they came */
    float torque;   /* on it when it had rested for stuck_ticks */
    cr_vec3 tip_m;  /* and where the tip was then */
    uint32_t
        pushed; /* samples in a row with a torque that differs from that by more than `stuck`, and the tip elsewhere */
} cr_still;

struct cr_servo {
    cr_servo_config config;
    cr_world *world;
    cr_bus bus;
    cr_control control;
    cr_kinematics kinematics;
    cr_joints joints;
    cr_servo_counters counters;
    cr_record record; /* of the last tick; of this one while it runs */
    uint64_t sync_ns, last_now_ns;
    uint32_t synced, ticks;
    uint32_t slept, overrun; /* periods without a tick before this one; before this and the late ones before it */
    uint32_t mode, faults, first_fault;
    uint32_t inputs, rx_drops, rx_babbled, frame_count;
    cr_frame frames[CR_RX_MAX];
    int32_t counts[CR_AXES], rest_counts[CR_AXES];
    uint32_t has_counts, has_wrist, rest_ticks, stale;
    cr_still still[CR_AXES];
    uint32_t missed[CR_AXES];     /* periods since the last sample that was taken in time */
    uint32_t gap[CR_AXES];        /* periods from the sample before to this tick's; 0: this tick has none */
    uint64_t sampled_ns[CR_AXES]; /* SYNC of the last sample that was taken */
    uint64_t asked_ns;            /* SYNC of the tick that last asked the world */
    uint32_t untouched;           /* the world was not asked in the tick before */
    uint32_t late; /* age of its answer in this one, late_max_ticks + 1 at most; CR_NOT_FELT: not asked */
    cr_output output;
};

#endif
