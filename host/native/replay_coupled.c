#include "replay.h"

#include "replay_rows.h"

#include <math.h>
#include <string.h>

/* A point of the tool may be left so far behind at the end of a tick, m. */
#define DONE_M 1e-6f

static void store_coupled(cr_replay_row *row, const cr_couple_output *out, const cr_coupled *coupled) {
    const cr_couple_stats *stats = &coupled->stats;
    const cr_vec3 f = out->force_world_N, hand = coupled->couple.hand.pos_m, held = coupled->couple.held.pos_m;
    const float force_N = sqrtf(f.x * f.x + f.y * f.y + f.z * f.z), scale = force_N > 0.0f ? 1.0f / force_N : 0.0f;
    const float x = held.x - hand.x, y = held.y - hand.y, z = held.z - hand.z;
    const cr_vec3 along = {scale * f.x, scale * f.y, scale * f.z};
    memset(row, 0, sizeof *row);
    store_vec3(row->force_N, f);
    store_vec3(row->torque_Nm, out->torque_world_Nm);
    store_vec3(row->normal, along);
    store_vec3(row->display_pos_m, out->held.pos_m);
    row->depth_m = out->pressing > 0u ? sqrtf(x * x + y * y + z * z) : 0.0f;
    row->display_rot[0] = out->held.rot.w;
    row->display_rot[1] = out->held.rot.x;
    row->display_rot[2] = out->held.rot.y;
    row->display_rot[3] = out->held.rot.z;
    row->areas = row->contacts = out->pressing;
    row->zones = stats->contacts;
    row->nodes = stats->lookups;
    row->points = stats->near;
    row->late_ticks = stats->left_m > DONE_M ? 1u : 0u;
    row->overflow = stats->dropped + stats->refused;
    row->faults = out->faults;
}

void cr_replay_coupled(cr_coupled *coupled, const cr_world *world, const cr_path_row *path, size_t count,
                       double period_first_s, cr_replay_row *rows) {
    cr_couple_output out;
    for (size_t i = 0; i < count; i++) {
        const cr_pose pose = pose_from(path[i].pos_m, path[i].rot);
        const double period_s = i == 0 ? period_first_s : path[i].t_s - path[i - 1].t_s;
        const uint64_t start_ns = now_ns();
        cr_couple_tick(coupled, world, &pose, (float)period_s, &out);
        const uint64_t tick_ns = now_ns() - start_ns;
        store_coupled(&rows[i], &out, coupled);
        rows[i].tick_ns = tick_ns > UINT32_MAX ? UINT32_MAX : (uint32_t)tick_ns;
    }
}
