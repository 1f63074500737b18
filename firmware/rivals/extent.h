/* The response extent, and what its parts share: zones.c, extent.c, split.c, top.c, lowest.c, published.c. EXTENT.md. */
#ifndef CR_EXTENT_H
#define CR_EXTENT_H

#include "contact/stages.h"

static inline float dot_zone(const cr_area_work *a, uint32_t i, cr_vec3 v) {
    return v3_dot(a->zones[i].normal_world, v);
}

/* The part of an area that answers with one plane. */
typedef struct {
    float share[CR_ZONES_MAX]; /* of each zone, 0..1 */
    uint32_t own;              /* zones with a share */
    uint32_t behind; /* zones behind whose plane a point has to lie to be its own: those at a concave crease */
} cr_group;

/* Purpose  groups of zones: joined by convex creases, parted by concave ones; in a mixed corner some zones are shared.
 * Shapes   alpha[area->zone_count], m^2; groups[CR_ZONES_MAX].   Output  number of groups, at least 1 for an area with zones. */
uint32_t cr_split(const cr_scene *scene, const cr_area_work *area, const float *alpha, cr_group *groups);

/* Purpose  lowest n . p, m, of the tool surface that is inside and belongs to the group; plane_m when there is none lower.
 * Shapes   n: unit, world frame; plane_m: n . p on the contact plane.   Cost  O(hits of the area), a few lookups a hit. */
float cr_lowest(const cr_respond_input *in, uint32_t index, const cr_area_work *area, const cr_group *part, cr_vec3 n,
                float plane_m);

/* n . x = offset; in front of it is outside. */
typedef struct {
    cr_vec3 normal;
    float offset_m;
} cr_plane;

/* Purpose  highest n . x, m, of the points behind all planes, or best where that is lower or no such height is bounded.
 * Shapes   unit normals; offsets from a point near the contact, so that small weights of far planes do not matter.
 * Cost     count choose 3 solutions of 3 equations: 56 for CR_ZONES_MAX. */
float cr_top_behind(const cr_plane *planes, uint32_t count, cr_vec3 n, float best);

/* Purpose  an area by the method as published, s the reversed tool sum in the world frame.   Output  areas written, 0 or 1. */
uint32_t cr_answer_as_published(const cr_respond_input *in, uint32_t index, const cr_area_work *area, cr_vec3 s,
                                cr_area *out);

/* Purpose  zones, weights and size of an answer. */
void cr_report_area(const cr_area_work *area, const float *alpha, const float *share, cr_area *out);

/* Purpose  group the hits into contact areas (connected pieces of tool surface) and the touches of each area into contact
 *          zones (one per smooth static patch).
 * Shapes   hit_of_cluster[scene->cluster_count], all CR_HIT_NONE before and after.
 * Output   set->hits[].area, *areas.   Source  EXTENT.md "Zones and area normal" [1]. */
void cr_zones(const cr_scene *scene, uint16_t *hit_of_cluster, cr_contact_set *set, cr_area_set *areas,
              cr_stats *stats);

/* Purpose  areas with normal, contact plane, depth and acting point: responses extent and fixed45. Concave creases split areas here.
 * Output   out[0..return), no force yet; every number finite.   Cost  O(hits of the areas).
 * Source   EXTENT.md "Zones and area normal", "Concave creases" [1]. */
uint32_t cr_respond(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t out_max,
                    cr_stats *stats);

#endif
