/* Where a surface passes through itself. */
#ifndef CR_INTERSECT_H
#define CR_INTERSECT_H

#include <stddef.h>
#include <stdint.h>

/* Purpose  find the pairs of triangles of which one's edge passes through the other. Inside or not is decided exactly.
 * Units    m. A passage shallower than tolerance_m does not count, so that touching surfaces are not reported.
 * Shapes   vertices[vertex_count * 3], triangles[triangle_count * 3], pairs[pairs_max * 2].
 * Output   number of pairs, of which the first pairs_max are written, in the same order on every run. Triangles that share an edge
 *          are not looked at, and overlaps inside one plane are not seen.
 * Errors   -1: out of memory.   Cost  O(n log n); 1 s for a million triangles of even size. */
int64_t cr_mesh_self_intersections(const double *vertices, const int32_t *triangles, size_t triangle_count,
                                   double tolerance_m, int32_t *pairs, size_t pairs_max);

#endif
