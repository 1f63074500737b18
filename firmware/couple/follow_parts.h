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
    cr_couple_found *found;
    xform pose;     /* world_from_tool, of the held tool */
    cr_vec3 middle; /* of the tool, world frame: near samples are told from there */
    float margin_m; /* samples that are so near are taken, and pieces of surface that reach so near */
    float trust_m;  /* a plane is taken for the surface for so long a way */
    float slack_m,
        slack_far_m; /* against errors of the image near the surface, and anywhere, and against rounding; set here */
    uint32_t every;  /* of the near samples that are no corners one in so many is taken */
    uint32_t lookups;
} cr_couple_view;

/* Purpose  the samples near the obstacle, of spheres that may have come near since they were looked at.
 * Output   view->found: free_m, dropped, near_count, near: one sample at most once, keys rise.   Cost  lookups, of 16 points. */
void cr_couple_gather(cr_couple_view *view, const cr_pose *tool);

/* Purpose  samples of round creases, which lie on chords, are raised to the crease.   Output  bend of view->found->lines; place: raised. */
void cr_couple_raise(const cr_couple_view *view, const struct cr_img_cluster *c, cr_lanes3 *place);

/* Purpose  lines of a cluster's pieces, view->found->lines.   Shapes  at: what was looked up at its samples.
 * Output   their ways, and how far each reaches down from its middle: where a sample is far off, its ramp.
 *          Result  no piece is anywhere nearer, m, slack taken off. */
float cr_couple_find_lines(const cr_couple_view *view, const struct cr_img_cluster *c, const cr_lookup *at);

/* Purpose  where the pieces of surface of some samples of a cluster come nearest, along their lines.
 * Shapes   place: of the samples, world frame; at: what was looked up there.   Result  bits of those whose piece was looked at.
 * Output   bits of those that come nearer elsewhere, and their place, what was looked up there, and normal. */
uint32_t cr_couple_nearest(cr_couple_view *view, const struct cr_img_cluster *c, cr_lookup *at, cr_lanes3 *place,
                           uint32_t *nearer, cr_lanes3 *normal);

/* Purpose  how far a corner of the tool gives way before a plane, m: where a crease leads down from it, that is what touches; and where it goes over an edge there,
 *          the face that the corner leaves must not hold it.   Shapes  normal: tool frame.   Result  0 where no crease leads down. */
float cr_couple_yield(const cr_scene *scene, const struct cr_img_cluster *c, int i, cr_vec3 normal);

/* The walls that a sample must stay before at once: those that meet concavely where it is. */
typedef struct {
    uint32_t count;
    cr_vec3 normal[CR_KIND_FACETS_MAX];
    float gap_m[CR_KIND_FACETS_MAX]; /* the least is the first */
} cr_couple_walls;

/* Purpose  walls of a sample's cell.   Shapes  at: what was looked up at the place of lane i.   Output  none where it sees but one, or where they are not what
 *          was looked up.   Cost  lookups, in cells of many facets. */
void cr_couple_find_walls(cr_couple_view *view, const cr_lookup *at, int i, cr_vec3 place, cr_couple_walls *w);

#endif
