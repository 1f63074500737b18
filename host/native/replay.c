#include "replay.h"

#include <math.h>
#include <string.h>
#include <time.h>

static uint64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static cr_pose pose_from(const double pos_m[3], const double rot[4]) {
    cr_pose pose;
    pose.pos_m.x = (float)pos_m[0];
    pose.pos_m.y = (float)pos_m[1];
    pose.pos_m.z = (float)pos_m[2];
    pose.rot.w = (float)rot[0];
    pose.rot.x = (float)rot[1];
    pose.rot.y = (float)rot[2];
    pose.rot.z = (float)rot[3];
    return pose;
}

static void store_vec3(float to[3], cr_vec3 from) {
    to[0] = from.x;
    to[1] = from.y;
    to[2] = from.z;
}

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

void cr_replay_each(cr_world *const *worlds, const double *poses, size_t count, float period_s, cr_replay_row *rows) {
    cr_output out;
    memset(&out, 0, sizeof out);
    for (size_t i = 0; i < count; i++) {
        const cr_pose pose = pose_from(&poses[7 * i], &poses[7 * i + 3]);
        tick_into(&rows[i], worlds[i], &pose, period_s, &out);
    }
}
