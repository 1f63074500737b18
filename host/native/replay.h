/* A recorded path through the firmware's tick, with the cost of each tick. */
#ifndef CR_REPLAY_H
#define CR_REPLAY_H

#include "couple.h"
#include "crease.h"

/* One pose of a path: time, then world_from_tool (unit quaternion, scalar first). */
typedef struct {
    double t_s;
    double pos_m[3];
    double rot[4];
} cr_path_row;

/* What one tick answered. Same units as cr_output. */
typedef struct {
    float force_N[3];
    float torque_Nm[3];
    float depth_m;
    float normal[3];
    float display_pos_m[3];
    float display_rot[4]; /* w x y z */
    uint32_t areas, zones, contacts, nodes, points;
    uint32_t clusters, clusters_inside, nodes_coherent;
    uint32_t late_ticks; /* age of the pose whose contact is answered */
    uint32_t overflow;   /* all drops and limits of the tick, summed: 0 when nothing was left out */
    uint32_t faults;
    uint32_t tick_ns; /* wall time of cr_tick, with the cost of reading the clock once */
} cr_replay_row;

/* Purpose  tick the world once for each row of a path.
 * Shapes   path[count], rows[count].   Units  period_first_s: period of the first tick; the others from t_s.
 * Output   rows.   Errors  none: trouble of a tick is in rows[].faults and overflow.   Cost  two clock reads a tick. */
void cr_replay_run(cr_world *world, const cr_path_row *path, size_t count, double period_first_s, cr_replay_row *rows);

/* Purpose  the same with a held tool: cr_couple_tick once for each row.
 * Output   rows: depth_m is how far the springs are drawn along, at their centre, 0 where nothing presses; normal, the direction of the force; display, the held tool;
 *          areas and contacts, points that press; zones, contacts that were asked; nodes, lookups; points, near samples; late_ticks 1 where the held tool
 *          was not done; overflow, what was left out.   Errors, cost  as cr_replay_run. */
void cr_replay_coupled(cr_coupled *coupled, const cr_world *world, const cr_path_row *path, size_t count,
                       double period_first_s, cr_replay_row *rows);

/* Purpose  one tick of each of many worlds, each at its own pose.
 * Shapes   worlds[count], rows[count]; poses[count][7]: m, and a unit quaternion, scalar first.   Units  period_s as of cr_tick.
 * Output   rows.   Errors  none: as cr_replay_run.   Threads  calls over other worlds may run beside this one. */
void cr_replay_each(cr_world *const *worlds, const double *poses, size_t count, float period_s, cr_replay_row *rows);

#endif
