/* What the samples of the tool touch along a path, as changes from tick to tick, and what holds a held tool: for pictures. */
#ifndef CREASE_CONTACTS_H
#define CREASE_CONTACTS_H

#include "replay.h"

/* A sample of the tool touches something else than in the tick before. */
typedef struct {
    uint32_t sample; /* cluster * CR_LANES + lane */
    uint32_t area;   /* 0: in no contact; else 1 + label of its contact area. An area keeps its label while it lasts */
    uint32_t patch;  /* static patch that the sample is nearest to; CRV_PATCH_NONE deep inside or in no contact */
} crv_change;
#define CRV_PATCH_NONE 0xffffffffu

/* A zone of a tick, as the tick reported it. */
typedef struct {
    uint32_t patch;
    uint32_t area; /* index of its area in this tick */
    float centre_m[3], normal[3];
    float area_m2;
    float share; /* of the weights of its area's zones, 0..1 */
} crv_zone;

/* What a tick reported as a whole. */
typedef struct {
    uint32_t changes, zones_stored;  /* entries of this tick */
    uint32_t areas, zones, contacts; /* as in cr_replay_row */
    float point_m[3];                /* where the force acts: points of the areas weighted by depth */
} crv_tick;

/* A contact area of a tick. */
typedef struct {
    float point_m[3]; /* where its force acts, world frame */
    float force_N[3];
    float normal[3];
    float depth_m;
} crv_area;

typedef struct crv_watch crv_watch;

/* Purpose  a watch over a world that has not ticked yet.   Output  to be freed with crv_watch_free; null: out of memory. */
crv_watch *crv_watch_new(cr_world *world, const cr_scene *scene);
void crv_watch_free(crv_watch *watch);

/* Purpose  tick the world along a path and tell what changes.
 * Shapes   path[count], ticks[count]; changes[changes_room], zones[zones_room] filled one tick after the other. Rooms of at
 *          least 2 CR_LANES clusters of the tool and CR_AREAS_MAX CR_ZONES_MAX zones let every call do one tick.
 * Units    period_first_s as of cr_replay_run.   Output  ticks done: fewer than count when a room is full.
 * Cost     the tick's, and one lookup for each cluster that touches several patches. */
size_t crv_watch_run(crv_watch *watch, const cr_path_row *path, size_t count, double period_first_s, crv_tick *ticks,
                     crv_change *changes, size_t changes_room, crv_zone *zones, size_t zones_room);

/* Purpose  tick a world along a path and tell its contact areas.
 * Shapes   path[count], counts[count]: areas of each tick; areas[room], one tick after the other. A room of at least
 *          CR_AREAS_MAX lets every call do one tick.
 * Units    period_first_s as of cr_replay_run.   Output  ticks done: fewer than count when the room is full.
 * Cost     the tick's. */
size_t crv_areas_run(cr_world *world, const cr_path_row *path, size_t count, double period_first_s, uint32_t *counts,
                     crv_area *areas, size_t room);

/* Points that may press a held tool at one time. */
#define CRV_HELD_MAX 96u

/* Purpose  tick a coupling along a path and tell the points that press, each as an area: depth_m is how far it is behind its plane, force_N what it holds the tool
 *          with, friction included.
 * Shapes   path[count], ticks[count], counts[count]: points of each tick; areas[room], one tick after the other. A room of at least CRV_HELD_MAX lets every
 *          call do one tick.   Units  period_first_s as of cr_replay_run.
 * Output   ticks done: fewer than count when the room is full; ticks: areas, contacts, zones as cr_replay_coupled has them, point_m; no changes.
 * Cost     the tick's. */
size_t crv_held_run(cr_coupled *coupled, const cr_world *world, const cr_path_row *path, size_t count,
                    double period_first_s, crv_tick *ticks, uint32_t *counts, crv_area *areas, size_t room);

#endif
