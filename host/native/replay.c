#include "replay.h"

#include "replay_rows.h"

#include <string.h>

static uint32_t overflow_of(const cr_stats *s) {
    return s->clusters_dropped + s->touches_dropped + s->areas_merged + s->zones_dropped + s->force_limited;
}

static void store_output(cr_replay_row *row, const cr_output *out) {
    store_vec3(row->force_N, out->force_world_N);
    store_vec3(row->torque_Nm, out->torque_world_Nm);
    row->depth_m = out->depth_m;
    store_vec3(row->normal, out->normal_world);
    store_vec3(row->display_pos_m, out->display_pose.pos_m);
    row->display_rot[0] = out->display_pose.rot.w;
    row->display_rot[1] = out->display_pose.rot.x;
    row->display_rot[2] = out->display_pose.rot.y;
    row->display_rot[3] = out->display_pose.rot.z;
    row->areas = out->area_count;
    row->zones = out->zone_count;
    row->contacts = out->stats.contacts;
    row->nodes = out->stats.nodes;
    row->points = out->stats.points;
    row->clusters = out->stats.clusters;
    row->clusters_inside = out->stats.clusters_inside;
    row->nodes_coherent = out->stats.nodes_coherent;
    row->late_ticks = out->stats.late_ticks;
    row->overflow = overflow_of(&out->stats);
    row->faults = out->faults;
}

/* One tick, timed. */
static void tick_into(cr_replay_row *row, cr_world *world, const cr_pose *pose, float period_s, cr_output *out) {
    const uint64_t start_ns = now_ns();
    cr_tick(world, pose, period_s, out);
    const uint64_t tick_ns = now_ns() - start_ns;
    store_output(row, out);
    row->tick_ns = tick_ns > UINT32_MAX ? UINT32_MAX : (uint32_t)tick_ns;
}

void cr_replay_run(cr_world *world, const cr_path_row *path, size_t count, double period_first_s, cr_replay_row *rows) {
    cr_output out;
    memset(&out, 0, sizeof out);
    for (size_t i = 0; i < count; i++) {
        const cr_pose pose = pose_from(path[i].pos_m, path[i].rot);
        const double period_s = i == 0 ? period_first_s : path[i].t_s - path[i - 1].t_s;
        tick_into(&rows[i], world, &pose, (float)period_s, &out);
    }
}

void cr_replay_each(cr_world *const *worlds, const double *poses, size_t count, float period_s, cr_replay_row *rows) {
    cr_output out;
    memset(&out, 0, sizeof out);
    for (size_t i = 0; i < count; i++) {
        const cr_pose pose = pose_from(&poses[7 * i], &poses[7 * i + 3]);
        tick_into(&rows[i], worlds[i], &pose, period_s, &out);
    }
}
