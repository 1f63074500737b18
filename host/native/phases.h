/* The stages of the tick one after the other, each with a clock round it. The tick itself carries no clock. */
#ifndef CR_PHASES_H
#define CR_PHASES_H

#include "crease.h"
#include "replay.h"

typedef struct {
    uint32_t detect_ns, zones_ns;
    uint32_t normal_ns;      /* weights, area normal, contact plane: the response with no samples to measure depth */
    uint32_t penetration_ns; /* the whole response less that */
    uint32_t points, nodes, contacts, areas;
} cr_phases_row;

/* Purpose  time the stages along a path, least of `repeat` runs of each pose.
 * Shapes   path[count], rows[count].   Output  rows; counts are those of cr_tick for the same path and config.
 * Errors   cr_err; NULL also when memory ran out.   Cost  repeat times the path, and five clock reads a pose. */
cr_err cr_phases_run(const cr_scene *scene, const cr_config *config, const cr_path_row *path, size_t count,
                     uint32_t repeat, cr_phases_row *rows);

#endif
