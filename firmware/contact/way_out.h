/* The way out: a contact pushes with the shortest translation that leads out of the obstacle. WAY_OUT.md has the idea, what holds and what
 * does not yet.
 *
 *     detect, gather -> zones -> relate -> half-spaces -> measure, depth_along -> resolve -> contacts
 *             facets, layers                                  rows, exits
 *
 * Everything between gather and resolve is in the tool frame. Units m; a force divided by the stiffness is a length. */
#ifndef CR_WAY_OUT_H
#define CR_WAY_OUT_H

#include "contact/stages.h"

/* A piece of face is taken to reach at most this many half-widths from its middle. */
#define CR_WAY_REACH 1.82f

/* Bent pieces, and those amid a flat face, meet in corners so many half-widths from their middles; how one at the border of a flat face is cut is not known: from its
 * own border on it fades. */
#define CR_WAY_END 1.42f
#define CR_WAY_FLAT_END 1.05f

/* Purpose  whether a piece is looked at to its corners (CR_WAY_END), or to its border; creases to their ends. */
static inline int cr_way_is_wide(const struct cr_img_cluster *c, int i) {
    return (c->bow[i] > 0.0f) | has_lane(c->inner_mask, i);
}

/* Purpose  how much deeper below a plane than its middle a piece may be anywhere that it is looked at, m. */
static inline float cr_way_rise(const struct cr_img_cluster *c, int i, float width_m) {
    return 0.5f * width_m * (cr_way_is_wide(c, i) ? CR_WAY_END : CR_WAY_FLAT_END);
}

/* A spread of normals of which nothing follows. */
#define CR_WAY_NO_SPREAD 3.0f

/* Purpose  what a facet is felt as: itself, or where it is a plane of a round surface, sides of that as CR_WAY_CURVED with the patch. */
static inline uint32_t cr_way_felt(const cr_scene *scene, uint32_t surface) {
    const struct cr_img_facet *f = surface < CR_WAY_CURVED ? &scene->facets[surface] : NULL;
    return f != NULL && f->curved == CR_FACET_OF_CURVED ? CR_WAY_CURVED | f->patch : surface;
}

/* Purpose  zone of a key, or CR_WAY_NONE. */
uint32_t cr_way_find(const cr_way_zones *zones, cr_way_key key);

/* Facets that a looked-up sample is inside of, and how much it counts for each. */
typedef struct {
    uint32_t count;
    uint32_t facet[CR_KIND_FACETS_MAX];
    float share[CR_KIND_FACETS_MAX];
    cr_vec3 normal[CR_KIND_FACETS_MAX]; /* world frame, unit: the facet's, or the gradient, which knows how it bends */
} cr_way_facets;

/* Purpose  how far the foot of a point of the world on the plane of a facet lies beside the rectangle that the facet is in, m. */
float cr_way_beside(const struct cr_img_facet *facet, cr_vec3 point_world);

/* Purpose  how far the foot of a point of the world on the plane of a facet is from the nearest end of it, m: below zero beyond; a lot where none of its sides is one. */
float cr_way_margin(const struct cr_img_facet *facet, cr_vec3 point_world);

void cr_way_facets_of(const cr_field *field, const cr_lookup *at, int lane, cr_vec3 p_world, cr_way_facets *out);

/* Purpose  share of a direction along a side of a curved surface: the shares of one direction add up to 1. */
float cr_way_share(cr_vec3 direction, uint32_t side);

/* Purpose  layers of the samples of a cluster whose heights above the planes of the static object are known.   Shapes  coverage[CR_LANES]. */
void cr_way_over_planes(const cr_scene *scene, const struct cr_img_cluster *cluster, uint32_t lanes,
                        const float *coverage, const cr_planes *planes, const cr_heights *heights, cr_way_layers *out);

/* Purpose  layers of samples that were looked up, a step of it.   Output  out->step: CR_WAY_FADE when all are known. */
void cr_way_over_lookup(const cr_field *field, const xform *world_from_tool, const cr_looked *looked,
                        cr_way_layers *out);

/* Purpose  lanes as deep as the image has no samples pass to no surface, continuously.   Returns  0: none was looked at, as none is so deep. */
int cr_way_fade(const cr_scene *scene, uint32_t lanes, cr_way_layers *layers);

/* Purpose  the surface that all lanes are over, where it is one and not at a crease: a facet that is not curved, or CR_WAY_CURVED with the patch.
 * Output   CR_WAY_NONE where there is no such. */
uint32_t cr_way_common(const cr_field *field, const cr_lookup *at, uint32_t lanes);

/* Purpose  of some lanes, those in cells of the same kind as the first. */
uint32_t cr_way_same_cell(const cr_lookup *at, uint32_t lanes);

/* Purpose  plane of a facet that is not curved, tool frame: height = normal . p + the result, m. */
float cr_way_plane(const cr_scene *scene, const xform *world_from_tool, uint32_t facet, cr_vec3 *normal);

/* Purpose  heights of a cluster's samples above it, m.   Shapes  height_m[CR_LANES].   Output  the normal. */
cr_vec3 cr_way_heights(const cr_scene *scene, const xform *world_from_tool, const struct cr_img_cluster *cluster,
                       uint32_t facet, float *height_m);

/* Purpose  directions x, y, z of the world as unit vectors in the tool frame, zero where there is none.   Shapes  x, y, z: [CR_LANES].
 * Output   of these lanes; the others hold anything. */
void cr_way_normals(const xform *world_from_tool, const float *x, const float *y, const float *z, uint32_t lanes,
                    cr_lanes3 *out);

/* Purpose  the one of some planes that matters for a cluster, or all of them. */
const cr_planes *cr_way_alone(const cr_scene *scene, const struct cr_img_cluster *cluster, const cr_planes *planes,
                              cr_planes *one);

/* A static plane that bounds what a half-space leads out of: height = normal . p + offset. */
typedef struct {
    uint32_t facet;
    cr_vec3 normal;
    float offset_m;
    float part; /* 0..1: how far it belongs there */
    uint32_t
        sure; /* 1: by the label of a crease: what lies above is not of the convex piece that the half-space leads out of */
    float weight_m3; /* of its zone, as far as it belongs there, beyond the heaviest that there was no room for */
} cr_way_bound;
#define CR_WAY_BOUNDS_MAX 6u

/* Zones that answer as one: the tool is out of their obstacle once it has moved by depth along normal. */
typedef struct {
    uint32_t zones; /* bits */
    cr_vec3 normal; /* unit, or zero */
    float weight_m3, depth_m;
    float joined_m3; /* weight of the zones that have joined it: each has joined one */
    float led_m3;    /* the largest weight of a zone that leads it */
    float curved_m3; /* of the weight, that of curved zones */
    float deep_m;    /* of the deepest sample in its zones */
    float open;      /* 0..1: how far the zones have a direction */
    cr_vec3 own_m;   /* torque about the tool origin of a unit force along normal, of its zones */
    cr_vec3 arm_m;   /* and of all half-spaces of this direction */
    uint32_t bound_count;
    cr_way_bound bounds[CR_WAY_BOUNDS_MAX];
} cr_way_half;

/* How zones belong together. */
typedef struct {
    cr_vec3 normal[CR_WAY_ZONES_MAX]; /* mean of the static surface's: the shorter the more it is spread */
    cr_vec3 unit[CR_WAY_ZONES_MAX], touched[CR_WAY_ZONES_MAX]; /* the same of length 1, and a point of the surface */
    /* 1: one way out, 0: two; once all have agreed, how far samples of a zone count for the half-space of another */
    float part[CR_WAY_ZONES_MAX][CR_WAY_ZONES_MAX];
    float lead[CR_WAY_ZONES_MAX];    /* 0..1: how far those that a zone is related to are related to each other */
    uint8_t order[CR_WAY_ZONES_MAX]; /* zones by their keys */
    uint32_t half_of[CR_WAY_ZONES_MAX];
    uint32_t half_count;
    union {
        uint32_t first[CR_WAY_ZONES_MAX]; /* of each half-space the zone that it was made for, until all have agreed; */
        uint32_t counts_for
            [CR_WAY_ZONES_MAX]; /* then of each zone, as bits: zones for whose half-spaces its samples count */
    };
    float all_m3; /* weight of all zones */
    float beside_m3
        [CR_WAY_ZONES_MAX]; /* weight of what is beside a zone, whatever piece it is of, as far as it is not related to it */
} cr_way_relations;

/* Zones become half-spaces in passes, each over all zones or half-spaces, one after the other. */

/* Purpose  whether a zone and each of those before it have one way out.   Output  normal, unit, touched, part, beside_m3; all_m3 is added to.   Returns  pairs whose ends were asked for. */
uint32_t cr_way_relate(const cr_scene *scene, const xform *world_from_tool, const cr_way_zones *zones, uint32_t zone,
                       cr_way_relations *relations);

/* Purpose  how far a zone leads, once all are related.   Output  lead.   Returns  zones that it is related to. */
uint32_t cr_way_lead(const cr_way_zones *zones, uint32_t zone, cr_way_relations *relations);

/* A half-space that is made: its sum on the way into the cone of the normals of its zones. */
typedef struct {
    uint32_t zones, count;           /* bits, and how many they are */
    uint8_t order[CR_WAY_ZONES_MAX]; /* by their keys */
    uint32_t projected, sweeps;      /* projections that are done, sweeps of the one in hand */
    float per_weight, trusted, seen, bent, known, limit;
    cr_vec3 sum, left; /* what is still outside */
    float alpha[CR_WAY_ZONES_MAX], held[CR_WAY_ZONES_MAX], most[CR_WAY_ZONES_MAX];
} cr_way_cone;

/* Purpose  the half-space of a zone, begun when none of those before has the same relations: own zones, bounds; no depth yet.
 * Shapes   halves[CR_WAY_ZONES_MAX].   Returns  0: it was there; else the zones that it is made of, as bits: call cr_way_turn until that is 1. */
uint32_t cr_way_join(const cr_scene *scene, const cr_way_zones *zones, uint32_t zone, cr_way_relations *relations,
                     cr_way_half *halves, cr_way_cone *cone);

/* Purpose  normal and own arm of the half-space that a zone has begun: a sweep of the projection, or the end.   Returns  1: they are known; 0: call again. */
int cr_way_turn(const cr_way_zones *zones, uint32_t zone, const cr_way_relations *relations, cr_way_half *halves,
                cr_way_cone *cone);

/* Purpose  how far a half-space is open, once all zones have joined.   Returns  zones whose relations were compared with its own. */
uint32_t cr_way_agree(const cr_way_zones *zones, const cr_way_relations *relations, uint32_t index,
                      cr_way_half *halves);

/* Purpose  how far samples of a zone count for which half-spaces, once all have agreed: for their own in full from OWN_FULL of a lead on or where none leads
 *          that it is related to; for those, as it does not lead and they do.   Output  its part and counts_for.   Returns  zones that it was compared with. */
uint32_t cr_way_tell_counts(uint32_t count, uint32_t zone, cr_way_relations *relations);

/* Purpose  the moment that a half-space shares, once it is known how far all are open.   Output  arm_m. */
void cr_way_share_arm(uint32_t count, uint32_t index, cr_way_half *halves);

#define CR_WAY_EXITS_MAX (CR_KIND_FACETS_MAX + CR_WAY_BOUNDS_MAX)

/* Planes that a sample is below, and how steeply the way leaves through each: exit = -height / leaves. */
typedef struct {
    uint32_t count;
    cr_vec3 normal[CR_WAY_EXITS_MAX]; /* outward */
    float height_m[CR_WAY_EXITS_MAX];
    float leaves[CR_WAY_EXITS_MAX]; /* normal . way */
} cr_way_exits;

/* A plane that the way leaves less steeply than this is not left through. */
#define CR_WAY_LEAVES_MIN 1e-3f

/* Purpose  longest way to the first exit from anywhere on a sample's piece of surface, m; 0 where it is surely not longer than what is known.
 * Output   places: on the piece, that were looked at. */
float cr_way_longest(const struct cr_img_cluster *cluster, int lane, const cr_way_exits *exits, float known_m,
                     uint32_t *places);

/* Those half-spaces that have a depth, and how far each leads along the normal of each: 0 where it leads away. */
typedef struct {
    uint32_t count, felt[CR_WAY_ZONES_MAX];
    uint32_t sweeps; /* made */
    float deepest_m;
    float push_m[2][CR_WAY_ZONES_MAX]; /* before a sweep and after it, by turns */
    float part[CR_WAY_ZONES_MAX][CR_WAY_ZONES_MAX];
} cr_way_along;

/* Purpose  how much each half-space pushes: the sum of lambda normal is the shortest translation out of all; those that oppose each other do not see each other.
 * Shapes   normal unit, depth_m, out lambda_m: [count].   Output  lambda_m: 0, none pushes yet.   Source  resolve.c. */
void cr_way_resolve_begin(const cr_vec3 *normal, const float *depth_m, uint32_t count, cr_way_along *along,
                          float *lambda_m);

/* Purpose  one sweep over them.   Output  1: it was the last, and lambda_m, m, is known; 0: sweep again.   Cost  pairs of those with a depth. */
int cr_way_resolve_sweep(const float *depth_m, cr_way_along *along, float *lambda_m);

/* Less than any cosine: no plane of this lane. */
#define CR_WAY_NO_PLANE (-2.0f)

/* What bounds the way along a half-space's normal at the lanes: rows of planes, those that are known and those of the half-space. */
typedef struct {
    uint32_t count;
    cr_vec3 normal[CR_WAY_EXITS_MAX];
    int curved[CR_WAY_EXITS_MAX];
    uint32_t own;                     /* of these, first, those that are known at the lanes; the others bound them */
    uint32_t facet[CR_WAY_EXITS_MAX]; /* of a row that bounds them, */
    float seen
        [CR_WAY_EXITS_MAX]; /* and 0..1: how far it is known well enough to be left through without a march, where it is */
    float height_m[CR_WAY_EXITS_MAX][CR_LANES];
    float leaves[CR_WAY_EXITS_MAX][CR_LANES];
} cr_way_rows;

/* Surfaces that lanes in cells of several facets, or of none, are over, and how far each counts for each. */
typedef struct {
    uint32_t common; /* the one that all lanes are over, or CR_WAY_NONE: then the others */
    uint32_t far;    /* lanes where no surface is near */
    uint32_t left;   /* lanes that are not told yet */
    uint32_t count;
    uint32_t surface[CR_WAY_LAYERS_MAX], lanes[CR_WAY_LAYERS_MAX];
    float share[CR_WAY_LAYERS_MAX][CR_LANES];
    cr_lanes3 normal[CR_WAY_LAYERS_MAX]; /* share times normal at each lane, world frame */
} cr_way_shares;

/* Of each lane, by the rows that were gone through: the way to the first exit from its middle, the most it may be from anywhere on its piece, how steep the
 * steepest exit that is trusted is, and the two least that exits may be anywhere on the piece. */
typedef struct {
    float middle_m[CR_LANES], most_m[CR_LANES], steep[CR_LANES];
    float first_m[CR_LANES], second_m[CR_LANES];
    uint32_t row;    /* the next one */
    uint32_t asking; /* lanes that ask how far the rows that bound them are trusted, once all are gone through */
    uint32_t asked;  /* the next of these */
    uint32_t parts;  /* of work, of each */
} cr_way_ways;

/* How lanes that wait are looked at: all of them by a row of planes at a time, or each by all of its exits. */
enum { CR_WAY_ROW_BY_ROW, CR_WAY_LANE_BY_LANE };

/* Lanes that wait for all of their exits, one after the other: of which cluster, by what part, for which half-space; those of them that march, and how far they
 * have come, in so many steps. */
typedef struct {
    const struct cr_img_cluster *c;
    cr_way_half *half;
    const cr_lanes3 *normal; /* of the lanes, where a plane is curved */
    float part[CR_LANES], gone_m[CR_LANES];
    uint32_t looks; /* CR_WAY_ROW_BY_ROW or CR_WAY_LANE_BY_LANE */
    uint32_t marching, steps;
    float most_m;
    cr_way_exits exits; /* of all lanes, where planes alone are: but for their heights above these; none: by the rows */
    const float *height_m[CR_KIND_FACETS_MAX]; /* [CR_LANES] */
} cr_way_rest;

/* What is measured of the cluster in hand: in the world's memory, so that the stack stays small. */
typedef struct {
    cr_lanes3 world, beside, march_from, march_world; /* beside: static normals, of the curved surface in hand */
    cr_lookup look, march;
    cr_planes alone;
    cr_heights heights;
    cr_way_rows rows;
    cr_way_ways ways;
    cr_way_rest rest;
    cr_way_shares shares;
} cr_way_scratch;

/* What is known of the hit in hand: nothing, half-spaces that it may be deeper in, that it is in one, what was looked up, and what it is over. */
enum { CR_WAY_UNKNOWN, CR_WAY_BOUNDED, CR_WAY_ASKED, CR_WAY_LOOKED_UP, CR_WAY_TOLD };

#define CR_WAY_MEASURED ((CR_CLUSTERS_MAX + 31u) / 32u)

/* What passes between the stages of an answer, and from tick to tick while it is not whole. */
typedef struct {
    uint32_t next;  /* the step that comes next: passes over zones, then hits are measured */
    uint32_t spent; /* work of this tick, in parts */
    uint32_t
        left; /* zones that a half-space is made of, while it is; then lanes that wait for all of their exits, for the half-space in hand: scratch.rest */
    uint32_t known;         /* of the hit in hand: CR_WAY_UNKNOWN and so on; */
    uint32_t asks, shallow; /* half-spaces, as bits: where it is asked whether it is deeper, and where it is not; */
    uint32_t deeper;        /* 1: it is, in another; */
    uint32_t surfaces, surfaces_done;   /* that it is over: met in this tick, and done; */
    uint32_t seen, done;                /* half-spaces that the one in hand counts for, in the same way */
    uint32_t moved;                     /* 1: something of the hit was done in this tick */
    uint32_t measured[CR_WAY_MEASURED]; /* bits: hits that are done */
    uint32_t resolving;                 /* all are, and so far: answer.c */
    cr_way_relations relations;
    cr_way_half half[CR_WAY_ZONES_MAX];
    cr_vec3 normal[CR_WAY_ZONES_MAX]; /* of the half-spaces, */
    float depth_m[CR_WAY_ZONES_MAX], push_m[CR_WAY_ZONES_MAX];
    uint32_t area[CR_WAY_ZONES_MAX]; /* and their contacts, or CR_HIT_NONE */
    union {
        cr_way_cone cone;            /* while zones join, */
        cr_way_scratch scratch;      /* while it is measured, */
        cr_way_along along;          /* and after; */
        cr_area areas[CR_AREAS_MAX]; /* what is answered, where nobody asks for more than the pushes */
    };
} cr_way_work;

/* Cosine of normal and plane up to which the exit through the plane is not trusted at all: it is looked for along the normal. */
#define CR_WAY_STEEP_MIN 0.3f
/* A way that is longer than another by less than this is as long, m: on a face that lies flat no sample is looked at twice. */
#define CR_WAY_SLACK_M 1e-7f

/* What is measured, and where to. */
typedef struct {
    const cr_respond_input *in;
    const cr_way_zones *zones;
    const cr_way_relations *relations;
    cr_way_half *half;
    cr_way_scratch *scratch;
    cr_way_work *work;
    uint32_t lookups_max;
} cr_way_survey;

/* Planes that are known at the lanes of a cluster. */
typedef struct {
    uint32_t facet;
    int curved;            /* 1: the normal is each lane's own */
    cr_vec3 normal;        /* tool frame */
    const float *height_m; /* [CR_LANES] */
} cr_way_known;

/* Lanes of a cluster and the planes there: the first is the one they are inside of. Far from any surface none is known; the first has the distance
 * then, and no normal. */
typedef struct {
    const struct cr_img_cluster *c;
    uint32_t lanes;
    uint32_t count;
    cr_way_known planes[CR_KIND_FACETS_MAX];
    const cr_lanes3 *normal; /* of the lanes, where a plane is curved */
    float deep_m[CR_LANES];  /* how deep each piece reaches below the first at most; endless where none is known */
} cr_way_spots;

/* Purpose  the way of a lane in full: anywhere on its piece, and by what a march found as far as no exit is trusted; m, most_m at most. 0 where it is surely
 *          not longer than what is known.   Output  places that were looked at. */
float cr_way_of_lane(const cr_way_scratch *scratch, int lane, float most_m, float known_m, uint32_t *places);

/* Purpose  exits of lanes, but for their heights, where some flat planes and no other bound what they leave, and one of them steeply enough.   Output  height_m and
 *          exits, none where it is not so.   Returns  whether it is. */
int cr_way_find_exits(const cr_way_half *half, const cr_way_spots *at, cr_way_rest *rest);

/* Purpose  the rows of planes that bound lanes: those that are known at them, and those of the half-space, but for the known ones. One that a lane is above does not
 *          bound it, unless the static object surely ends there.   Output  but for lanes that are not asked for. */
void cr_way_find_rows(const cr_way_half *half, const cr_way_spots *at, uint32_t lanes, cr_way_rows *rows);

/* Purpose  cosine of a half-space's normal and a plane that bounds it, as far as it is left through: less where it belongs there in part, or hardly anything touches it. */
float cr_way_leaves(const cr_way_half *half, const cr_way_bound *bound);

/* Purpose  lower the lanes that are above a row's plane, where the static object surely ends, by how far they are beside the facet's rectangle, their pieces'
 *          reach apart: it ends within 45 degrees of that. Returns how many are above.
 * Source   WAY_OUT.md "Depth" */
uint32_t cr_way_find_ends(const cr_respond_input *in, uint32_t lanes, uint32_t row, cr_way_scratch *scratch);

/* Purpose  how far some lanes trust a row of planes that bounds them, once all rows are gone through: where the plane goes on and its facet does not, a march
 *          tells whether the way ends before.   Output  scratch->ways.steep. */
void cr_way_trust(const cr_respond_input *in, uint32_t lanes, uint32_t row, cr_way_scratch *scratch);

/* Purpose  0..1: how far the exit through planes is trusted, the steepest of them so steep; and from which on in full. */
float cr_way_sure(const cr_way_half *half, float steep);
float cr_way_trusted(const cr_way_half *half);

/* When the work of a tick is done the rest of a hit waits, but something of it is done in each. */
static inline int cr_way_waits(const cr_way_survey *s) {
    return s->work->spent / CR_WORK_PARTS >= s->lookups_max && s->work->moved != 0u;
}

/* Purpose  lanes over a surface, or a side of it, count for the half-spaces of their zones, each by its part.
 * Shapes   part[CR_LANES].   Output  depth_m of the half-spaces; at->deep_m; what it costs in work->spent. */
void cr_way_count(const cr_way_survey *s, cr_way_spots *at, uint32_t surface, uint32_t side, const float *part);

/* Purpose  lanes that wait: by rows of planes, by steps of their march, and then each by all of its exits.
 * Output  depth_m of the half-space; work->left: those that wait still.   Cost  as cr_way_measure; ends with a row, a lane that is asked how far it trusts one,
 *          a step of a march, or a lane. */
void cr_way_go_on(const cr_way_survey *s);

/* Purpose  begin an answer. */
void cr_way_begin(const cr_respond_input *in, cr_way_work *work);

/* Purpose  half-spaces, which zones have one way out, and the depth of each: how far the deepest point of its tool surface has to go along the normal to the first exit.
 * Output   1 when all is measured; with 0 call again.   Cost  work->spent is added to; it ends with the step that takes it to lookups_max. */
int cr_way_measure(const cr_respond_input *in, cr_way_work *work, uint32_t lookups_max);

/* Purpose  how much each half-space pushes, once all is measured.   Output  1 when it is known and some work is left, to answer; with 0 call again.
 * Cost     as cr_way_measure; ends with a sweep. */
int cr_way_push(cr_way_work *work, uint32_t lookups_max);

/* Purpose  the response, of what pushes.   Output  out[0..return), a contact for each half-space that pushes; stats: samples of what had no room. */
uint32_t cr_way_answer(const cr_respond_input *in, cr_way_work *work, cr_area *out, uint32_t room, cr_stats *stats);

#endif
