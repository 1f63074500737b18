/* Layout of the scene image in memory. The bytes are specified in SPEC.md; this file is their C reading.
 * Little-endian, offsets instead of pointers, sections 64-byte aligned, lengths in m. Parsed by scene.c only. */
#ifndef CR_IMAGE_H
#define CR_IMAGE_H

#include "crease.h"

#define CR_IMG_MAGIC "CREASE\r\n" /* the line ending shows a transfer in text mode */
#define CR_IMG_ALIGN 64u

enum {
    CR_SEC_META = 1,
    CR_SEC_TOP = 2,
    CR_SEC_BRICKS = 3,
    CR_SEC_SAMPLES = 4,
    CR_SEC_CELLS = 5,
    CR_SEC_KINDS = 6,
    CR_SEC_FACETS = 7,
    CR_SEC_PAIRS = 8,
    CR_SEC_EDGES = 9,
    CR_SEC_CLUSTERS = 10,
    CR_SEC_SUMS = 11,
    CR_SEC_GROUPS = 12,
    CR_SEC_ADJ_START = 13,
    CR_SEC_ADJ = 14,
    CR_SEC_COUNT = 14
};

struct cr_img_header {
    uint8_t magic[8];
    uint32_t version;
    uint32_t size_bytes; /* of the whole image, a multiple of 64 */
    uint32_t crc32;      /* of the whole image with this field zero (IEEE 802.3) */
    uint32_t section_count;
    uint32_t reserved[10];
};

struct cr_img_section {
    uint32_t id;     /* CR_SEC_*, ascending */
    uint32_t offset; /* from the start of the image, multiple of 64 */
    uint32_t count;  /* elements */
    uint32_t stride; /* bytes of one element */
};

struct cr_img_meta {
    /* voxmap */
    float origin_m[3]; /* low corner of the brick grid */
    float brick_m;     /* side of a brick */
    uint32_t dims[3];  /* bricks along x, y, z */
    float voxel_m;     /* side of a cell: brick_m / 8 */
    float band_m;      /* distances are exact up to this, saturated beyond */
    float crease_m;    /* planes of crease cells decide up to this distance; beyond, the samples do */
    float quantum_m;   /* distance of one sample step: band_m / 32767 */
    float error_out_m; /* no distance looked up outside the object is further from the true one: margin of skips */
    float error_in_m;  /* the same inside */
    float error_max_m; /* largest error measured near the surface */
    float error_rms_m;
    float crease_angle_rad;
    /* shell */
    float spacing_m;     /* nominal distance between samples */
    float tool_radius_m; /* sphere about the tool origin that holds the tool */
    float root_centre_m[3];
    float root_radius_m; /* bounding sphere of the shell */
    float shell_area_m2;
    float ramp_max_m;     /* largest distance at which a sample is covered: half the largest spacing */
    uint32_t point_count; /* without padding lanes */
    uint32_t levels;      /* of the sphere tree, groups only */
    uint32_t patch_count;
    /* provenance, not used by the tick */
    uint32_t static_triangles, tool_triangles;
    float static_unit_m, tool_unit_m; /* metres of one unit of the source file */
    uint32_t smooth_edges, convex_edges, concave_edges;
    uint8_t static_sha256[32];
    uint8_t tool_sha256[32];
    float static_min_m[3], static_max_m[3];
    float tool_min_m[3], tool_max_m[3];
    uint32_t piece_count; /* convex pieces of the tool's surface, at most CR_PIECE_NONE */
    uint32_t reserved[3];
};

/* top[]: bit 31 clear: index of a near brick. Bit 31 set: far brick; bit 30: inside; bits 0..29: lower bound of the
 * distance to the surface anywhere in the brick, in units of quantum_m. */
#define CR_TOP_FAR 0x80000000u
#define CR_TOP_INSIDE 0x40000000u
#define CR_TOP_BOUND 0x3fffffffu

#define CR_BRICK_SIDE_MAX 8u
#define CR_CELLS_SIDE 8u /* cell tables have 8 x 8 x 8 entries */
/* A fine brick: (8 + 1)^3 samples, from CR_FINE_TABLE on an entry for each voxel, from CR_FINE_BLOCKS on the blocks of samples that
 * they name. An entry: 0: none. Bits 0..13: where the block begins, in units of CR_FINE_UNIT samples from the first sample of the
 * brick. Bit 14: the voxel has 4 intervals a side, otherwise 2. */
#define CR_FINE_TABLE 736u
#define CR_FINE_BLOCKS 1248u
#define CR_FINE_UNIT 32u
#define CR_FINE_AT 0x3fffu
#define CR_FINE_QUARTERS 0x4000u
#define CR_CELLS_NONE 0xffffffffu

struct cr_img_brick {
    uint32_t samples; /* first sample; (side + 1)^3 of them, x fastest */
    uint16_t side;    /* cells along an edge: a power of two, 1..CR_BRICK_SIDE_MAX */
    uint8_t creased;  /* 1: holds cells of kind CONVEX or CONCAVE */
    uint8_t fine;     /* 1: some voxels have samples of their own; side is 8 */
    uint32_t cells;   /* first entry of the cell table (512), or CR_CELLS_NONE: kind holds for the whole brick */
    /* Indices into kinds[]. kind: of all the brick when cells is CR_CELLS_NONE, 0 is "no surface"; else as planes, with the fewest
     * facets. planes: those give the distance anywhere in the brick; 0: none do. */
    uint16_t kind, planes;
};

/* What of the static surface a cell sees. */
enum {
    CR_KIND_EMPTY = 0,   /* no surface near */
    CR_KIND_PLANAR = 1,  /* one facet */
    CR_KIND_CURVED = 2,  /* one smooth patch that is not flat here: normal from the distances */
    CR_KIND_CONVEX = 3,  /* facets meeting convexly: distance is exact from their planes */
    CR_KIND_CONCAVE = 4, /* facets meeting concavely: likewise */
    CR_KIND_MIXED = 5    /* anything else: distances from the samples, surface by the nearest plane */
};
#define CR_KIND_FACETS_MAX 6u

struct cr_img_kind {
    uint16_t kind;
    uint16_t count;                     /* facets used */
    uint32_t facet[CR_KIND_FACETS_MAX]; /* index into facets[] */
};

/* A plane; one that stands for a curved patch, only nominal; a plane of a curved patch, as at a crease: zones are those of the patch. */
enum { CR_FACET_FLAT = 0u, CR_FACET_CURVED = 1u, CR_FACET_OF_CURVED = 2u };

#define CR_FACET_SIDES 4u

/* A planar facet (merged coplanar triangles), or for a curved patch its area-weighted mean. normal . x = offset. Seen along the normal it lies in a rectangle. */
struct cr_img_facet {
    float normal[3];
    float offset_m;
    uint32_t patch; /* smooth piece of the surface it belongs to */
    uint8_t curved; /* CR_FACET_* */
    uint8_t
        ends; /* bits: beyond which sides of its rectangle the surface does not go on: low, high, and those across */
    int16_t along[3];          /* one side of the rectangle, across the normal: a unit vector times 32,767 */
    float low_m[2], high_m[2]; /* from where to where it reaches, along that and along normal x along */
};

enum { CR_PAIR_CONVEX = 1u, CR_PAIR_CONCAVE = 2u };

/* Two patches that share a crease, first < second, sorted; label is a set of CR_PAIR_* bits. */
struct cr_img_pair {
    uint32_t first, second;
    uint32_t label;
};

/* One crease: a sharp edge of the static object. Edges not listed are smooth. */
struct cr_img_edge {
    float a_m[3], b_m[3];
    uint32_t patch[2];
    uint32_t label;  /* one CR_PAIR_* bit */
    float angle_rad; /* between the two normals */
};

/* What is above stands for no patch: CR_WAY_DEEP and CR_WAY_NONE of stages.h, without the bit that tells a curved one. */
#define CR_PATCHES_MAX 0x7ffffffeu
#define CR_PIECE_NONE 0xffffu
#define CR_PIECES 2

/* 16 shell points, structure of arrays, tool frame. Unused lanes repeat the first point with zero area. */
struct cr_img_cluster {
    float x[CR_LANES], y[CR_LANES], z[CR_LANES];
    float ax[CR_LANES], ay[CR_LANES], az[CR_LANES]; /* outward normal times area, m^2; next to nothing on features */
    float area[CR_LANES];                           /* length of the area vector, m^2 */
    /* Second moment of the sample's piece of surface times 12: g^T w g is the squared width over which a distance with gradient
     * g varies across the piece. m^2. */
    float wxx[CR_LANES], wyy[CR_LANES], wzz[CR_LANES], wxy[CR_LANES], wyz[CR_LANES], wzx[CR_LANES];
    float ramp[CR_LANES];  /* half the largest such width for a unit gradient: where coverage can begin, m */
    float reach[CR_LANES]; /* half the length of a crease piece, m; 0 for other samples */
    float bow[CR_LANES];   /* how far a face sample\'s piece bends back behind its plane, m; 0 where it is flat */
    uint16_t count;        /* lanes in use */
    uint16_t vertex_mask;  /* lanes that are corners or other vertices of the mesh */
    uint16_t crease_mask;  /* lanes that are straight pieces of creases: their middles */
    uint16_t piece_lanes[CR_PIECES]; /* lanes that belong to each of piece[] */
    uint16_t
        inner_mask; /* lanes of flat faces that go on all round, CR_WAY_REACH half-widths of the piece from its middle */
    float normal[3];           /* mean outward normal, unit or zero */
    float radius_m;            /* sphere about the mean position that holds the points */
    uint16_t beside[CR_LANES]; /* lanes of this cluster beside each lane on the tool surface */
    uint16_t piece[CR_PIECES]; /* convex pieces of the tool's surface that the samples belong to; CR_PIECE_NONE */
};

/* Sums of a cluster with every lane at full coverage, in the lane order of the tick. */
struct cr_img_sum {
    float ax, ay, az; /* area vectors */
    float px, py, pz; /* |area| times position */
    float area;
    float peak; /* largest coverage of a lane: 1 in the image */
};

/* Records that one cluster's list may have: the work of a tick is bounded by it. The tools of meshes/ have up to 76. */
#define CR_IMG_BESIDE_MAX 512u

/* Samples beside each other on the tool surface across two clusters: each of `mine` is beside each of `theirs`. */
struct cr_img_neighbour {
    uint32_t cluster;
    uint16_t mine, theirs; /* lanes of this cluster and of the other */
};

/* 16 spheres of one node of the tree: its children are groups, or clusters at the last level. */
struct cr_img_group {
    float x[CR_LANES], y[CR_LANES], z[CR_LANES];
    float radius[CR_LANES];   /* sphere holds all points of the child */
    float margin[CR_LANES];   /* largest distance at which a point of the child is covered: half its spacing */
    float rho[CR_LANES];      /* largest distance of a point of the child from the tool origin */
    uint32_t child[CR_LANES]; /* group index, or cluster index when leaf */
    uint32_t first[CR_LANES]; /* first cluster below */
    uint32_t count;           /* lanes in use */
    uint32_t leaf;            /* 1: children are clusters */
    uint32_t level;           /* 0 for the root; children are one level down */
    uint32_t pad[13];
};

#endif
