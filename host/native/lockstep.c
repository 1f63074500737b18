#include "lockstep.h"

#include "wire.h"

#include <string.h>

#define SDO_FIRST 0x611u
#define ANSWER_FIRST 0x591u
/* Transmission type of an RPDO that acts when it arrives (CiA 301). */
#define TYPE_AT_ONCE 255u
#define TYPE_SYNC 1u

typedef struct {
    cr_sim *sim;
    cr_wire *wire;
    int (*put)(cr_wire *, const cr_sim_frame *, uint64_t);
    int (*get)(cr_wire *, uint64_t, cr_sim_frame *, uint64_t *);
    void (*target)(cr_sim *, const double *, const double *);
    void (*read)(const cr_sim *, cr_sim_state *);
    void (*seen)(uint64_t, const cr_frame *);
} far_end;

static far_end bind(const cr_lockstep_drives *d) {
    far_end end = {(cr_sim *)d->sim,
                   (cr_wire *)d->wire,
                   (int (*)(cr_wire *, const cr_sim_frame *, uint64_t))d->put,
                   (int (*)(cr_wire *, uint64_t, cr_sim_frame *, uint64_t *))d->get,
                   (void (*)(cr_sim *, const double *, const double *))d->target,
                   (void (*)(const cr_sim *, cr_sim_state *))d->read,
                   d->seen};
    return end;
}

/* The host asks for torque with the next SYNC; a device without delay takes it when it comes. */
static void obey_at_once(cr_sim_frame *frame) {
    static const uint8_t type_of_torque[] = {0x2F, 0x01, 0x14, 0x02};
    if (frame->id >= SDO_FIRST && frame->id < SDO_FIRST + CR_AXES &&
        memcmp(frame->data, type_of_torque, sizeof type_of_torque) == 0) {
        frame->data[4] = TYPE_AT_ONCE;
    }
}

/* And reads it back. */
static void hide_at_once(cr_sim_frame *frame) {
    static const uint8_t type_of_torque[] = {0x4F, 0x01, 0x14, 0x02};
    if (frame->id >= ANSWER_FIRST && frame->id < ANSWER_FIRST + CR_AXES &&
        memcmp(frame->data, type_of_torque, sizeof type_of_torque) == 0) {
        frame->data[4] = TYPE_SYNC;
    }
}

static void to_drives(const far_end *end, const cr_lockstep_clock *clock, const cr_tx *tx, cr_servo *servo,
                      uint64_t now_ns) {
    for (uint32_t i = 0; i < tx->count; i++) {
        const cr_frame *from = &tx->frames[i];
        cr_sim_frame frame = {.id = from->id, .len = from->size};
        memcpy(frame.data, from->data, from->size);
        if (end->seen != NULL) {
            end->seen(now_ns, from);
        }
        if (clock->at_once) {
            obey_at_once(&frame);
        }
        if (end->put(end->wire, &frame, now_ns) != 0) {
            cr_servo_input(servo, CR_INPUT_SEND_FAILED);
        }
    }
}

/* What comes until then, or until the servo is ready.   Output  when it was over. */
static uint64_t to_servo(const far_end *end, const cr_lockstep_clock *clock, cr_servo *servo, uint64_t until_ns,
                         int stop_when_ready) {
    cr_sim_frame frame;
    uint64_t at_ns = until_ns;
    while (end->get(end->wire, until_ns, &frame, &at_ns)) {
        if (clock->at_once) {
            hide_at_once(&frame);
        }
        cr_frame to = {.id = (uint16_t)frame.id, .size = frame.len};
        memcpy(to.data, frame.data, frame.len);
        if (end->seen != NULL) {
            end->seen(at_ns, &to);
        }
        cr_servo_rx(servo, &to);
        if (stop_when_ready && cr_servo_get_status(servo).ready) {
            return at_ns;
        }
    }
    return until_ns;
}

static void note(const cr_sim_state *state, cr_lockstep_row *row) {
    memcpy(row->tip_pos_m, state->tip_pos_m, sizeof row->tip_pos_m);
    memcpy(row->tip_vel_m_s, state->tip_vel_m_s, sizeof row->tip_vel_m_s);
    memcpy(row->tip_acc_m_s2, state->tip_acc_m_s2, sizeof row->tip_acc_m_s2);
    memcpy(row->hand_force_N, state->hand_force_N, sizeof row->hand_force_N);
    memcpy(row->hand_target_m, state->hand_target_m, sizeof row->hand_target_m);
    memcpy(row->joint_torque, state->joint_torque, sizeof row->joint_torque);
}

/* A motored wrist is where it is: the drives sense that, and the target is its hand's. */
static void lead_handle(const far_end *end, cr_handle *handle, const double *target) {
    const cr_sim_wrist *wrist = handle->wrist;
    if (target != NULL) {
        memcpy(handle->target, target, sizeof handle->target);
    }
    end->target(end->sim, handle->target, wrist->angle_rad);
}

size_t cr_lockstep_run(cr_servo *servo, const cr_lockstep_drives *drives, cr_lockstep_clock *clock,
                       const double *targets, size_t count, uint32_t stop_modes, cr_record *records,
                       cr_lockstep_row *rows) {
    const far_end end = bind(drives);
    for (size_t k = 0; k < count; k++) {
        cr_tx tx;
        cr_sim_state state;
        clock->now_ns += clock->period_ns;
        (void)to_servo(&end, clock, servo, clock->now_ns, 0);
        if (drives->handle != NULL) {
            lead_handle(&end, drives->handle, targets != NULL ? targets + 6u * k : NULL);
        } else if (targets != NULL) {
            end.target(end.sim, targets + 6u * k, targets + 6u * k + 3u);
        }
        cr_servo_sync(servo, clock->now_ns, &tx);
        to_drives(&end, clock, &tx, servo, clock->now_ns);
        const uint64_t until_ns = clock->now_ns + (clock->at_once ? 0u : clock->deadline_ns);
        const uint64_t tick_ns = to_servo(&end, clock, servo, until_ns, !clock->at_once);
        end.read(end.sim, &state);
        cr_servo_tick(servo, tick_ns, clock->period_s, &tx);
        if (drives->handle != NULL) {
            cr_handle_tick(drives->handle, cr_servo_get_record(servo), &tx, &drives->handle_rows[k]);
        }
        to_drives(&end, clock, &tx, servo, tick_ns + clock->compute_ns);
        if (clock->search_work > 0u) {
            (void)cr_servo_search(servo, clock->search_work);
        }
        records[k] = *cr_servo_get_record(servo);
        note(&state, &rows[k]);
        if (records[k].mode < 32u && (stop_modes >> records[k].mode & 1u) != 0u) {
            return k + 1u;
        }
    }
    return count;
}
