/* What passes between the parts of a tick of the coupling. Internal: users include couple.h.
 *
 *     held pose -> near samples, each with a plane -> (choose contacts -> try) until no sample passes its plane -> as far as is safe; a few times */
#ifndef CR_COUPLE_FOLLOW_PARTS_H
#define CR_COUPLE_FOLLOW_PARTS_H

#include "contact/stages.h"
#include "couple/couple_parts.h"

/* Where the held tool is looked at, and what was found there. */
typedef struct {
    const cr_field *field;
    xform pose;     /* world_from_tool, of the held tool */
    cr_vec3 middle; /* of the tool, world frame: near samples are told from there */
    float margin_m; /* samples that are so near are taken, and pieces of surface that reach so near */
    float slack_m;  /* against errors of the image, and rounding; set here */
    float free_m;   /* no point of the tool that was not taken is nearer */
    uint32_t every; /* of the near samples that are no corners one in so many is taken */
    uint32_t lookups, dropped, left_out;
    uint32_t count; /* in near[CR_COUPLE_NEAR_MAX] */
    cr_couple_near *near;
} cr_couple_view;

/* Purpose  the samples near the obstacle.   Output  free_m, lookups, dropped, count, near: one sample at most once.
 * Cost     lookups, of 16 points. */
void cr_couple_gather(cr_couple_view *view);

/* Purpose  where the pieces of surface of some samples of a cluster come nearest.
 * Shapes   place: of the samples, world frame; at: what was looked up there; bits of `asked`.   Result  bits of those whose piece was looked at.
 * Output   bits of those that come nearer elsewhere, and their place and normal. */
uint32_t cr_couple_nearest(cr_couple_view *view, const struct cr_img_cluster *c, const cr_lookup *at, uint32_t asked,
                           cr_lanes3 *place, uint32_t *nearer, cr_lanes3 *normal);

/* The walls that a sample must stay before at once: those that meet concavely where it is. */
typedef struct {
    uint32_t count;
    cr_vec3 normal[CR_KIND_FACETS_MAX];
    float gap_m[CR_KIND_FACETS_MAX]; /* the least is the first */
} cr_couple_walls;

/* Purpose  walls of a sample's cell.   Shapes  at: what was looked up at the place of lane i.   Output  none where it sees but one, or where they are not what
 *          was looked up.   Cost  lookups, in cells of many facets. */
void cr_couple_find_walls(cr_couple_view *view, const cr_lookup *at, int i, cr_vec3 place, cr_couple_walls *w);

/* How far a sample's piece of surface reaches along a direction, m: corners and vertices are points. */
static inline float piece_reach(const struct cr_img_cluster *c, int i, cr_vec3 along) {
    return has_lane(c->vertex_mask, i) ? 0.0f : 0.5f * piece_width(c, i, along);
}

#endif
