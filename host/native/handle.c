#include "handle.h"

#include "contact/math3.h"
#include "replay_rows.h"
#include "sim.h"

#include <string.h>

#define TORQUE_ID 0x181u
/* Bits of cr_record.fresh: the three drives' states. */
#define ALL_FRESH 7u
/* A point of the held tool may be left so far behind at the end of a tick, m. */
#define CAUGHT_UP_M 1e-6f

static int renders(const cr_record *r) { return r->mode == CR_MODE_RENDERING || r->mode == CR_MODE_LIMITED; }

/* Joints as the drives and the wrist's own encoders have them. */
static cr_joints joints_of(const cr_handle *h, const cr_record *r) {
    const cr_sim_wrist *wrist = h->wrist;
    const double step = wrist->p.step_rad > 0.0 ? wrist->p.step_rad : 1e-6;
    cr_joints joints = r->joints;
    for (int i = 0; i < 3; i++) {
        joints.wrist_rad[i] = (float)(step * wrist->counts[i]);
    }
    return joints;
}

/* Axes of the wrist in the world: yaw about Z of the base, pitch about the new Y, roll about the new X. */
static void wrist_axes(const cr_arm_config *arm, const float wrist_rad[3], cr_vec3 axes[3]) {
    float sy, cy, sp, cp;
    cr_pose base = {{0.0f, 0.0f, 0.0f}, arm->world_from_base.rot};
    const xform m = cr_xform_from_pose(&base);
    cr_sincos(wrist_rad[0], &sy, &cy);
    cr_sincos(wrist_rad[1], &sp, &cp);
    axes[0] = xform_rotate(&m, v3(0.0f, 0.0f, 1.0f));
    axes[1] = xform_rotate(&m, v3(-sy, cy, 0.0f));
    axes[2] = xform_rotate(&m, v3(cy * cp, sy * cp, -sp));
}

static int16_t read_word(const uint8_t *at) { return (int16_t)(uint16_t)((uint32_t)at[0] | (uint32_t)at[1] << 8); }

/* A force at the tip, into the words of the torque frame: per mille of rated, within the peak. */
static void add_force(const cr_servo_config *config, const cr_kinematics *k, cr_vec3 force, cr_tx *tx) {
    for (uint32_t n = 0; n < tx->count; n++) {
        for (size_t a = 0; a < CR_AXES && tx->frames[n].id == TORQUE_ID; a++) {
            const float rated = config->axis[a].rated, most = 1000.0f * config->axis[a].torque_max / rated;
            uint8_t *at = &tx->frames[n].data[2u * a];
            const float word = (float)read_word(at) + 1000.0f * v3_dot(k->column[a], force) / rated;
            const float held = word > most ? most : word < -most ? -most : word;
            const uint16_t bits = (uint16_t)(int16_t)(held < 0.0f ? held - 0.5f : held + 0.5f);
            at[0] = (uint8_t)(bits & 0xffu);
            at[1] = (uint8_t)(bits >> 8);
        }
    }
}

static void put_pose(float pos_m[3], float rot[4], const cr_pose *pose) {
    store_vec3(pos_m, pose->pos_m);
    rot[0] = pose->rot.w;
    rot[1] = pose->rot.x;
    rot[2] = pose->rot.y;
    rot[3] = pose->rot.z;
}

/* The coupling at this pose, and what of it is sent. */
static void feel_held(cr_handle *h, const cr_pose *pose, float period_s, cr_handle_row *row, cr_couple_wrench *sent) {
    cr_couple_output felt;
    const uint64_t start_ns = now_ns();
    cr_couple_tick(h->coupled, h->world, pose, period_s, &felt);
    cr_couple_passivity_step(h->passivity, pose, period_s, &felt, sent);
    row->tick_ns = (uint32_t)(now_ns() - start_ns);
    const cr_couple_stats *stats = &h->coupled->stats;
    const cr_vec3 drawn = v3_sub(h->coupled->couple.held.pos_m, h->coupled->couple.hand.pos_m);
    put_pose(row->held_pos_m, row->held_rot, &felt.held);
    store_vec3(row->contact_force_N, felt.force_world_N);
    store_vec3(row->contact_torque_Nm, felt.torque_world_Nm);
    row->drawn_m = felt.pressing > 0u ? v3_norm(drawn) : 0.0f;
    row->inside_m = felt.inside_m;
    row->energy_J = sent->energy_J;
    row->pressing = felt.pressing;
    row->contacts = stats->contacts;
    row->near = stats->near;
    row->lookups = stats->lookups;
    row->late = stats->left_m > CAUGHT_UP_M ? 1u : 0u;
    row->left_out = stats->dropped + stats->refused;
    row->faults = sent->faults;
    row->limits = sent->limits;
}

/* No fresh sample: half of what was sent before, and the coupling waits. */
static void bridge(const cr_handle *h, cr_couple_wrench *sent) {
    sent->force_world_N = v3_scale(v3_from(h->before), 0.5f);
    sent->torque_world_Nm = v3_scale(v3_from(h->before + 3), 0.5f);
}

/* The wrist moves on under what was sent so many ticks before. */
static void move_wrist(cr_handle *h, const double torque_Nm[3], cr_handle_row *row) {
    const cr_sim_wrist *wrist = h->wrist;
    memmove(h->sent_Nm[1], h->sent_Nm[0], CR_COUPLE_DELAY_MAX * sizeof h->sent_Nm[0]);
    for (int i = 0; i < 3; i++) {
        h->sent_Nm[0][i] = torque_Nm[i];
        row->motor_Nm[i] = (float)torque_Nm[i];
        row->wrist_rad[i] = (float)wrist->angle_rad[i];
        row->wrist_rad_s[i] = (float)wrist->rate_rad_s[i];
        row->hand_torque_Nm[i] = (float)wrist->hand_torque_Nm[i];
    }
    h->advance(h->wrist, h->target + 3, h->sent_Nm[h->delay_ticks]);
}

void cr_handle_tick(cr_handle *h, const cr_record *record, cr_tx *tx, cr_handle_row *row) {
    const cr_joints joints = joints_of(h, record);
    cr_couple_wrench sent;
    cr_kinematics k;
    cr_vec3 axes[3];
    double torque_Nm[3];
    memset(row, 0, sizeof *row);
    memset(&sent, 0, sizeof sent);
    cr_kinematics_solve(&h->config->arm, &joints, &k);
    put_pose(row->hand_pos_m, row->hand_rot, &k.world_from_tool);
    put_pose(row->held_pos_m, row->held_rot, &k.world_from_tool);
    if (!renders(record)) {
        cr_coupled_reset(h->coupled);
        cr_couple_passivity_reset(h->passivity);
    } else if ((record->fresh & ALL_FRESH) != ALL_FRESH) {
        bridge(h, &sent);
    } else {
        feel_held(h, &k.world_from_tool, record->period_s, row, &sent);
    }
    h->rendering = renders(record) ? 1u : 0u;
    store_vec3(row->force_N, sent.force_world_N);
    store_vec3(row->torque_Nm, sent.torque_world_Nm);
    store_vec3(h->before, sent.force_world_N);
    store_vec3(h->before + 3, sent.torque_world_Nm);
    add_force(h->config, &k, sent.force_world_N, tx);
    /* About the tip, where the wrist's axes meet. */
    const cr_vec3 arm = v3_sub(k.world_from_tool.pos_m, k.tip_world_m);
    const cr_vec3 about_tip = v3_add(sent.torque_world_Nm, v3_cross(arm, sent.force_world_N));
    wrist_axes(&h->config->arm, joints.wrist_rad, axes);
    for (int i = 0; i < 3; i++) {
        torque_Nm[i] = (double)v3_dot(axes[i], about_tip);
    }
    move_wrist(h, torque_Nm, row);
}
