/* Drives, mechanism and faults put together on one bus. */
#include "sim.h"

#include "dictionary.h"
#include "drive.h"
#include "fault.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* A frame on its way, out to the bus or in to one drive. */
typedef struct {
    cr_sim_frame frame;
    uint32_t due_tick;
    uint8_t late, axis;
} parcel;

typedef struct {
    parcel items[CR_SIM_QUEUE_MAX];
    uint32_t count;
} post;

struct cr_sim {
    cr_mech *mech;
    cr_drive drives[CR_SIM_AXES];
    cr_fault_table faults;
    post out, in;
    double period_s, step_s;
    uint32_t wall_clock, on_wire, tick, bus_off; /* bit i: axis i is off the bus */
    int64_t bits_left;                           /* of this period, while a drive babbles */
    uint64_t now_us;                             /* of the last call */
    uint64_t start_us, substeps;                 /* mechanism time in wall-clock mode */
    int32_t jump[CR_SIM_AXES], stuck[CR_SIM_AXES];
    double *path; /* [path_count][6], null: none */
    size_t path_count, path_at;
    cr_sim_counters counters;
};

static void mail(cr_sim *sim, post *to, const parcel *item) {
    if (to->count < CR_SIM_QUEUE_MAX) {
        to->items[to->count++] = *item;
    } else {
        sim->counters.frames_dropped++;
    }
}

static void take(post *from, uint32_t at, parcel *item) {
    *item = from->items[at];
    from->count--;
    memmove(from->items + at, from->items + at + 1, (from->count - at) * sizeof *from->items);
}

static int cut_off(cr_sim *sim, uint32_t axis) {
    return (sim->bus_off >> axis & 1u) != 0u ||
           cr_fault_find(&sim->faults, sim->tick, axis, CR_SIM_FAULT_SILENT) != NULL;
}

static int bit_budget_counts(const cr_sim *sim) {
    for (uint32_t i = 0; i < sim->faults.count; i++) {
        const cr_sim_fault *row = &sim->faults.rows[i];
        if (row->kind == CR_SIM_FAULT_BABBLE && sim->tick >= row->tick && sim->tick - row->tick <= row->ticks) {
            return 1;
        }
    }
    return 0;
}

/* What a drive has put in its outbox goes to the bus, past the faults. */
static void collect(cr_sim *sim, uint32_t axis) {
    cr_node *node = &sim->drives[axis].node;
    const int silent = node->out_count > 0u && cut_off(sim, axis);
    for (uint32_t i = 0; i < node->out_count && !silent; i++) {
        parcel item = {.frame = node->out[i], .axis = (uint8_t)axis};
        const cr_fault_fate fate = cr_fault_pass(&sim->faults, sim->tick, axis, CR_SIM_FROM_DRIVES, &item.frame);
        item.due_tick = sim->tick + fate.delay_ticks;
        item.late = (uint8_t)fate.late;
        for (uint32_t copy = 0; copy < fate.copies; copy++) {
            mail(sim, &sim->out, &item);
        }
    }
    sim->counters.frames_dropped += node->out_dropped;
    node->out_dropped = 0;
    node->out_count = 0;
}

static void command_mechanism(cr_sim *sim) {
    double torque[CR_SIM_AXES];
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        torque[i] = 1e-3 * cr_od_rated[i] * cr_drive_torque(&sim->drives[i]);
    }
    cr_mech_command(sim->mech, torque);
}

static void move_to(cr_sim *sim, uint64_t now_us) {
    if (!sim->wall_clock) {
        return;
    }
    /* The small part keeps a whole number of sub-steps from being cut to one less. */
    const uint64_t due = (uint64_t)(1e-6 * (double)(now_us - sim->start_us) / sim->step_s + 1e-6);
    if (due > sim->substeps) {
        cr_mech_advance(sim->mech, (uint32_t)(due - sim->substeps));
        sim->substeps = due;
    }
}

cr_sim *cr_sim_create(const cr_sim_params *params, uint32_t wall_clock, uint64_t now_us) {
    cr_sim *sim = calloc(1, sizeof *sim);
    cr_mech *mech = sim != NULL ? cr_mech_create(params) : NULL;
    if (mech == NULL) {
        free(sim);
        return NULL;
    }
    sim->mech = mech;
    sim->period_s = params->period_s;
    sim->step_s = params->period_s / params->substeps;
    sim->wall_clock = wall_clock;
    sim->start_us = sim->now_us = now_us;
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        cr_drive_init(&sim->drives[i], (uint8_t)i, now_us);
        collect(sim, i);
    }
    return sim;
}

void cr_sim_destroy(cr_sim *sim) {
    if (sim != NULL) {
        cr_mech_destroy(sim->mech);
        free(sim->path);
        free(sim);
    }
}

/* ----------------------------------------------------------------------------------------------------------------- one period */

static void fault_drives(cr_sim *sim, uint64_t now_us) {
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        const cr_sim_fault *row = cr_fault_find(&sim->faults, sim->tick, i, CR_SIM_FAULT_DRIVE_RESET);
        if (row != NULL && row->tick == sim->tick) {
            cr_drive_init(&sim->drives[i], (uint8_t)i, now_us);
        }
        row = cr_fault_find(&sim->faults, sim->tick, i, CR_SIM_FAULT_DRIVE_ERROR);
        if (row != NULL && row->tick == sim->tick) {
            cr_drive_fault(&sim->drives[i], (uint16_t)row->value);
        }
        const int off = cr_fault_find(&sim->faults, sim->tick, i, CR_SIM_FAULT_BUS_OFF) != NULL;
        if (off && (sim->bus_off >> i & 1u) == 0u) {
            cr_drive_fault(&sim->drives[i], CR_EMCY_BUS_OFF); /* its EMCY is lost with the bus */
        } else if (!off && (sim->bus_off >> i & 1u) != 0u) {
            cr_node_emcy(&sim->drives[i].node, CR_EMCY_BUS_OFF, 0x11u); /* "recovered from bus off" */
        }
        sim->bus_off = (sim->bus_off & ~(1u << i)) | (off ? 1u << i : 0u);
    }
}

static void babble(cr_sim *sim) {
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        const cr_sim_fault *row = cr_fault_find(&sim->faults, sim->tick, i, CR_SIM_FAULT_BABBLE);
        for (int32_t n = 0; row != NULL && n < row->value; n++) {
            const parcel item = {.frame = {.id = row->id, .len = 8}, .due_tick = sim->tick, .axis = (uint8_t)i};
            mail(sim, &sim->out, &item);
        }
    }
}

static int32_t encoder(cr_sim *sim, uint32_t axis, int32_t counts) {
    const cr_sim_fault *jump = cr_fault_find(&sim->faults, sim->tick, axis, CR_SIM_FAULT_ENCODER_JUMP);
    if (jump != NULL && jump->tick == sim->tick) {
        sim->jump[axis] += jump->value;
    }
    if (cr_fault_find(&sim->faults, sim->tick, axis, CR_SIM_FAULT_ENCODER_STUCK) == NULL) {
        sim->stuck[axis] = counts + sim->jump[axis];
    }
    return sim->stuck[axis];
}

static void sync_drive(cr_sim *sim, uint32_t axis, const cr_sim_state *state, uint64_t now_us) {
    const double permille = 1e3 * state->joint_torque[axis] / cr_od_rated[axis];
    for (uint32_t i = 0; i < 3u && axis == CR_OD_WRIST_AXIS; i++) {
        const int32_t counts = state->wrist_counts[i];
        const int32_t sent = counts > INT16_MAX ? INT16_MAX : counts < INT16_MIN ? INT16_MIN : counts;
        cr_node_set(&sim->drives[axis].node, 0x2100, (uint8_t)(i + 1u), (uint32_t)sent);
    }
    cr_drive_sync(&sim->drives[axis], encoder(sim, axis, state->counts[axis]), permille, sim->period_s, now_us);
}

static void hand_over(cr_sim *sim, const parcel *item, uint64_t now_us);

/* Frames that were held back and are due now. */
static void deliver_held(cr_sim *sim, uint64_t now_us) {
    for (uint32_t at = 0; at < sim->in.count;) {
        if (sim->in.items[at].due_tick > sim->tick) {
            at++;
            continue;
        }
        parcel item;
        take(&sim->in, at, &item);
        hand_over(sim, &item, now_us);
    }
}

/* Order within a period: faults act; every drive that hears the SYNC samples, answers and takes over what waited; the mechanism
 * then moves under the new torques. */
static void begin_period(cr_sim *sim, uint64_t now_us) {
    sim->tick++;
    sim->counters.ticks++;
    sim->bits_left = (int64_t)(sim->period_s * 1e6) - cr_frame_bits(0);
    fault_drives(sim, now_us);
    deliver_held(sim, now_us);
}

static void follow_path(cr_sim *sim) {
    int enabled = 1;
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        enabled = enabled && sim->drives[i].state == CR_DRIVE_ENABLED;
    }
    if (sim->path != NULL && (enabled || sim->path_at > 0u)) {
        const double *row = sim->path + 6u * sim->path_at;
        cr_mech_target(sim->mech, row, row + 3);
        sim->path_at += sim->path_at + 1u < sim->path_count ? 1u : 0u;
    }
}

static void end_period(cr_sim *sim) {
    babble(sim);
    follow_path(sim);
    command_mechanism(sim);
    if (!sim->wall_clock) {
        cr_mech_advance(sim->mech, (uint32_t)(sim->period_s / sim->step_s + 0.5));
    }
}

static void hand_over(cr_sim *sim, const parcel *item, uint64_t now_us) {
    if (item->frame.id == 0x80u) {
        cr_sim_state state;
        cr_mech_read(sim->mech, &state);
        sync_drive(sim, item->axis, &state, now_us);
    } else {
        (void)cr_drive_receive(&sim->drives[item->axis], &item->frame, now_us);
    }
    collect(sim, item->axis);
}

static int known(const cr_sim *sim, uint32_t id) {
    if (id == 0u || id == 0x80u) {
        return 1;
    }
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        const cr_node *node = &sim->drives[i].node;
        if (id == 0x600u + node->node || cr_node_watches(node, id)) {
            return 1;
        }
        for (uint16_t pdo = 0; pdo < CR_PDOS; pdo++) {
            if ((cr_node_get(node, (uint16_t)(0x1400u + pdo), 1) & 0x800007FFu) == id) {
                return 1;
            }
        }
    }
    return 0;
}

void cr_sim_receive(cr_sim *sim, const cr_sim_frame *frame, uint64_t now_us) {
    const int sync = frame->id == 0x80u;
    if (frame->len > 8u || frame->id > 0x7FFu || !known(sim, frame->id)) {
        sim->counters.frames_ignored++;
        return;
    }
    sim->now_us = now_us;
    move_to(sim, now_us);
    sim->counters.frames_in++;
    sim->bits_left -= cr_frame_bits(frame->len);
    if (sync) {
        begin_period(sim, now_us);
    }
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        parcel item = {.frame = *frame, .axis = (uint8_t)i};
        if (cut_off(sim, i)) {
            continue;
        }
        const cr_fault_fate fate = cr_fault_pass(&sim->faults, sim->tick, i, CR_SIM_TO_DRIVES, &item.frame);
        /* Late: after the next frames that come, at the latest with the next SYNC. */
        item.due_tick = sim->tick + fate.delay_ticks + (fate.late ? 1u : 0u);
        for (uint32_t copy = 0; copy < fate.copies; copy++) {
            if (item.due_tick > sim->tick) {
                mail(sim, &sim->in, &item);
            } else {
                hand_over(sim, &item, now_us);
            }
        }
    }
    if (sync) {
        end_period(sim);
    } else if (sim->wall_clock) {
        command_mechanism(sim); /* an RPDO of type 255 acts when it comes, not with a SYNC */
    }
}

void cr_sim_poll(cr_sim *sim, uint64_t now_us) {
    sim->now_us = now_us;
    move_to(sim, now_us);
    int16_t before[CR_SIM_AXES];
    int changed = 0;
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        before[i] = cr_drive_torque(&sim->drives[i]);
        cr_drive_poll(&sim->drives[i], now_us);
        changed |= before[i] != cr_drive_torque(&sim->drives[i]);
        collect(sim, i);
    }
    if (changed) {
        command_mechanism(sim); /* a drive that gives up does so at once, not at the next SYNC */
    }
}

/* ------------------------------------------------------------------------------------------------------------------------- out */

/* Arbitration: the lowest identifier that is due goes first; what is late goes after everything else. */
static int next_out(const cr_sim *sim) {
    int best = -1;
    for (uint32_t i = 0; i < sim->out.count; i++) {
        const parcel *item = &sim->out.items[i];
        if (item->due_tick > sim->tick) {
            continue;
        }
        const parcel *winner = best < 0 ? NULL : &sim->out.items[best];
        if (winner == NULL || item->late < winner->late ||
            (item->late == winner->late && item->frame.id < winner->frame.id)) {
            best = (int)i;
        }
    }
    return best;
}

/* Heartbeats of one drive are heard by those that watch it. Of each other's frames the drives need no more. */
static void tell_drives(cr_sim *sim, const parcel *item) {
    for (uint32_t i = 0; i < CR_SIM_AXES; i++) {
        if (i != item->axis && cr_node_watches(&sim->drives[i].node, item->frame.id) && !cut_off(sim, i)) {
            (void)cr_drive_receive(&sim->drives[i], &item->frame, sim->now_us);
        }
    }
}

size_t cr_sim_send(cr_sim *sim, cr_sim_frame *frames, size_t frames_max) {
    const int budget = !sim->on_wire && bit_budget_counts(sim);
    size_t count = 0;
    while (count < frames_max) {
        const int at = next_out(sim);
        if (at < 0) {
            break;
        }
        const uint32_t bits = cr_frame_bits(sim->out.items[at].frame.len);
        if (budget && sim->bits_left < (int64_t)bits) {
            break; /* the bus is full: the rest waits for the next period */
        }
        parcel item;
        take(&sim->out, (uint32_t)at, &item);
        sim->bits_left -= bits;
        sim->counters.frames_out++;
        tell_drives(sim, &item);
        frames[count++] = item.frame;
    }
    return count;
}

void cr_sim_on_wire(cr_sim *sim) { sim->on_wire = 1u; }

void cr_sim_target(cr_sim *sim, const double target_m[3], const double wrist_rad[3]) {
    cr_mech_target(sim->mech, target_m, wrist_rad);
}

int cr_sim_set_path(cr_sim *sim, const double *rows, size_t count) {
    for (size_t i = 0; i < 6u * count; i++) {
        if (!isfinite(rows[i])) {
            return -1;
        }
    }
    double *copy = count > 0u ? malloc(6u * count * sizeof *copy) : NULL;
    if (count > 0u && copy == NULL) {
        return -1;
    }
    if (copy != NULL) {
        memcpy(copy, rows, 6u * count * sizeof *copy);
    }
    free(sim->path);
    sim->path = copy;
    sim->path_count = count;
    sim->path_at = 0;
    return 0;
}

int cr_sim_set_faults(cr_sim *sim, const cr_sim_fault *faults, size_t count) {
    return cr_fault_set(&sim->faults, faults, count);
}

void cr_sim_bump(cr_sim *sim, const double impulse_Ns[3]) { cr_mech_bump(sim->mech, impulse_Ns); }

void cr_sim_read(const cr_sim *sim, cr_sim_state *state) { cr_mech_read(sim->mech, state); }

void cr_sim_read_drive(const cr_sim *sim, uint32_t axis, cr_sim_drive *drive) {
    const cr_drive *from = &sim->drives[axis < CR_SIM_AXES ? axis : 0u];
    *drive = (cr_sim_drive){.nmt = from->node.nmt,
                            .state = (uint8_t)from->state,
                            .statusword = (uint16_t)cr_node_get(&from->node, 0x6041, 0),
                            .error_code = (uint16_t)cr_node_get(&from->node, 0x603F, 0),
                            .torque_permille = cr_drive_torque(from)};
}

cr_sim_counters cr_sim_count(const cr_sim *sim) {
    cr_sim_counters counters = sim->counters;
    counters.faults_done = sim->faults.done;
    return counters;
}
