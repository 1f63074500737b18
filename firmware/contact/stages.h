/* The stages of one tick, in flow order, and what passes between them. Internal: users include crease.h.
 *
 *     pose -> detect -> gather -> answer -> wrench
 *
 * Each stage reads const inputs, writes one output and counts in stats. Frames are in the names; lengths in m. */
#ifndef CR_STAGES_H
#define CR_STAGES_H

#include "contact/image.h"
#include "contact/math3.h"
#include "crease.h"

/* Beside the modes of cr_coverage: soft, of strips at static corners too. For rivals. */
#define CR_COVERAGE_STRIPS 2u

/* Work is counted in lookups of 16 points near the surface, not beside a crease, and summed in parts of one. */
#define CR_WORK_PARTS 256u
/* Parts of a unit: of a lane that is looked up, and where the image has samples; beside a crease, its cell, and where planes meet, each of them, and two more; of a lane that planes cut, or where
 * they are turned for one, each of them; twice where they are those of the cluster. */
#define CR_PARTS_OF_POINT 5u
#define CR_PARTS_OF_SAMPLES 11u
#define CR_PARTS_OF_CELL 7u
#define CR_PARTS_OF_MEETING 10u
#define CR_PARTS_OF_CUT 12u

/* Distance and its gradient at 16 world points. Saturated away from the surface: |phi_m| is then a lower bound. */
typedef struct {
    float phi_m[CR_LANES];
    float gx[CR_LANES], gy[CR_LANES], gz[CR_LANES]; /* gradient, world frame; 0 in far bricks */
    float ux[CR_LANES], uy[CR_LANES], uz[CR_LANES]; /* position in the brick, 0..1 */
    uint32_t entry[CR_LANES];                       /* top entry of the brick */
    uint32_t facet[CR_LANES];                       /* where bit is set in from_facet: facet whose plane is highest */
    uint32_t kind[CR_LANES];                        /* where bit is set in on_planes: what the cell sees */
    uint32_t on_planes;                             /* lanes in cells with planes that meet; */
    uint32_t parts;                                 /* of work */
    uint32_t from_facet;                            /* of these, those whose phi is from them: near the surface */
    uint32_t bent; /* of these, lanes nearest to an edge or a vertex: phi is not linear there */
} cr_lookup;
#define CR_FACET_NONE 0xffffffffu

typedef struct {
    float x[CR_LANES], y[CR_LANES], z[CR_LANES];
} cr_lanes3;

/* Purpose  how the creases are labelled at which two patches meet: CR_PAIR_* bits, 0 for none. */
uint32_t cr_pair_label(const cr_scene *scene, uint32_t a, uint32_t b);

static inline cr_vec3 lane_of(const cr_lanes3 *l, int i) { return v3(l->x[i], l->y[i], l->z[i]); }

/* Purpose  CRC-32 (IEEE 802.3) of an image with its crc32 field taken as zero. */
uint32_t cr_image_crc(const uint8_t *image, uint32_t size_bytes);

/* Constants of a scene that every lookup needs, computed once by cr_field_init. */
typedef struct {
    const cr_scene *scene;
    float inv_brick;
    float grid_max[3]; /* largest float below dims, so that truncation stays inside the grid */
    int32_t dims[3];
} cr_field;

void cr_field_init(cr_field *field, const cr_scene *scene);

/* Purpose  signed distance of 16 points to the static surface, negative inside.
 * Shapes   world_m: CR_LANES points, finite.   Output  every lane written.
 * Cost     16 lanes about 90 ns on an AMD EPYC core with 256-bit vectors.   Source  DESIGN.md "Distance". */
void cr_field_look_up(const cr_field *field, const cr_lanes3 *world_m, cr_lookup *out);

/* Purpose  the same for some lanes only.   Shapes  lanes: bits of CR_LANES; the others must be finite too.
 * Output   the lanes asked for; the others hold anything, and no bit of on_planes, from_facet and bent.
 * Cost     with CR_SCALAR about 150 instructions a lane, 70 in far bricks. */
void cr_field_look_up_lanes(const cr_field *field, const cr_lanes3 *world_m, uint32_t lanes, cr_lookup *out);

/* Purpose  what a lane sees of the static surface: index into scene->kinds, 0 when no surface is near. */
uint32_t cr_field_kind(const cr_field *field, const cr_lookup *at, int lane);

/* Purpose  points of a cluster or sphere centres of a group, tool frame to world frame. */
void cr_lanes_to_world(const xform *world_from_tool, const float *x, const float *y, const float *z,
                       cr_lanes3 *world_m);

/* Purpose  signed distance to a convex solid bounded by planes, height[k] above plane k, negative inside all. Outside, the nearest
 *          point lies on the highest plane, or, when that foot is above a second plane, on their edge, or above a third, at
 *          their vertex.
 * Shapes   normal, height: [count], 1 to CR_KIND_FACETS_MAX.   Output  *nearest: the highest plane; *grad: unit. */
float cr_convex_distance(const cr_vec3 *normal, const float *height, uint32_t count, uint32_t *nearest, cr_vec3 *grad);

/* Planes of a kind in the tool frame, turned so that they bound a convex solid: the static object, or with sign -1 the space
 * round it. height = normal . p + offset. */
typedef struct {
    uint32_t kind; /* index into scene->kinds; 0: none */
    uint32_t count;
    float sign;
    float spread;   /* largest |difference| of two normals */
    uint32_t sharp; /* 1: two normals point away from each other */
    float
        reach; /* half-widths from its middle up to which they cut a piece: CR_CORNER_REACH at a static corner, else 1 */
    uint32_t facet[CR_KIND_FACETS_MAX];
    cr_vec3 normal_tool[CR_KIND_FACETS_MAX];
    float offset_m[CR_KIND_FACETS_MAX];
} cr_planes;

/* A strip of some width ends at half of it. Where four square pieces meet a static corner comes in between their middles: there each counts as a square
 * that is seen along its diagonal, whose second moment is the same, and which reaches so many times as far: to its corners. */
#define CR_CORNER_REACH 1.4142136f

/* Purpose  1: a kind of planes that meet in a static corner. */
static inline uint32_t cr_is_corner(const struct cr_img_kind *kind) {
    return (uint32_t)(kind->kind == CR_KIND_CONVEX) & (uint32_t)(kind->count > 2u);
}

/* Purpose  how far planes of a kind may cut pieces, in half-widths. */
static inline float cr_reach_of_kind(const struct cr_img_kind *kind) {
    return cr_is_corner(kind) != 0u ? CR_CORNER_REACH : 1.0f;
}

/* Samples of a cluster above the planes of that convex solid, and lanes by that. */
typedef struct {
    float height_m[CR_KIND_FACETS_MAX][CR_LANES];
    float top_m[CR_LANES];                /* the largest height */
    uint32_t highest[CR_KIND_FACETS_MAX]; /* lanes whose largest height is above that plane */
    uint32_t below;                       /* lanes whose piece lies below all planes */
    uint32_t cut;                         /* lanes whose piece is cut by one; the rest is outside */
} cr_heights;

/* Purpose  kind whose planes give the distance anywhere within radius_m of a point, on every axis; 0 when the image knows none.
 * Output   reach, where it is known: how far any planes that are known there may cut pieces, in half-widths. */
uint32_t cr_planes_around(const cr_field *field, cr_vec3 p_world, float radius_m, float *reach);

/* Purpose  planes of a kind, CR_KIND_PLANAR, _CONVEX or _CONCAVE, in the tool frame. */
void cr_planes_turn(const cr_scene *scene, const xform *world_from_tool, uint32_t kind, cr_planes *out);

/* Purpose  the one plane that matters within radius_m of a point: all others lie more than apart_m below it everywhere there.
 * Output   *one and its address, or the planes themselves when several matter. */
const cr_planes *cr_planes_alone(const cr_planes *planes, cr_vec3 p_tool, float radius_m, float apart_m,
                                 cr_planes *one);

/* Purpose  heights of the samples of a cluster.   Cost  20 instructions a lane and plane on a Cortex-M7. */
void cr_planes_measure(const cr_planes *planes, const struct cr_img_cluster *cluster, cr_heights *out);

/* Purpose  distance to the convex solid of a point at these heights, top the largest.
 * Cost     100 instructions on a Cortex-M7 where it is above several planes. */
float cr_planes_distance(const cr_planes *planes, const float *height_m, float top_m);

/* A cluster in contact: its covered lanes. For rivals: those of them that hang together, and what they add to their area. */
typedef struct {
    uint32_t cluster;
    uint16_t covered; /* lanes with any coverage */
    uint16_t inside;  /* lanes with phi <= 0 */
    uint16_t
        near; /* lanes whose piece may be inside where its middle is not: creases with phi < reach, covered faces */
    uint16_t planes; /* kind whose planes give the distance at and round all lanes; 0: they were looked up */
    uint32_t facet;  /* where they were: the flat one that all lanes are over, or CR_FACET_NONE */
#ifdef CR_RIVALS
    uint16_t area; /* CR_HIT_NONE; set by a response of rivals/: index of the contact area */
    struct cr_img_sum sum;
#endif
} cr_hit;
#define CR_HIT_NONE 0xffffu

/* What the points of one cluster were found to be: by a lookup, or by the planes of the static surface there. */
typedef struct {
    uint32_t cluster;
    const struct cr_img_cluster *c;
    const cr_lanes3 *world; /* looked up: the points and what was found at each */
    const cr_lookup *at;
    const cr_planes
        *planes; /* else: what the static object is, and the points' heights above it; null when looked up */
    const cr_heights *heights;
    const float *coverage; /* 0 where `covered` is not set */
    uint32_t covered, full, inside, near;
} cr_looked;

/* Zones of a tick: a static facet, or a side of a curved surface, that one piece of the tool is inside of. Bits of a word. */
#define CR_WAY_ZONES_MAX 24u

/* Sides of a curved surface: the directions of the axes. A sample counts for those that its normal has a part of. */
#define CR_WAY_SIDES 6u

/* Key of a zone. */
typedef struct {
    uint32_t surface; /* facet; CR_WAY_CURVED with a patch; CR_WAY_DEEP or CR_WAY_NONE */
    uint32_t side;    /* below CR_WAY_SIDES; 0 on a facet */
    uint32_t piece;   /* of the tool */
} cr_way_key;
#define CR_WAY_CURVED 0x80000000u
#define CR_WAY_DEEP 0xfffffffeu /* far from any facet: only the direction of the distance is known */
#define CR_WAY_NONE 0xffffffffu /* not even that */

/* What a piece of the tool is inside of. */
typedef struct {
    cr_way_key key;
    uint32_t patch;
    float weight_m3;   /* sum of depth times area */
    float area_m2;     /* covered */
    float deep_m;      /* of the deepest sample, */
    uint32_t deep_hit; /* in this hit */
    cr_vec3
        push_m3; /* - sum of depth times area vector: minus the gradient of the integral of the depth over the overlap */
    cr_vec3 turn_m4;             /* moment of that about the tool origin */
    cr_vec3 centre_m4;           /* weight times sample */
    cr_vec3 normal_m3, above_m4; /* curved: weight times static normal, and that times depth */
    uint32_t flat;               /* 1: a plane, height = normal . p + offset */
    cr_vec3 plane_normal;
    float plane_offset_m;
} cr_way_zone;

/* What one hit is inside of, so that it need not be looked at again where others are deeper. */
typedef struct {
    uint32_t zones; /* bits */
    float
        bound_m; /* where all are over one surface: no piece of its samples is anywhere deeper than this below a plane that it is inside of */
    cr_vec3 toward; /* a normal of those planes, tool frame */
    float spread;   /* largest |difference| of the others to it, or CR_WAY_NO_SPREAD */
} cr_way_reach;

/* Samples of a cluster that are inside of one surface: how deep, and how much of each, as far as they count for it. */
typedef struct {
    uint32_t surface, patch;
    uint32_t lanes;
    float depth_m[CR_LANES], coverage[CR_LANES]; /* 0 beside the lanes */
    cr_lanes3 normal_m;                          /* depth times static normal, tool frame; of a plane it is not known */
} cr_way_layer;
#define CR_WAY_LAYERS_MAX 12u

/* Steps of what a hit is inside of: its planes; or the surface of all lanes that were looked up, or else cell by cell, and lane by
 * lane; all of them fade; layer by layer they come into the zones. */
enum { CR_WAY_PLANES, CR_WAY_COMMON, CR_WAY_CELLS, CR_WAY_FADE, CR_WAY_ADD };

typedef struct {
    uint32_t count, dropped;
    uint32_t step;   /* the next one; from CR_WAY_ADD on a layer each */
    uint32_t parts;  /* of work, of the last one */
    uint32_t near;   /* lanes that may be measured: covered, or their piece may be inside where the middle is not */
    uint32_t facet;  /* the flat one that all of these are over, or CR_FACET_NONE */
    uint32_t planes; /* kind whose planes give the distance at all of these, or 0 */
    uint32_t left;   /* lanes that are in none yet */
    float deep_m;    /* no lane is deeper than that, in all its layers together, but for a ramp in each that is level */
    cr_lanes3 normal;       /* where they were looked up: static normals at the samples, tool frame, */
    float full_m[CR_LANES]; /* and depths, whatever they count for: of lanes in curved layers */
    cr_way_reach reach;
    cr_way_layer layers[CR_WAY_LAYERS_MAX];
} cr_way_layers;

typedef struct {
    uint32_t count, dropped;
    float dropped_m3; /* weight of the heaviest that there was no room for */
    cr_way_zone zones[CR_WAY_ZONES_MAX];
    uint32_t area_of[CR_WAY_ZONES_MAX];  /* set by the answer: contact area of each zone, or CR_HIT_NONE */
    cr_way_reach reach[CR_CLUSTERS_MAX]; /* of each hit */
    cr_way_layers layers;                /* of the cluster in hand */
} cr_way_zones;

#ifdef CR_RIVALS
#include "contact/compare.h"
#endif

/* What detect found: hits, and the zones they are inside of. */
typedef struct {
    uint32_t hit_count;
    uint32_t contacts; /* points inside the static object */
    cr_hit hits[CR_CLUSTERS_MAX];
    cr_way_zones way;
#ifdef CR_RIVALS
    uint32_t touch_count;
    cr_touch touches[CR_TOUCHES_MAX];
#endif
} cr_contact_set;

/* Purpose  room for one more hit of a cluster, its places not set; null, and counted, when all are taken. */
cr_hit *cr_add_hit(cr_contact_set *set, uint32_t cluster, cr_stats *stats);

/* Purpose  begin to add to the zones what a hit is inside of.   Shapes  hit: index of the hit; looked: its cluster.   Source  WAY_OUT.md "Zones". */
void cr_way_add(cr_contact_set *set, uint32_t hit, const cr_looked *looked);

/* Purpose  the next step of that.   Shapes  looked: as for cr_way_add.   Output  1: it was the last; 0: call again.   Cost  layers.parts. */
int cr_way_add_more(const cr_field *field, const xform *world_from_tool, cr_contact_set *set, uint32_t hit,
                    const cr_looked *looked);

/* Purpose  once all hits are added: where there was no room for all zones those that there are count by what they hold beyond what was left out.
 * Units    dropped_m3 m^3.   Output  sums and weights of the zones, made less.   Errors  none.   Cost  all zones; not to be called when all had room. */
void cr_way_lighten(cr_way_zones *zones);

/* Height of a sample above the plane normal . p + offset, m. */
static inline float height_above(const struct cr_img_cluster *c, int i, cr_vec3 normal, float offset_m) {
    return normal.x * c->x[i] + normal.y * c->y[i] + normal.z * c->z[i] + offset_m;
}

/* Width over which the height above a plane varies across a sample's piece, m. The normal has length 1. */
static inline float piece_width(const struct cr_img_cluster *c, int i, cr_vec3 n) {
    const float cross = c->wxy[i] * n.x * n.y + c->wyz[i] * n.y * n.z + c->wzx[i] * n.z * n.x;
    const float width2 = c->wxx[i] * n.x * n.x + c->wyy[i] * n.y * n.y + c->wzz[i] * n.z * n.z + 2.0f * cross;
    return sqrtf(higher_f(0.0f, width2));
}

/* Purpose  how far a convex solid is a corner to a piece, 0..1, by the third highest of the heights of its middle above the planes: in full where that plane may cut it too, none from
 *          half as far again below on.   Shapes  height_m[count]. */
float cr_corner_part(const float *height_m, uint32_t count, float ramp_m);

/* Of a square that is seen along its diagonal, its middle this many widths above a plane: by the share of the diagonal that is left beyond the plane, the part that lies below it, and its mean
 * depth in widths, what is outside counting as none. */
static inline float cr_rest_of_square(float height) { return higher_f(0.0f, 1.0f - CR_CORNER_REACH * abs_f(height)); }

static inline float cr_square_below(float height, float rest) {
    const float less = 0.5f * rest * rest;
    return height > 0.0f ? less : 1.0f - less;
}

static inline float cr_square_depth(float height, float rest) {
    return CR_CORNER_REACH / 12.0f * rest * rest * rest + higher_f(0.0f, -height);
}

/* Ramps up to which a piece reaches that is so far at a corner. */
static inline float cr_corner_reach(float corner) { return 1.0f + (CR_CORNER_REACH - 1.0f) * corner; }

/* Planes that are so much lower than another do not matter to a sample, m. */
static inline float apart_of(const struct cr_img_meta *m) { return max_f(m->crease_m, 2.0f * m->ramp_max_m); }

/* W v for one lane: the spread of its piece along v. */
static inline cr_vec3 spread_times(const struct cr_img_cluster *c, int i, cr_vec3 v) {
    return v3(c->wxx[i] * v.x + c->wxy[i] * v.y + c->wzx[i] * v.z, c->wxy[i] * v.x + c->wyy[i] * v.y + c->wyz[i] * v.z,
              c->wzx[i] * v.x + c->wyz[i] * v.y + c->wzz[i] * v.z);
}

/* Purpose  part of each sample's piece of surface that is inside the static object: in or out when mode is hard.
 * Shapes   at: what was looked up at the cluster's points.   Output  coverage[CR_LANES], 0..1.
 * Returns  planes that lanes were cut by, twice those of a corner, those that were turned for it, and lanes that were asked for them.   Source   DESIGN.md "Point shell and coverage". */
uint32_t cr_cover(const cr_scene *scene, const xform *world_from_tool, uint32_t mode,
                  const struct cr_img_cluster *cluster, const cr_lookup *at, float *coverage);

/* Purpose  the same for a lane that planes of the static surface cut: of the convex solid that they bound.
 * Shapes   height[planes->count], top the largest of them; distance_m: to the solid. */
float cr_cover_by_planes(const cr_planes *planes, const struct cr_img_cluster *cluster, int lane, const float *height,
                         float top_m, float distance_m);

/* Purpose  area, area vector and first moment of a cluster under the given coverage, lanes added in a fixed order.
 * Shapes   w[CR_LANES] in 0..1. The image holds the result for w = 1, made by this function. */
void cr_sum_cluster(const struct cr_img_cluster *cluster, const float *w, struct cr_img_sum *sum);

/* How far the tool may have moved since a sphere was last looked at: bounds that only grow. */
typedef struct {
    float slide_m;  /* sum of |translation of the tool origin| */
    float turn_rad; /* sum of 2 |change of the quaternion|: turn * rho bounds the motion of a point at rho */
    float slide_lost_m, turn_lost_rad; /* of them, what their last bits could not take */
    cr_pose last;                      /* where the last search began */
    uint32_t valid;
    uint32_t stale; /* 1: what is below was found before the odometers began anew */
    float root_wake_m;
    float *wake_m; /* [group_count * CR_LANES] a sphere is free while slide + turn * rho < wake */
    uint32_t wake_count;
} cr_motion;
#define CR_WAKE_NOW (-1.0f) /* where a sphere may come near at once */

typedef struct {
    uint32_t skip;        /* CR_SKIP_* */
    uint32_t coverage;    /* cr_coverage */
    uint32_t lookups_max; /* work of one call, in lookups of 16 points; all that is done counts, in parts of one */
    uint32_t slices_max;  /* calls that a search may take: what was not seen by then is left out, and counted */
#ifdef CR_RIVALS
    uint32_t touches; /* 1: what is touched, for a response of rivals/, and no zones */
#endif
} cr_detect_options;

/* A group of the tree on the way down, and which of its children are still to be seen. */
typedef struct {
    uint32_t group, lanes;
} cr_search_level;

/* Leaf spheres that are looked at together: lanes of several groups share one lookup. */
typedef struct {
    cr_lanes3 world;
    cr_lookup centres;
} cr_batch;

/* What is known of the cluster in hand. */
typedef struct {
    uint32_t slot; /* its sphere, as in cr_motion, */
    int lane;      /* and in the batch */
    cr_looked looked;
    float coverage[CR_LANES];
    union {
        struct {
            cr_planes alone;
            cr_heights heights;
        };
        struct {
            cr_lanes3 world;
            cr_lookup at;
        };
    };
} cr_in_hand;

/* Nothing; the root of the tree, which is yet to be seen; a cluster that was looked up, and not yet told what of it is covered; the last hit, which is not
 * all in zones yet. */
enum { CR_HAND_EMPTY, CR_HAND_ROOT, CR_HAND_LOOKED_UP, CR_HAND_ADDING };

/* Where a search stands between two ticks. */
typedef struct {
    uint32_t open;  /* 1: begun and not at its end */
    uint32_t calls; /* that it has taken so far */
    uint32_t spent; /* work of this call, in parts */
    uint32_t depth; /* levels in use */
    cr_search_level stack[CR_TREE_DEPTH_MAX];
    uint32_t waiting;        /* leaf spheres that were reached and not yet looked at */
    uint32_t slot[CR_LANES]; /* of these, 16 group + lane, as in cr_motion */
    uint32_t looked_up;      /* 0, or as many as wait: they are in the batch */
    uint32_t visited;        /* of these, those that were looked at */
    cr_batch batch;
    uint32_t hand;    /* CR_HAND_*: what comes first */
    cr_planes planes; /* those that the last cluster on planes lay at */
    cr_in_hand in_hand;
} cr_descent;

/* Purpose  add the motion to this pose to the odometers; forget everything when they would lose precision. */
void cr_motion_advance(cr_motion *motion, const cr_pose *world_from_tool);

/* Purpose  wake all spheres, where motion->stale says that they have to be.   Output  motion->stale: 0. */
void cr_motion_wake(cr_motion *motion);

/* Purpose  the clusters of the shell that reach into the static object, in ascending order, and the zones they are inside of.
 * Output   *set, whole when the result is 1; the same to the bit for every subset of options->skip. With 0 the search is open: call
 *          again with the same pose and the same motion until it is 1, at most options->slices_max times, and until the last hit is in zones.
 * Errors   none: capacities are counted in stats.
 * Cost     search->spent, at most a step more than options->lookups_max.   Source  DESIGN.md "Detect" [2][3]. */
int cr_detect(const cr_field *field, const xform *world_from_tool, const cr_detect_options *options, cr_motion *motion,
              cr_descent *search, cr_contact_set *set, cr_stats *stats);

/* What the answer may look at. */
typedef struct {
    const cr_field *field;
    const xform *world_from_tool;
    cr_contact_set *set;
    const cr_config *config;
#ifdef CR_RIVALS
    cr_proxy *proxy;
#endif
} cr_respond_input;

#ifdef CR_RIVALS
/* What detect does for a response of rivals/ and that response itself: defined there. */

/* Purpose  hits of the covered lanes of a cluster, one for each set of lanes that hang together, and the surfaces they touch. */
void cr_touch_points(const cr_field *field, const xform *world_from_tool, const cr_looked *looked, cr_contact_set *set,
                     cr_stats *stats);

/* Purpose  the surface that a hit, inside as a whole, touches: by what was looked up at its middle.   Shapes  at, lane: of middle. */
void cr_touch_whole(const cr_field *field, cr_hit *hit, cr_vec3 middle_world, const cr_lookup *at, int lane,
                    cr_contact_set *set, cr_stats *stats);

/* Purpose  areas with normal, contact plane, depth and acting point, no force yet.
 * Shapes   hit_of_cluster[scene->cluster_count], all CR_HIT_NONE between ticks.   Output  out[0..return), every number finite. */
uint32_t cr_respond_as_rival(const cr_respond_input *in, uint16_t *hit_of_cluster, cr_area_set *areas, cr_area *out,
                             uint32_t room, cr_stats *stats);
#endif

/* Purpose  what the last tick detected, with the area of every hit: for viewers, no tick reads it.
 * Output   stale after a tick that reported no areas; never null. */
const cr_contact_set *cr_world_contacts(const cr_world *world);

#endif
