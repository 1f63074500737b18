/* Growing arrays, and a table of points by three numbers. */
#include "cuts.h"

#include <stdlib.h>
#include <string.h>

void *crx_enlarged(void *array, int64_t *room, size_t size) {
    *room = *room > 0 ? 2 * *room : 64;
    void *more = realloc(array, (size_t)*room * size);
    if (more == NULL) {
        free(array);
        *room = 0;
    }
    return more;
}

size_t crx_place_of(const point_table *t, const int32_t *key) {
    uint64_t hash = 0x9e3779b97f4a7c15u;
    for (int k = 0; k < 3; k++) {
        hash = (hash ^ (uint64_t)(uint32_t)key[k]) * 0xff51afd7ed558ccdu;
        hash ^= hash >> 32;
    }
    size_t at = (size_t)hash & (t->room - 1);
    while (t->slot[at].id >= 0 && memcmp(t->slot[at].key, key, sizeof t->slot[at].key) != 0) {
        at = (at + 1) & (t->room - 1);
    }
    return at;
}

static int reserve(point_table *t, size_t room) {
    point_table more = {malloc(room * sizeof *more.slot), room, t->used};
    if (more.slot == NULL) {
        return 0;
    }
    for (size_t i = 0; i < room; i++) {
        more.slot[i].id = -1;
    }
    for (size_t i = 0; i < t->room; i++) {
        if (t->slot[i].id >= 0) {
            more.slot[crx_place_of(&more, t->slot[i].key)] = t->slot[i];
        }
    }
    free(t->slot);
    *t = more;
    return 1;
}

static int32_t add_vertex(crx_cuts *c, const double *p) {
    if (!GROW(c->vertices, c->vertex_count, c->vertex_room)) {
        return -1;
    }
    memcpy(c->vertices[c->vertex_count], p, sizeof c->vertices[0]);
    return (int32_t)c->vertex_count++;
}

int32_t crx_vertex_of(crx_cuts *c, point_table *t, const int32_t *key, const double *p) {
    if (2 * (t->used + 1) > t->room && !reserve(t, t->room > 0 ? 2 * t->room : 256)) {
        return -1;
    }
    keyed_point *slot = &t->slot[crx_place_of(t, key)];
    if (slot->id < 0) {
        const int32_t id = add_vertex(c, p);
        if (id < 0) {
            return -1;
        }
        memcpy(slot->key, key, sizeof slot->key);
        slot->id = id;
        t->used++;
    }
    return slot->id;
}
