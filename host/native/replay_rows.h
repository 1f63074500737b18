/* What both replays need: a clock, and poses and vectors of their rows. */
#ifndef CR_REPLAY_ROWS_H
#define CR_REPLAY_ROWS_H

#include "crease.h"

#include <time.h>

static inline uint64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static inline cr_pose pose_from(const double pos_m[3], const double rot[4]) {
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

static inline void store_vec3(float to[3], cr_vec3 from) {
    to[0] = from.x;
    to[1] = from.y;
    to[2] = from.z;
}

#endif
