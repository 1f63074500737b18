/* Convex pieces of a tool's surface: what hangs together with a part of it and bends away from all of it. */
#include "mesh.h"

#include <stdlib.h>

#define KNOWN_ROOM 1e-6 /* of a box: above the rounding of distances between its points */
#define RISE_ROOM 1e-12 /* m: above the rounding of a height */
#define SIGHTS 3

/* Where on the way from one part to another it is asked whether the way is inside. */
static const double SIGHT[SIGHTS] = {0.25, 0.5, 0.75};

/* ---- below a distance: most points are far from the surface, and a distance known near them says enough ------------- */

static vec known_middle(const crb_known *k, const int32_t *box) {
    return (vec){k->low_m[0] + (box[0] + 0.5) * k->box_m, k->low_m[1] + (box[1] + 0.5) * k->box_m,
                 k->low_m[2] + (box[2] + 0.5) * k->box_m};
}

static int is_below(const crb_mesh *m, const crb_known *k, vec p, double below_m, int32_t *slot) {
    int32_t box[3];
    int within = 1;
    for (int a = 0; a < 3; a++) {
        const double at = (axis_of(p, a) - k->low_m[a]) / k->box_m;
        within = within && at >= 0.0 && at < (double)k->dims[a];
        box[a] = within ? (int32_t)at : 0;
    }
    if (within) {
        const vec middle = known_middle(k, box);
        double *phi_m = &k->phi_m[((int64_t)box[2] * k->dims[1] + box[1]) * k->dims[0] + box[0]];
        *phi_m = *phi_m == 0.0 ? crb_distance_at(m, middle, slot) : *phi_m;
        const double away_m = norm(sub(p, middle)) + KNOWN_ROOM * k->box_m;
        if (*phi_m + away_m < below_m || *phi_m - away_m >= below_m) {
            return *phi_m < below_m;
        }
    }
    return crb_distance_at(m, p, slot) < below_m;
}

/* ---- a piece grows ------------------------------------------------------------------------------------------------------ */

typedef struct {
    double far_m;
    int32_t part;
} reached;

static int by_distance(const void *a, const void *b) {
    const reached *p = a, *q = b;
    if (p->far_m != q->far_m) {
        return p->far_m > q->far_m ? 1 : -1;
    }
    return (p->part > q->part) - (p->part < q->part);
}

/* allowed: may become a member; front: members whose neighbours were not looked at; next: their neighbours. */
typedef struct {
    uint8_t *allowed;
    int32_t *front;
    reached *next;
    int32_t front_count, slot;
} growth;

static vec row_of(const double *rows, int64_t i) { return (vec){rows[3 * i], rows[3 * i + 1], rows[3 * i + 2]}; }

/* Only parts that may be of one piece with part i stay allowed: neither lies above the plane of the other. */
static void narrow(const crb_parts *p, int32_t i, uint8_t *allowed) {
    const vec at = row_of(p->centre_m, i), up = row_of(p->normal, i);
    for (int32_t j = 0; j < p->count; j++) {
        const vec way = sub(row_of(p->centre_m, j), at);
        const double here = dot(way, up), there = -dot(way, row_of(p->normal, j)), above = here > there ? here : there;
        allowed[j] = allowed[j] && above <= p->rise_max * norm(way) + RISE_ROOM;
    }
}

/* Whether straight lines from part i to members, to every so many of them, stay inside the tool. */
static int sees(const crb_mesh *m, const crb_known *k, const crb_parts *p, int32_t i, const uint8_t *member,
                int32_t *slot) {
    const vec from = row_of(p->inner_m, i);
    int32_t members = 0, seen = 0;
    for (int32_t j = 0; j < p->count; j++) {
        members += member[j];
    }
    const int32_t every = members / p->witnesses > 1 ? members / p->witnesses : 1;
    for (int32_t j = 0; j < p->count; j++) {
        if (!member[j] || seen++ % every != 0) {
            continue;
        }
        const vec way = sub(row_of(p->inner_m, j), from);
        for (int s = 0; s < SIGHTS; s++) {
            if (!is_below(m, k, add(from, mul(way, SIGHT[s])), p->below_m, slot)) {
                return 0;
            }
        }
    }
    return 1;
}

/* Parts beside the front that may become members, the nearest to the seed first. */
static int32_t find_next(const crb_parts *p, int32_t seed, const uint8_t *member, growth *g) {
    const vec from = row_of(p->centre_m, seed);
    int32_t count = 0;
    for (int32_t f = 0; f < g->front_count; f++) {
        const int32_t i = g->front[f];
        for (int32_t k = p->beside_start[i]; k < p->beside_start[i + 1]; k++) {
            const int32_t j = p->beside[k];
            if (g->allowed[j] == 1u && !member[j]) {
                g->allowed[j] = 2u; /* once */
                g->next[count++] = (reached){norm(sub(row_of(p->centre_m, j), from)), j};
            }
        }
    }
    for (int32_t n = 0; n < count; n++) {
        g->allowed[g->next[n].part] = 1u;
    }
    qsort(g->next, (size_t)count, sizeof *g->next, by_distance);
    return count;
}

static void grow_piece(const crb_mesh *m, const crb_known *k, const crb_parts *p, int32_t seed, growth *g,
                       uint8_t *member) {
    for (int32_t j = 0; j < p->count; j++) {
        member[j] = 0u;
        g->allowed[j] = 1u;
    }
    member[seed] = 1u;
    narrow(p, seed, g->allowed);
    g->front[0] = seed;
    g->front_count = 1;
    while (g->front_count > 0) {
        const int32_t count = find_next(p, seed, member, g);
        g->front_count = 0;
        for (int32_t n = 0; n < count; n++) {
            const int32_t i = g->next[n].part;
            if (g->allowed[i] && sees(m, k, p, i, member, &g->slot)) {
                member[i] = 1u;
                narrow(p, i, g->allowed);
                g->front[g->front_count++] = i;
            } else {
                g->allowed[i] = 0u;
            }
        }
    }
}

int32_t crb_grow_piece(const crb_mesh *mesh, const crb_known *known, const crb_parts *parts, int32_t seed,
                       uint8_t *member) {
    const size_t n = (size_t)parts->count;
    growth g = {malloc(n), malloc(n * sizeof(int32_t)), malloc(n * sizeof(reached)), 0, 0};
    const int32_t made = g.allowed != NULL && g.front != NULL && g.next != NULL;
    if (made) {
        grow_piece(mesh, known, parts, seed, &g, member);
    }
    free(g.allowed);
    free(g.front);
    free(g.next);
    return made;
}
