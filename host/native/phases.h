/* The stages of the tick one after the other, each with a clock round it. The tick itself carries no clock. */
#ifndef CR_PHASES_H
#define CR_PHASES_H

#include "crease.h"
#include "replay.h"

typedef struct {
    uint32_t detect_ns;  /* search, and what each piece of the tool is inside of */
    uint32_t relate_ns;  /* half-spaces and their normals */
    uint32_t depth_ns;   /* of each half-space */
    uint32_t resolve_ns; /* how much each pushes, and the report */
    uint32_t points, nodes, contacts, areas;
} cr_phases_row;

/* Purpose  time the stages along a path, least of `repeat` runs of each pose.
 * Shapes   path[count], rows[count].   Output  rows; counts are those of cr_tick for the same path and config.
 * Errors   cr_err; NULL also when memory ran out.   Cost  repeat times the path, and four clock reads a pose. */
cr_err cr_phases_run(const cr_scene *scene, const cr_config *config, const cr_path_row *path, size_t count,
                     uint32_t repeat, cr_phases_row *rows);

#endif
