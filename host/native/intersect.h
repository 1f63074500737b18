/* Where a surface passes through itself. */
#ifndef CR_INTERSECT_H
#define CR_INTERSECT_H

#include <stddef.h>
#include <stdint.h>

/* Purpose  count the pairs of triangles of which one's edge passes through the other.
 * Units    m. A passage shallower than tolerance_m does not count, so that touching surfaces are not reported.
 * Shapes   vertices[vertex_count * 3], triangles[triangle_count * 3], first[2].
 * Output   number of pairs; first: one of them, untouched when there is none. Triangles that share an edge are not
 *          looked at, and overlaps inside one plane are not seen.
 * Errors   -1: out of memory.   Cost  O(n log n); 1 s for a million triangles of even size. */
int64_t cr_mesh_self_intersections(const double *vertices, const int32_t *triangles, size_t triangle_count,
                                   double tolerance_m, int32_t *first);

#endif
