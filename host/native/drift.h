/* A tool that turns in place for very many ticks, its attitude integrated in float32 as a controller does it. */
#ifndef CR_DRIFT_H
#define CR_DRIFT_H

#include "crease.h"

/* What every n-th tick saw. */
typedef struct {
    float rot[4]; /* w x y z, as handed to the tick */
    float force_N[3];
    float torque_Nm[3];
    float depth_m;
    uint32_t faults;
} cr_drift_row;

/* Purpose  tick `every` times for each row: rot = step * rot in float32, made a unit again when `unit` is set.
 * Shapes   rows[count].   Output  *pose is the last one; rows hold the tick after every `every`-th step.   Cost  one cr_tick a step. */
void cr_drift_run(cr_world *world, cr_pose *pose, cr_quat step, int unit, size_t every, size_t count,
                  cr_drift_row *rows);

#endif
