/* Hits that are passed over, since they are no deeper than what is known, against each lane of each hit measured by itself, where nothing is known yet. */
#ifndef UNIT_SHALLOW_H
#define UNIT_SHALLOW_H

#include "contact/way_out.h"

#include <math.h>
#include <string.h>

/* What detection and the answer need. */
typedef struct {
    const cr_field *field;
    cr_motion *motion;
    cr_contact_set set;
    cr_way_work together, alone;
} shallow;

/* Of some poses: hits, half-spaces deeper than 1 mm, the work that measuring took, all at once and one lane after the other, and how much less deep a
 * half-space came out than its deepest lane, at worst: endless where that is no number. */
typedef struct {
    uint32_t hits, deep;
    double together, alone;
    double short_m;
} shallow_tally;

static inline void shallow_find(shallow *s, const xform *at, const cr_pose *pose) {
    const cr_detect_options options = {.skip = CR_SKIP_ALL, .lookups_max = UINT32_MAX, .slices_max = UINT32_MAX};
    static cr_descent search;
    cr_stats stats;
    memset(&search, 0, sizeof search);
    memset(&stats, 0, sizeof stats);
    cr_motion_advance(s->motion, pose);
    (void)cr_detect(s->field, at, &options, s->motion, &search, &s->set, &stats);
}

/* The depths of all hits, or of one of them. Returns the work, in parts. */
static inline uint32_t shallow_measure(shallow *s, const xform *at, uint32_t only, cr_way_work *work) {
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = s->field, .world_from_tool = at, .set = &s->set, .config = &config};
    cr_way_begin(&in, work);
    for (uint32_t hit = 0; hit < s->set.hit_count && only != CR_HIT_NONE; hit++) {
        work->measured[hit / 32u] |= (uint32_t)(hit != only) << (hit % 32u);
    }
    (void)cr_way_measure(&in, work, UINT32_MAX);
    return work->spent;
}

/* A hit alone. */
static inline void shallow_measure_hit(shallow *s, const xform *at, uint32_t hit, double *deepest_m, shallow_tally *t) {
    t->alone += (double)shallow_measure(s, at, hit, &s->alone);
    for (uint32_t k = 0; k < s->alone.relations.half_count; k++) {
        const double depth_m = (double)s->alone.half[k].depth_m;
        deepest_m[k] = depth_m >= 0.0 ? fmax(deepest_m[k], depth_m) : INFINITY;
    }
}

/* A hit, and then a lane of it after the other: those of a hit march as far as any of them may have to. */
static inline void shallow_measure_lanes(shallow *s, const xform *at, uint32_t hit, double *deepest_m,
                                         shallow_tally *t) {
    cr_hit *h = &s->set.hits[hit];
    const cr_hit kept = *h;
    shallow_measure_hit(s, at, hit, deepest_m, t);
    for (uint32_t left = (uint32_t)(kept.covered | kept.near); left != 0u;) {
        h->covered = (uint16_t)(1u << take_lane(&left));
        h->near = 0u;
        shallow_measure_hit(s, at, hit, deepest_m, t);
    }
    *h = kept;
}

static inline void shallow_compare(shallow *s, const cr_pose *pose, shallow_tally *t) {
    const xform at = cr_xform_from_pose(pose);
    double deepest_m[CR_WAY_ZONES_MAX] = {0.0};
    shallow_find(s, &at, pose);
    if (s->set.hit_count == 0u) {
        return;
    }
    t->together += (double)shallow_measure(s, &at, CR_HIT_NONE, &s->together);
    const uint32_t count = s->together.relations.half_count;
    for (uint32_t hit = 0; hit < s->set.hit_count; hit++) {
        shallow_measure_lanes(s, &at, hit, deepest_m, t);
    }
    for (uint32_t h = 0; h < count; h++) {
        const double short_m = deepest_m[h] - (double)s->together.half[h].depth_m;
        t->deep += deepest_m[h] > 1e-3;
        t->short_m = short_m <= t->short_m ? t->short_m : short_m >= 0.0 ? short_m : INFINITY;
    }
    t->hits += s->set.hit_count;
}

#endif
