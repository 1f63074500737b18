/* Geometry work of `crease bake` that is too heavy for Python: features, exact signed distance, brick marking.
 * Host code: doubles, heap and libm are fine here. Lengths in m. Arrays are C-contiguous and the caller's.
 * Python calls all of it without the interpreter's lock: nothing here is static, any number of threads may be in it. */
#ifndef CREASE_BAKE_H
#define CREASE_BAKE_H

#include <stdint.h>

typedef struct crb_mesh crb_mesh;

typedef struct {
    int32_t triangles, vertices, facets, patches;
    int32_t smooth_edges, convex_edges, concave_edges;
    int32_t open_edges; /* edges without exactly two triangles: 0 for a closed mesh */
} crb_counts;

/* Purpose  take in a closed, outward-oriented mesh; find facets, patches, creases; build the search tree.
 * Units    vertices_m [vertex_count][3] in m; crease_angle_rad between normals; plane_tolerance_m: how far the vertices of
 *          a merged facet may lie from its plane; thin_m: a triangle thinner than that belongs to the facet and patch beside
 *          it, an edge no longer than that joins nothing.
 * Shapes   triangles [triangle_count][3], indices into vertices.
 * Output   a mesh to be freed with crb_mesh_free, or null when memory ran out or an index is out of range.
 * Cost     O(n log n); 1,000,000 triangles about 2 s. */
crb_mesh *crb_mesh_new(const double *vertices_m, int64_t vertex_count, const int32_t *triangles, int64_t triangle_count,
                       double crease_angle_rad, double plane_tolerance_m, double thin_m);
void crb_mesh_free(crb_mesh *mesh);
void crb_mesh_counts(const crb_mesh *mesh, crb_counts *counts);

/* Purpose  copy out the features.
 * Shapes   facet_of, patch_of [triangles]; facet_plane [facets][4]: unit normal and offset (normal . x = offset);
 *          facet_patch [facets]; facet_area_m2 [facets]. */
void crb_mesh_features(const crb_mesh *mesh, int32_t *facet_of, int32_t *patch_of, double *facet_plane,
                       int32_t *facet_patch, double *facet_area_m2);

/* Purpose  copy out the creases: edges whose normals differ by the crease angle or more.
 * Shapes   n = convex_edges + concave_edges; ends_m [n][2][3]; patch [n][2]; convex [n] (1 convex, 0 concave); angle_rad [n]. */
void crb_mesh_creases(const crb_mesh *mesh, double *ends_m, int32_t *patch, uint8_t *convex, double *angle_rad);

/* Purpose  exact signed distance (negative inside, by angle-weighted pseudo-normals) and nearest triangle of each point.
 * Shapes   points_m [n][3]; phi_m, triangle [n]. Neighbouring points should follow each other: each search starts from the
 *          last result. Thread-safe on one mesh.
 * Cost     about 1 us a point.   Source  Baerentzen, Aanaes 2005 (sign); Ericson 2004, 5.1.5 (point and triangle). */
void crb_signed_distance(const crb_mesh *mesh, const double *points_m, int64_t n, double *phi_m, int32_t *triangle);

/* Distances at the middles of a grid of boxes, from low_m on; phi_m [dims[2]][dims[1]][dims[0]], 0 where not yet known. */
typedef struct {
    double low_m[3], box_m;
    int32_t dims[3];
    double *phi_m;
} crb_known;

/* Parts of a tool's surface that are put together to convex pieces.
 * Shapes   centre_m, normal, inner_m (places a little below the surface) [count][3]; those beside part i are
 *          beside[beside_start[i]] to before beside[beside_start[i + 1]]. rise_max: sine of the elevation of one above the
 *          plane of another up to which both may be of one piece; ways between them must be below below_m; of the members of a
 *          piece every so many are asked, so that they are `witnesses` or up to twice as many. */
typedef struct {
    int32_t count, witnesses;
    const double *centre_m, *normal, *inner_m;
    const int32_t *beside_start, *beside;
    double rise_max, below_m;
} crb_parts;

/* Purpose  a convex piece round a part: what hangs together with it and agrees with all of it, nearest first.
 * Shapes   member [parts->count]: set to 1 for parts of the piece, else to 0. known: filled in as it is needed; the caller keeps it from call
 *          to call. Not for two threads at once.
 * Output   1, or 0 when memory ran out.   Cost  for each part looked at O(count), and for three points a witness 20 ns where a
 *          kept distance tells, else 1 us. */
int32_t crb_grow_piece(const crb_mesh *mesh, const crb_known *known, const crb_parts *parts, int32_t seed,
                       uint8_t *member);

/* Planes of a convex solid, or, where sign is -1, of the complement of one.
 * Shapes   plane [count][4]: unit normal outward and offset; count 1 to CRB_PLANES_MAX. */
#define CRB_PLANES_MAX 6
typedef struct {
    const double *plane;
    int32_t count;
    double sign;
} crb_planes;

/* Points of which the exact distances are known, in rows.
 * Shapes   points_m [][width][3]; phi_m [][width]. What planes give may be off by off_near_m nearer than near_m, else by off_far_m. */
typedef struct {
    const double *points_m, *phi_m;
    int64_t width;
    double near_m, off_near_m, off_far_m;
} crb_probes;

/* Purpose  signed distance from planes, as the tick has it in the cells of a crease.
 * Shapes   points_m [n][3]; phi_m [n].   Source  firmware/SPEC.md "Distance at a point". */
void crb_distance_from_planes(const crb_planes *planes, const double *points_m, int64_t n, double *phi_m);

/* Purpose  whether planes give the distances of all points of a row. No point is looked at behind the first that is off.
 * Shapes   rows [n] of the probes; agrees [n]: 1 or 0.   Cost  about 20 ns a point. */
void crb_planes_agree(const crb_planes *planes, const crb_probes *probes, const int64_t *rows, int64_t n,
                      uint8_t *agrees);

/* Purpose  mark the bricks of a grid that any triangle comes within reach_m of (per axis).
 * Shapes   origin_m [3]; dims [3]; near [dims[2]][dims[1]][dims[0]], set to 1 where marked, else unchanged. */
void crb_mark_bricks(const crb_mesh *mesh, const double *origin_m, double brick_m, const int32_t *dims, double reach_m,
                     uint8_t *near);

#endif
