/* Rival libraries asked for the contact of two meshes, pose by pose: loaded by query.py.
 *
 * Answers  for each pose seven doubles: depth-weighted mean normal, out of the static object (3); depth of the deepest contact; contacts;
 *          least time of `repeat` queries in us; unused.
 * Shapes   vertices [count][3] double, triangles [count][3] int, poses [count][7]: x y z, quaternion w x y z. */
#ifndef PEERS_H
#define PEERS_H

#include <time.h>

#define PEERS_ANSWER 7

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
    const double *vertices;
    int vertex_count;
    const int *triangles;
    int triangle_count;
} peers_mesh;

/* Contacts of one query on the way to an answer. */
typedef struct {
    double normal_sum[3]; /* depth times normal */
    double deepest;
    int count;
} peers_contacts;

void peers_add(peers_contacts *c, const double normal[3], double depth);
void peers_answer(const peers_contacts *c, double least_us, double *out);

static inline double peers_now_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

void peers_ode(const peers_mesh *fixed, const peers_mesh *tool, const double *poses, int count, int repeat,
               double *out);
/* Both meshes have to be convex, and hold only the corners of their hulls. */
void peers_ccd(const peers_mesh *fixed, const peers_mesh *tool, const double *poses, int count, int repeat,
               double *out);
void peers_gimpact(const peers_mesh *fixed, const peers_mesh *tool, const double *poses, int count, int repeat,
                   double *out);

#ifdef __cplusplus
}
#endif

#endif
