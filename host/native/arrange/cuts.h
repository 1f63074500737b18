/* The arrangement from inside: its growing tables, and the triangulation of one triangle. All give 0 or less when memory ran out. */
#ifndef CRX_CUTS_H
#define CRX_CUTS_H

#include "arrange.h"
#include "exact.h"

#include <stddef.h>

/* Twice the room, at least 64 elements of size bytes; null, and nothing kept: out of memory. */
void *crx_enlarged(void *array, int64_t *room, size_t size);

/* Whether there is room for one more behind count, which may move the array. */
#define GROW(array, count, room)                                                                                       \
    ((count) < (room) || ((array) = crx_enlarged((array), &(room), sizeof *(array))) != NULL)

typedef struct {
    int32_t key[3], id;
} keyed_point;

typedef struct {
    keyed_point *slot; /* id -1: free */
    size_t room, used;
} point_table;

typedef struct {
    int32_t ends[2], of[2]; /* vertices, -1 when the two only touch; the two triangles */
} segment;

struct crx_cuts {
    const int32_t *corners; /* of the triangles given; not kept after crx_cut */
    double (*vertices)[3];
    int64_t vertex_count, vertex_room;
    int32_t (*pieces)[3], *parents;
    int64_t piece_count, piece_room, parent_room;
    int32_t *lines;
    int64_t line_count, line_room;
    int64_t failed;
    point_table on_edge;  /* key: edge (lower, higher vertex), triangle it passes through */
    point_table of_three; /* key: three triangles, ascending */
    segment *segments;    /* one for each pair */
    int64_t *first;       /* of the segments of each triangle in `mine` */
    int64_t *mine;        /* segment indices by triangle */
};

static inline const double *position(const crx_cuts *c, int32_t id) { return c->vertices[id]; }

/* ---- points.c: a table of points by three numbers ------------------------------------------------------------------- */

/* Slot of a key, or the free one where it belongs. */
size_t crx_place_of(const point_table *t, const int32_t *key);
/* The vertex of a key, made at p when it is new; -1: out of memory. */
int32_t crx_vertex_of(crx_cuts *c, point_table *t, const int32_t *key, const double *p);

/* ---- segments.c: what two triangles have in common ------------------------------------------------------------------ */

/* Segments of all pairs, and which of them belong to each triangle. */
int crx_find_segments(crx_cuts *c, size_t triangle_count, const int32_t *pairs, size_t pair_count);

/* ---- sheet.c: the pieces of one triangle, which grow --------------------------------------------------------------- */

typedef struct {
    int32_t ends[2], other; /* local vertices */
} line;

typedef struct {
    crx_cuts *cuts;
    int32_t parent;
    int32_t *id; /* vertex of each local one */
    double (*at)[2];
    int32_t (*tri)[3];
    line *lines;
    int64_t count, id_room, at_room, tri_count, tri_room, line_count, line_room;
    int axis[2]; /* coordinates that make its plane, counter-clockwise */
} sheet;

static inline int turn_of(const sheet *s, int32_t a, int32_t b, int32_t c) {
    return cr_exact_turn(s->at[a], s->at[b], s->at[c]);
}

/* Local number of a vertex, -1 when it has none. */
int32_t crx_local_of(const sheet *s, int32_t id);
int32_t crx_add_local(sheet *s, int32_t id);
int crx_add_triangle(sheet *s, int32_t a, int32_t b, int32_t c);
int crx_add_line(sheet *s, int32_t a, int32_t b, int32_t other);
/* Line with these ends, either way round; -1: none. */
int64_t crx_line_at(const sheet *s, int32_t a, int32_t b);
/* Triangle with the side a to b, and its third corner; -1: none. */
int64_t crx_side_at(const sheet *s, int32_t a, int32_t b, int32_t *third);
/* Vertex m comes between a and b, on both sides of that edge. */
int crx_split_edge(sheet *s, int32_t a, int32_t b, int32_t m);
/* A vertex inside; 0: nowhere, or on another one. */
int crx_insert_inside(sheet *s, int32_t m);

/* ---- enforce.c: an edge of the sheet where a line is --------------------------------------------------------------- */

typedef struct {
    int32_t *at;
    int64_t count, room;
} chain;

/* Corners that the way from a to b passes on either side, and the triangles between them. */
typedef struct {
    chain left, right;
    int64_t *crossed;
    int64_t crossed_count, crossed_room;
} way;

/* An edge from a to b, or edges through what lies on the way; marked as the line with triangle `other`. 0: failed. */
int crx_enforce(sheet *s, int32_t a, int32_t b, int32_t other, way *w);

#endif
