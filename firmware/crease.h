/* crease: contact of a rigid tool with a rigid mock-up, one wrench per tick. The one public header.
 *
 * Flow     image -> cr_scene_open -> cr_world_init -> cr_tick, cr_tick, ...; or cr_feel in a timer's interrupt over cr_search in the main loop
 * Memory   the caller's: the image (read-only, must outlive the scene), the world (cr_world_size bytes). No heap.
 * Threads  a scene may be shared by any number of worlds; a world belongs to one thread at a time, but for cr_search and cr_feel, which may be in two.
 * Time     an argument. No clock, no I/O, no globals: cr_tick is a pure function of (scene, world, pose, period).
 * Units    SI: m, N, s, rad, kg. Frames: "world" is the static object's frame, "tool" the tool mesh's frame;
 *          world_from_tool maps tool coordinates to world coordinates.
 * Numbers  float32, round to nearest, no contraction: the same outputs to the bit on every target (DESIGN.md). */
#ifndef CREASE_H
#define CREASE_H

#include "config.h"

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The one place where the version stands: library, pkg-config, CMake, Python package and `crease --version` have it from here.
 * What a change of it promises: CHANGELOG.md. */
#define CR_VERSION_MAJOR 0
#define CR_VERSION_MINOR 2
#define CR_VERSION_PATCH 0
#define CR_VERSION (CR_VERSION_MAJOR * 1000000 + CR_VERSION_MINOR * 1000 + CR_VERSION_PATCH)
/* Version of the scene image this library reads (SPEC.md). */
#define CR_IMAGE_VERSION 6u

/* Purpose  version of the library that runs; another than CR_VERSION: it was built from other headers than its caller. */
uint32_t cr_version(void);

typedef struct {
    float x, y, z;
} cr_vec3;

/* Unit quaternion, Hamilton convention, scalar first. */
typedef struct {
    float w, x, y, z;
} cr_quat;

typedef struct {
    cr_vec3 pos_m;
    cr_quat rot;
} cr_pose;

/* Set-up errors: zero or negative, outputs untouched on failure. cr_err_text gives one line for each. */
typedef enum {
    CR_OK = 0,
    CR_ERR_NULL = -1,    /* a required pointer is null */
    CR_ERR_ALIGN = -2,   /* image or memory is not 64-byte aligned */
    CR_ERR_SIZE = -3,    /* image shorter than its header says, or memory smaller than cr_world_size */
    CR_ERR_MAGIC = -4,   /* not a scene image */
    CR_ERR_VERSION = -5, /* an image of another format version */
    CR_ERR_CRC = -6,     /* bytes changed since bake */
    CR_ERR_SECTION = -7, /* a section is missing, misplaced or of the wrong size */
    CR_ERR_INDEX = -8,   /* an index in the image points outside its table */
    CR_ERR_VALUE = -9,   /* a number in the image is not finite or out of range */
    CR_ERR_CONFIG = -10  /* a world setting is not finite or out of range */
} cr_err;

/* Purpose  one line of English for an error code.   Output  static text, never null. */
const char *cr_err_text(cr_err err);

/* Where the sections of an opened image lie. Plain pointers into the caller's image: copyable, read-only.
 * Filled by cr_scene_open only; layout in image.h, bytes in SPEC.md. */
typedef struct {
    const struct cr_img_meta *meta;
    const uint32_t *top;                   /* [dims[2]][dims[1]][dims[0]] of meta: near brick index or far bound */
    const struct cr_img_brick *bricks;     /* [brick_count] */
    const int16_t *samples;                /* [sample_count] */
    const uint16_t *cells;                 /* [cell_count] */
    const struct cr_img_kind *kinds;       /* [kind_count] */
    const struct cr_img_facet *facets;     /* [facet_count] */
    const struct cr_img_pair *pairs;       /* [pair_count], sorted */
    const struct cr_img_edge *edges;       /* [edge_count] creases */
    const struct cr_img_cluster *clusters; /* [cluster_count] */
    const struct cr_img_sum *sums;         /* [cluster_count] */
    const struct cr_img_group *groups;     /* [group_count], root first */
    const uint32_t *adj_start;             /* [cluster_count + 1] */
    const struct cr_img_neighbour *adj;    /* [adj_count] */
    uint32_t brick_count, sample_count, cell_count, kind_count, facet_count, pair_count, edge_count;
    uint32_t cluster_count, group_count, adj_count;
} cr_scene;

/* Purpose  validate an image once and find its sections.
 * Units    size_bytes: bytes from image to the end of readable memory; image 64-byte aligned.
 * Output   *scene.   Errors  every cr_err but CONFIG: hostile bytes give a code, never a wild read, here or in cr_tick.
 * Cost     O(size): reads every byte once for the CRC and every index once. */
cr_err cr_scene_open(cr_scene *scene, const void *image, size_t size_bytes);

/* How a contact area turns into a force. */
typedef enum {
    CR_RESPONSE_WAY_OUT = 0, /* the shortest translation that leads out: contact/DESIGN.md */
#ifdef CR_RIVALS             /* for comparison on the host only: rivals/README.md */
    CR_RESPONSE_EXTENT, /* the extent of the overlap along its mean normal; with CR_COVERAGE_HARD the method as published [1] */
    CR_RESPONSE_FIXED45, /* equal weight to every zone at a crease: the method [1] is compared with */
    CR_RESPONSE_VOXMAP,
    CR_RESPONSE_DISTANCE_FIELD,
    CR_RESPONSE_DEEPEST_GROUP,
    CR_RESPONSE_OVERLAP,
    CR_RESPONSE_NORMAL_GROUPS,
    CR_RESPONSE_GOD_OBJECT,
    CR_RESPONSE_SPHERE_PROXY,
#endif
    CR_RESPONSE_COUNT
} cr_response;

/* How a shell sample near the surface counts. */
typedef enum {
    CR_COVERAGE_SOFT = 0, /* by the part of its area that is inside; zone weights by cone decomposition */
    CR_COVERAGE_HARD = 1  /* in or out, with projection, spheres and common vertices: the method as published [1] */
} cr_coverage;

/* What detection may skip. Every skip is conservative: the outputs are the same to the bit with any subset. */
enum {
    CR_SKIP_TOP = 1u,       /* whole tool outside the reach of the voxmap */
    CR_SKIP_TREE = 2u,      /* sphere tree nodes that are certainly free or certainly inside */
    CR_SKIP_COHERENCE = 4u, /* nodes that cannot have come near since they were last looked at */
    CR_SKIP_ALL = 7u
};

typedef struct {
    float stiffness_N_m;    /* 0..1e6 */
    float damping_Ns_m;     /* 0..1e4, along the area normal, never making the force pull; areas share it */
    float force_max_N;      /* > 0, limit on |force|; torque is scaled along */
    uint32_t response;      /* cr_response */
    uint32_t coverage;      /* cr_coverage */
    uint32_t skip;          /* CR_SKIP_* bits */
    uint32_t vertices_only; /* 1: only tool mesh vertices measure depth, as [1] does; 0: all samples */
    uint32_t lookups_max; /* 32..1048576, work of a tick in lookups of 16 points; what needs more takes several ticks */
} cr_config;

/* Purpose  the default settings: 1000 N/m, no damping, 100 N limit, the way out, all skips, CR_LOOKUPS_MAX. */
cr_config cr_config_default(void);

/* Purpose  what is wrong with settings: the members and what they may hold. Output  null when nothing is.   Errors  a text for null, too. */
const char *cr_config_error(const cr_config *config);

/* One contact zone of an area: what of a smooth piece of the static surface is touched. */
typedef struct {
    uint32_t patch;         /* static patch the zone lies on */
    cr_vec3 normal_world;   /* unit */
    cr_vec3 centre_world_m; /* centroid of the touched surface */
    float radius_m;         /* sphere about centre that holds the touched surface */
    float area_m2;          /* touched area seen by the samples */
    float weight_m2;        /* alpha of the cone decomposition: area of this zone inside the tool */
    float offset_m;         /* plane of the zone: normal . x = offset */
} cr_zone;

/* One contact area and its force. */
typedef struct {
    cr_vec3 normal_world;  /* unit, out of the static object */
    cr_vec3 point_world_m; /* where the force acts: coverage-weighted centroid */
    cr_vec3 force_world_N;
    float depth_m;  /* >= 0 along the normal; of a late answer that rises or falls, what is felt of it */
    float offset_m; /* contact plane: normal . x = offset */
    float area_m2;  /* tool surface inside */
    uint32_t zone_count;
    cr_zone zones[CR_ZONES_MAX];
} cr_area;

/* Work done and trouble met in one tick. Plain counts. */
typedef struct {
    uint32_t nodes;            /* spheres of the tree whose distance was looked up */
    uint32_t points;           /* shell points whose distance was looked up */
    uint32_t contacts;         /* shell points inside the static object; 0 in a tick that answers with earlier areas */
    uint32_t clusters;         /* clusters in contact; likewise */
    uint32_t clusters_inside;  /* of these, taken whole without looking at their points */
    uint32_t nodes_coherent;   /* spheres not looked at thanks to temporal coherence */
    uint32_t late_ticks;       /* age of the pose whose contact is answered; 0: this tick's */
    uint32_t clusters_dropped; /* clusters in contact beyond CR_CLUSTERS_MAX, or not seen after CR_SEARCH_TICKS_MAX */
    uint32_t touches_dropped;  /* of a response of rivals/: surfaces touched beyond CR_TOUCHES_MAX */
    uint32_t areas_merged;     /* beyond CR_AREAS_MAX */
    uint32_t zones_dropped;    /* beyond CR_ZONES_MAX */
    uint32_t force_limited;    /* 1 when |force| was reduced to force_max_N */
    uint32_t work;             /* done in this tick, in lookups of 16 points: what cr_config.lookups_max bounds */
} cr_stats;

/* Faults latch: output stays zero until cr_world_clear_fault. */
enum {
    CR_FAULT_POSE = 1u,   /* pose not finite, quaternion not unit within 1 %, or |position| over 1e4 m */
    CR_FAULT_PERIOD = 2u, /* period not finite or not in (0, 1] s */
    CR_FAULT_NUMBER = 4u  /* the answer was not a number: an image made to harm */
};

typedef struct {
    cr_vec3 force_world_N;
    cr_vec3 torque_world_Nm; /* about the tool origin */
    cr_pose display_pose;    /* world_from_tool for the eye: moved by what the contacts push */
    float depth_m;           /* of the deepest area, all that push along it counted; 0 in free space */
    cr_vec3 normal_world;    /* of the deepest area; 0 in free space */
    uint32_t faults;         /* CR_FAULT_* latched */
    uint32_t area_count;     /* areas[0..area_count) are valid, the rest is not written */
    uint32_t zone_count;     /* over all areas */
    cr_stats stats;
    cr_area areas[CR_AREAS_MAX];
} cr_output;

typedef struct cr_world cr_world;

/* Purpose  bytes of memory a world for this scene needs.   Output  0 when scene or config is invalid. */
size_t cr_world_size(const cr_scene *scene, const cr_config *config);

/* Purpose  build a world in the caller's memory (64-byte aligned, size >= cr_world_size). The scene struct is copied, the
 *          image is not.
 * Output   *world points into memory.   Errors  NULL, ALIGN, SIZE, CONFIG. */
cr_err cr_world_init(cr_world **world, void *memory, size_t size_bytes, const cr_scene *scene, const cr_config *config);

/* Purpose  change settings between ticks, and not while cr_search runs; state is kept, a search for contact begins anew.
 * Errors   CONFIG: nothing changed. */
cr_err cr_world_configure(cr_world *world, const cr_config *config);

/* Purpose  forget motion history (next tick has zero velocity) and the contact in hand, and clear latched faults. By who ticks or feels. */
void cr_world_clear_fault(cr_world *world);

/* Purpose  one tick: where the tool is, and how long since the last tick -> wrench and report.
 * Units    period_s in (0, 1].   Output  finite and within limits; zero with out->faults set on bad input.
 * Late     an answer that needs more work than lookups_max is found over several ticks, at one pose: where the tool will be when it is
 *          felt, as the answer before and the motion since tell, no farther than samples are apart. Meanwhile the last areas are
 *          answered: their planes stay, their points move with the tool, zones are not reported. An answer that is n > 1 ticks old
 *          then rises over n, or n + 1 where it looked ahead, in equal parts, and what was felt before falls; where both together
 *          have more than CR_AREAS_MAX half-spaces it comes at once. After one that is a tick old what was felt before falls over
 *          the ticks since the answer before, or goes on falling; one of this tick stands by itself.
 * Errors   none: see faults and stats. No pointer may be null: none is checked, a null one is undefined behaviour.
 * Cost     stats.work, which ends with the step that takes it to lookups_max: one cluster, or one zone; typical figures in README.md. */
void cr_tick(cr_world *world, const cr_pose *world_from_tool, float period_s, cr_output *out);

/* Purpose  the tick in two parts, each at its own rate: this one looks for contact at the newest pose that was felt, one slice a call.
 * Units    work: in lookups of 16 points, as cr_config.lookups_max, which is not asked here.
 * Threads  one at a time; it may be interrupted by cr_feel at any place, or run beside it. Neither waits for the other. A world is driven by cr_tick or by
 *          these two; cr_world_clear_fault stands between when they change.
 * Output   work done; 0: the newest pose has its answer, or none was felt with the last answer yet: wait for another.
 * Errors   none. world may not be null: it is not checked, a null one is undefined behaviour.   Cost  as cr_tick. */
uint32_t cr_search(cr_world *world, uint32_t work);

/* Purpose  the other part: the wrench at a pose, of the newest contact that cr_search found; as cr_tick otherwise.
 * Output   as a tick that answers late: stats.late_ticks counts feels, areas have no zones, stats tell nothing of the search. Nothing ends a contact
 *          that nobody searches for any more: what late_ticks is too many is the caller's to say.
 * Errors   as cr_tick: faults and stats; a null pointer is undefined behaviour.
 * Cost     whatever the scene, whatever is searched: README.md. */
void cr_feel(cr_world *world, const cr_pose *world_from_tool, float period_s, cr_output *out);

#ifdef __cplusplus
}
#endif

#endif
