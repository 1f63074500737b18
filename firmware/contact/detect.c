/* detect: which clusters of the shell reach into the static object, and what they touch there.
 *
 * Four levels of skipping, each conservative (DESIGN.md "Detect"): the whole tool against the top level, the sphere tree,
 * temporal coherence, and whole clusters that are certainly inside. Coverage is exactly 0 or 1 wherever a skip applies, so the
 * sums are the same to the bit with any of them switched off.
 *
 * A search that needs more work than a tick may do stops between two steps, and goes on where it stopped. Work is counted in lookups of 16 points;
 * what a cluster is inside of counts besides. */
#include "contact/stages.h"

/* Slack against rounding in positions, distances and odometers: 1e-6 of the lengths involved plus this. */
#define ROUNDING_M 2e-6f
/* Work, in parts of a unit: a step, whatever it does; a cluster that is asked for planes, one over cells of the image, beside its lookup, and one over planes,
 * beside each of them; a group of the tree that is woken, and that is entered; a leaf; spheres that are looked up, beside their lookup; a lighter zone. */
#define PARTS_OF_STEP 6u
#define PARTS_OF_AROUND 120u
#define PARTS_OF_CELLS 208u
#define PARTS_OF_POINTS 104u
#define PARTS_OF_PLANE 32u
#define PARTS_OF_WAKE 4u
#define PARTS_OF_GROUP 24u
#define PARTS_OF_SPHERES 64u
#define PARTS_OF_LEAF 1u
#define PARTS_OF_LIGHTENED 8u

void cr_motion_wake(cr_motion *m) {
    for (float *wake = m->wake_m, *end = wake + m->wake_count; wake < end; wake++) {
        *wake = CR_WAKE_NOW;
    }
    m->stale = 0u;
}

/* Everything one traversal reads and writes. */
typedef struct {
    const cr_field *field;
    const cr_scene *scene;
    const xform *pose;
    const cr_detect_options *options;
    cr_motion *motion;
    cr_descent *search;
    cr_contact_set *set;
    cr_stats *stats;
    float slack_out_m; /* how far a looked-up distance may be off outside the static object, plus rounding */
    float slack_in_m;  /* the same inside */
    float apart_m;     /* a plane this much lower than another does not matter */
} walk;

static void look_up(const walk *w, const cr_lanes3 *world, uint32_t lanes, cr_lookup *out) {
    cr_field_look_up_lanes(w->field, world, lanes, out);
    w->search->spent += PARTS_OF_SPHERES + out->parts;
}

static uint32_t lanes_where_below(const float *value, const float *limit) {
    uint32_t mask = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        mask |= (uint32_t)(value[i] < limit[i]) << i;
    }
    return mask;
}

cr_hit *cr_add_hit(cr_contact_set *set, uint32_t cluster, cr_stats *stats) {
    if (set->hit_count >= CR_CLUSTERS_MAX) {
        stats->clusters_dropped++;
        return NULL;
    }
    cr_hit *hit = &set->hits[set->hit_count++];
    hit->cluster = cluster;
    hit->planes = 0u;
    hit->facet = CR_FACET_NONE;
#ifdef CR_RIVALS
    hit->area = CR_HIT_NONE;
#endif
    return hit;
}

#ifdef CR_RIVALS
/* A cluster that is inside as a whole: rivals go by its middle. */
static void take_whole(walk *w, uint32_t cluster, const cr_batch *b, int lane) {
    const cr_vec3 middle = v3(b->world.x[lane], b->world.y[lane], b->world.z[lane]);
    cr_hit *hit = cr_add_hit(w->set, cluster, w->stats);
    if (hit == NULL) {
        return;
    }
    hit->covered = 0xffffu;
    hit->inside = 0xffffu;
    hit->near = (uint16_t)w->scene->clusters[cluster].crease_mask;
    w->set->contacts += w->scene->clusters[cluster].count;
    cr_touch_whole(w->field, hit, middle, &b->centres, lane, w->set, w->stats);
}
#endif

/* Ramps up to which a sample may be covered: farther at static corners, where there are any; rivals have none. */
static float reach_of(const walk *w) {
#ifdef CR_RIVALS
    return w->options->touches ? 1.0f : CR_CORNER_REACH;
#else
    (void)w;
    return CR_CORNER_REACH;
#endif
}

/* Smallest distance that any of 16 points still has to go before it is covered, from so many ramps on. */
static float smallest_clearance(const struct cr_img_cluster *c, const float *phi_m, float reach, float slack_m) {
    float clearance[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        clearance[i] = phi_m[i] - reach * c->ramp[i] - slack_m;
    }
    float least = clearance[0];
    for (int i = 1; i < CR_LANES; i++) {
        least = lower_f(least, clearance[i]);
    }
    return least;
}

/* The cluster in hand: over planes, or none when it was looked up. */
static cr_looked *take_in_hand(const walk *w, uint32_t cluster, const cr_planes *planes) {
    cr_in_hand *in = &w->search->in_hand;
    cr_looked *l = &in->looked;
    l->cluster = cluster;
    l->c = &w->scene->clusters[cluster];
    l->world = planes != NULL ? NULL : &in->world;
    l->at = planes != NULL ? NULL : &in->at;
    l->planes = planes;
    l->heights = planes != NULL ? &in->heights : NULL;
    l->coverage = in->coverage;
    return l;
}

/* The hit of a cluster with covered lanes, and what it is inside of. */
static void take_points(walk *w, const cr_looked *l, const cr_batch *b, int lane) {
#ifdef CR_RIVALS
    if (w->options->touches && l->full == first_lanes(l->c->count)) {
        take_whole(w, l->cluster, b, lane);
        return;
    }
    if (w->options->touches) {
        cr_touch_points(w->field, w->pose, l, w->set, w->stats);
        return;
    }
#else
    (void)b;
    (void)lane;
#endif
    CR_ASSERT(l->covered != 0u && (l->full & ~l->covered) == 0u && ((l->inside | l->near) >> l->c->count) == 0u);
    CR_ASSERT(w->set->hit_count == 0u || w->set->hits[w->set->hit_count - 1u].cluster < l->cluster);
    cr_hit *hit = cr_add_hit(w->set, l->cluster, w->stats);
    if (hit == NULL) {
        return;
    }
    hit->covered = (uint16_t)l->covered;
    hit->inside = (uint16_t)l->inside;
    hit->near = (uint16_t)l->near;
    w->set->contacts += cr_count_lanes(l->inside);
    cr_way_add(w->set, w->set->hit_count - 1u, l);
    w->search->hand = CR_HAND_ADDING;
}

/* More of what the last hit is inside of. */
static void add_next(walk *w) {
    cr_descent *s = w->search;
    const uint32_t hit = w->set->hit_count - 1u;
    s->hand = cr_way_add_more(w->field, w->pose, w->set, hit, &s->in_hand.looked) ? CR_HAND_EMPTY : CR_HAND_ADDING;
    s->spent += w->set->way.layers.parts;
}

/* Lanes whose piece may be inside where its middle is not: creases that come near, and covered faces. */
static uint32_t find_near(const struct cr_img_cluster *c, uint32_t reached, uint32_t covered, uint32_t inside) {
    return (reached & c->crease_mask) | (covered & ~inside & ~(uint32_t)(c->crease_mask | c->vertex_mask));
}

/* Coverage of the options; rivals have strips at static corners too. */
static uint32_t coverage_of(const walk *w) {
#ifdef CR_RIVALS
    return cr_coverage_of(w->options->coverage, w->options->touches);
#else
    return w->options->coverage;
#endif
}

static void look_up_points(walk *w, uint32_t cluster, uint32_t slot, int lane) {
    const struct cr_img_cluster *c = &w->scene->clusters[cluster];
    cr_in_hand *in = &w->search->in_hand;
    cr_lanes_to_world(w->pose, c->x, c->y, c->z, &in->world);
    cr_field_look_up(w->field, &in->world, &in->at);
    w->search->spent += PARTS_OF_CELLS + in->at.parts;
    in->slot = slot;
    in->lane = lane;
    w->search->hand = CR_HAND_LOOKED_UP;
}

/* What is covered of a cluster that was looked up. Returns how far the tool may move before it needs another look; 0 when it is in contact. */
static float cover_points(walk *w, uint32_t cluster, const cr_batch *b, int lane) {
    const struct cr_img_cluster *c = &w->scene->clusters[cluster];
    const uint32_t used = first_lanes(c->count);
    cr_in_hand *in = &w->search->in_hand;
    const cr_lookup *at = &in->at;
    const float *coverage = in->coverage;
    w->search->spent += CR_PARTS_OF_CUT * cr_cover(w->scene, w->pose, coverage_of(w), c, at, in->coverage);
    uint32_t covered = 0u, full = 0u, outside = 0u, near = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        covered |= (uint32_t)(coverage[i] > 0.0f) << i;
        full |= (uint32_t)(coverage[i] >= 1.0f) << i;
        outside |= (uint32_t)(at->phi_m[i] > 0.0f) << i;
        near |= (uint32_t)(at->phi_m[i] < c->reach[i]) << i;
    }
    covered &= used;
    if (covered == 0u) {
        return max_f(0.0f, smallest_clearance(c, at->phi_m, reach_of(w), w->slack_out_m));
    }
    cr_looked *l = take_in_hand(w, cluster, NULL);
    l->covered = covered;
    l->full = full & used;
    l->inside = ~outside & used;
    l->near = find_near(c, near, covered, ~outside);
    take_points(w, l, b, lane);
    return 0.0f;
}

/* Coverage of a lane that planes cut, in the mode of the options, and its distance. */
static float cover_cut_lane(const walk *w, const struct cr_img_cluster *c, const cr_planes *p, const cr_heights *h,
                            int i, float *phi_m) {
    const float top = h->top_m[i];
    float height[CR_KIND_FACETS_MAX], distance = top, share = (float)(top <= 0.0f);
    height[0] = top;
    if (p->count > 1u) {
        for (uint32_t k = 0; k < p->count; k++) {
            height[k] = h->height_m[k][i];
        }
        distance = cr_planes_distance(p, height, top);
    }
    if (w->options->coverage != CR_COVERAGE_HARD) {
        share = cr_cover_by_planes(p, c, i, height, top, distance);
    }
    *phi_m = distance * p->sign;
    return p->sign < 0.0f ? 1.0f - share : share;
}

/* A sphere is free until the tool has moved so far from here. */
static void let_sleep(const walk *w, uint32_t slot, float rho, float clearance_m) {
    w->motion->wake_m[slot] = w->motion->slide_m + w->motion->turn_rad * rho + clearance_m * 0.999999f;
}

/* A cluster and the sphere round it, in the tool frame. */
typedef struct {
    uint32_t cluster;
    cr_vec3 centre_m;
    float radius_m, margin_m, rho;
    float free_m; /* how far it may go where no static corner is near; 0 or less: not known */
} leaf;

/* The answer asks for each of several walls that meet concavely; a response of rivals/ for the nearest. */
static int asks_for_each(const walk *w) {
#ifdef CR_RIVALS
    return w->options->touches == 0u;
#else
    (void)w;
    return 1;
#endif
}

/* How far a cluster beside planes may go before a point of it is covered: as far as its margin nothing is known that reaches farther than this; beyond there may
 * be a corner. */
static float clearance_beside(const walk *w, const leaf *f, float reach, const float *phi_m) {
    const float least_m = smallest_clearance(&w->scene->clusters[f->cluster], phi_m, reach, w->slack_out_m);
    const float beyond_m = (reach_of(w) - reach) * f->margin_m;
    return max_f(0.0f, beyond_m > 0.0f ? max_f(min_f(least_m, f->margin_m), least_m - beyond_m) : least_m);
}

static float measure_points(walk *w, const leaf *f, float reach, const cr_batch *b, int lane) {
    const struct cr_img_cluster *c = &w->scene->clusters[f->cluster];
    const uint32_t used = first_lanes(c->count);
    cr_in_hand *in = &w->search->in_hand;
    cr_heights *h = &in->heights;
    float *coverage = in->coverage;
    const cr_planes *all = &w->search->planes;
    const int each = asks_for_each(w) && all->sign < 0.0f;
    const cr_planes *p = each ? all : cr_planes_alone(all, f->centre_m, f->radius_m, w->apart_m, &in->alone);
    cr_planes_measure(p, c, h);
    uint32_t full = (p->sign < 0.0f ? ~(h->below | h->cut) : h->below) & used, covered = full, inside = full,
             near = full;
    for (int i = 0; i < CR_LANES; i++) {
        coverage[i] = (full >> i) & 1u ? 1.0f : 0.0f;
    }
    const uint32_t cut = h->cut & used;
    w->search->spent +=
        PARTS_OF_POINTS +
        (PARTS_OF_PLANE + (p->reach > 1.0f ? 3u : 2u) * CR_PARTS_OF_CUT * cr_count_lanes(cut)) * p->count;
    for (uint32_t left = cut; left != 0u;) {
        const int i = take_lane(&left);
        float phi_m;
        coverage[i] = cover_cut_lane(w, c, p, h, i, &phi_m);
        covered |= (uint32_t)(coverage[i] > 0.0f) << i;
        full |= (uint32_t)(coverage[i] >= 1.0f) << i;
        inside |= (uint32_t)(phi_m <= 0.0f) << i;
        near |= (uint32_t)(phi_m < c->reach[i]) << i;
    }
    if (covered == 0u) {
        for (int i = 0; i < CR_LANES; i++) {
            coverage[i] = h->top_m[i] * p->sign;
        }
        return clearance_beside(w, f, reach, coverage);
    }
    cr_looked *l = take_in_hand(w, f->cluster, p);
    l->covered = covered;
    l->full = full;
    l->inside = inside;
    l->near = find_near(c, near, covered, inside);
    take_points(w, l, b, lane);
    return 0.0f;
}

/* A cluster over planes; one over cells is looked up, to be covered next. */
static void look_at_points(walk *w, const leaf *f, uint32_t slot, const cr_batch *b, int lane) {
    const cr_vec3 centre = v3(b->world.x[lane], b->world.y[lane], b->world.z[lane]);
    float found = 1.0f;
    const uint32_t kind = cr_planes_around(w->field, centre, f->radius_m + f->margin_m, &found);
    w->stats->points += w->scene->clusters[f->cluster].count;
    w->search->spent += PARTS_OF_AROUND;
    if (kind == 0u) {
        look_up_points(w, f->cluster, slot, lane);
        return;
    }
    cr_planes *planes = &w->search->planes;
    if (planes->kind != kind) {
        cr_planes_turn(w->scene, w->pose, kind, planes);
        planes->reach = lower_f(planes->reach, reach_of(w));
        w->search->spent += CR_PARTS_OF_CUT * planes->count;
    }
    const float reach = lower_f(found, reach_of(w));
    const float free_m = reach < reach_of(w) ? min_f(f->free_m, f->margin_m) : 0.0f;
    let_sleep(w, slot, f->rho, free_m > 0.0f ? free_m : measure_points(w, f, reach, b, lane));
}

/* Lanes of a group worth looking at: all but those that coherence knows to be free. */
static uint32_t find_awake(const walk *w, const struct cr_img_group *g, uint32_t group) {
    uint32_t mask = first_lanes(g->count);
    if (!(w->options->skip & CR_SKIP_COHERENCE)) {
        return mask;
    }
    const float *wake = w->motion->wake_m + (size_t)group * CR_LANES;
    float moved[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        moved[i] = w->motion->slide_m + w->motion->turn_rad * g->rho[i];
    }
    uint32_t asleep = lanes_where_below(moved, wake) & mask;
    w->stats->nodes_coherent += cr_count_lanes(asleep);
    return mask & ~asleep;
}

/* One leaf sphere that was looked at: free, whole, or to be looked at point by point. */
static void visit_cluster(walk *w, uint32_t slot, const cr_batch *b, int lane) {
    const struct cr_img_group *g = &w->scene->groups[slot / CR_LANES];
    const uint32_t at = slot % CR_LANES;
    leaf f;
    f.cluster = g->child[at];
    CR_ASSERT(g->leaf != 0u && at < g->count && f.cluster < w->scene->cluster_count && slot < w->motion->wake_count);
    f.centre_m = v3(g->x[at], g->y[at], g->z[at]);
    f.radius_m = g->radius[at];
    f.margin_m = g->margin[at];
    f.rho = g->rho[at];
    f.free_m = 0.0f;
    const float phi = b->centres.phi_m[lane], reach_m = f.radius_m + reach_of(w) * f.margin_m;
    if (w->options->skip & CR_SKIP_TREE) {
        const float clearance = phi - reach_m - w->slack_out_m;
        f.free_m = phi - f.radius_m - f.margin_m - w->slack_out_m;
        if (clearance > 0.0f) {
            let_sleep(w, slot, f.rho, clearance);
            return;
        }
        if (-phi > reach_m + w->slack_in_m) {
            w->stats->clusters_inside++;
#ifdef CR_RIVALS
            if (w->options->touches) {
                take_whole(w, f.cluster, b, lane);
                return;
            }
#endif
        }
    }
    look_at_points(w, &f, slot, b, lane);
}

/* Look the leaf spheres up that wait. */
static void look_up_waiting(walk *w) {
    cr_descent *s = w->search;
    const uint32_t count = s->waiting;
    cr_batch *b = &s->batch;
    CR_ASSERT(count > 0u && count <= CR_LANES && s->looked_up == 0u);
    for (uint32_t i = 0; i < CR_LANES; i++) {
        const uint32_t slot = s->slot[i < count ? i : 0u], lane = slot % CR_LANES;
        const struct cr_img_group *g = &w->scene->groups[slot / CR_LANES];
        b->world.x[i] = g->x[lane]; /* of the tool yet */
        b->world.y[i] = g->y[lane];
        b->world.z[i] = g->z[lane];
    }
    w->stats->nodes += count;
    cr_lanes_to_world(w->pose, b->world.x, b->world.y, b->world.z, &b->world);
    look_up(w, &b->world, first_lanes(count), &b->centres);
    s->looked_up = count;
    s->visited = 0u;
}

/* One of the leaf spheres that were looked up, in cluster order. */
static void visit_next(walk *w) {
    cr_descent *s = w->search;
    CR_ASSERT(s->visited < s->looked_up && s->looked_up == s->waiting);
    const int lane = (int)s->visited++;
    visit_cluster(w, s->slot[lane], &s->batch, lane);
    if (s->visited == s->looked_up) {
        s->waiting = s->looked_up = s->visited = 0u;
    }
}

/* What of the cluster that was looked up is covered. */
static void cover_next(walk *w) {
    cr_descent *s = w->search;
    const uint32_t slot = s->in_hand.slot;
    const struct cr_img_group *g = &w->scene->groups[slot / CR_LANES];
    const uint32_t at = slot % CR_LANES;
    s->hand = CR_HAND_EMPTY;
    let_sleep(w, slot, g->rho[at], cover_points(w, g->child[at], &s->batch, s->in_hand.lane));
}

/* Look at the spheres of an inner group: free lanes go to sleep; returns those to descend into. */
static uint32_t find_open(walk *w, uint32_t group, uint32_t lanes) {
    const struct cr_img_group *g = &w->scene->groups[group];
    if (lanes == 0u || !(w->options->skip & CR_SKIP_TREE)) {
        return lanes;
    }
    cr_lanes3 world;
    cr_lookup centres;
    w->stats->nodes += cr_count_lanes(lanes);
    cr_lanes_to_world(w->pose, g->x, g->y, g->z, &world);
    look_up(w, &world, lanes, &centres);
    for (uint32_t left = lanes; left != 0u;) {
        int i = take_lane(&left);
        float clearance = centres.phi_m[i] - g->radius[i] - reach_of(w) * g->margin[i] - w->slack_out_m;
        if (clearance > 0.0f) {
            let_sleep(w, group * CR_LANES + (uint32_t)i, g->rho[i], clearance);
            lanes &= ~(1u << i);
        }
    }
    return lanes;
}

/* One level down: the lanes of a group that are left to descend into, or leaves to be looked at. */
static void enter_group(walk *w, uint32_t group) {
    CR_ASSERT(group < w->scene->group_count && w->search->depth < CR_TREE_DEPTH_MAX);
    const struct cr_img_group *g = &w->scene->groups[group];
    cr_search_level *level = &w->search->stack[w->search->depth++];
    const uint32_t lanes = find_awake(w, g, group);
    w->search->spent += PARTS_OF_GROUP;
    level->group = group;
    level->lanes = g->leaf ? lanes : find_open(w, group, lanes);
}

/* Into the next child of the group in hand; leaf spheres wait until 16 of them are looked up together. */
static void descend(walk *w) {
    cr_descent *s = w->search;
    cr_search_level *level = &s->stack[s->depth - 1u];
    if (level->lanes == 0u) {
        s->depth--;
        return;
    }
    const struct cr_img_group *g = &w->scene->groups[level->group];
    if (g->leaf == 0u) {
        enter_group(w, g->child[take_lane(&level->lanes)]);
        return;
    }
    CR_ASSERT(s->waiting < CR_LANES && s->looked_up == 0u);
    while (level->lanes != 0u && s->waiting < CR_LANES) {
        s->slot[s->waiting++] = level->group * CR_LANES + (uint32_t)take_lane(&level->lanes);
        s->spent += PARTS_OF_LEAF;
    }
}

/* The root of the tree: once all spheres are awake, where they have to be. */
static void begin_next(walk *w) {
    cr_descent *s = w->search;
    if (w->motion->stale != 0u) {
        cr_motion_wake(w->motion);
        s->spent += PARTS_OF_WAKE * w->scene->group_count;
    } else {
        s->hand = CR_HAND_EMPTY;
        enter_group(w, 0u);
    }
}

static void go_on_in_hand(walk *w) {
    const uint32_t hand = w->search->hand;
    if (hand == CR_HAND_ADDING) {
        add_next(w);
    } else if (hand == CR_HAND_LOOKED_UP) {
        cover_next(w);
    } else {
        begin_next(w);
    }
}

/* Go on until nothing is left, or the work of a tick is done. Returns whether nothing is left. */
static int walk_on(walk *w) {
    cr_descent *s = w->search;
    while (s->spent / CR_WORK_PARTS < w->options->lookups_max) {
        s->spent += PARTS_OF_STEP;
        if (s->hand != CR_HAND_EMPTY) {
            go_on_in_hand(w);
        } else if (s->looked_up > 0u) {
            visit_next(w);
        } else if (s->waiting == CR_LANES || (s->depth == 0u && s->waiting > 0u)) {
            look_up_waiting(w);
        } else if (s->depth > 0u) {
            descend(w);
        } else {
            return 1;
        }
    }
    return s->depth == 0u && s->waiting == 0u && s->hand == CR_HAND_EMPTY;
}

static int tool_is_free(walk *w) {
    const struct cr_img_meta *m = w->scene->meta;
    float moved = w->motion->slide_m + w->motion->turn_rad * m->tool_radius_m;
    if ((w->options->skip & CR_SKIP_COHERENCE) && moved < w->motion->root_wake_m) {
        w->stats->nodes_coherent++;
        return 1;
    }
    if (!(w->options->skip & CR_SKIP_TOP)) {
        return 0;
    }
    cr_vec3 c = v3_add(xform_rotate(w->pose, v3_from(m->root_centre_m)),
                       w->pose->t); /* in line: each tick in free space asks */
    cr_lanes3 p;
    cr_lookup at;
    for (int i = 0; i < (CR_SCALAR ? 1 : CR_LANES); i++) {
        p.x[i] = c.x;
        p.y[i] = c.y;
        p.z[i] = c.z;
    }
    cr_field_look_up_lanes(w->field, &p, 1u, &at);
    w->stats->nodes++;
    float clearance = at.phi_m[0] - m->root_radius_m - reach_of(w) * m->ramp_max_m - w->slack_out_m;
    w->motion->root_wake_m = clearance > 0.0f ? moved + clearance * 0.999999f : CR_WAKE_NOW;
    return clearance > 0.0f;
}

/* The pose of this search has become too old: what was not seen is left out. */
static void give_up(walk *w) {
    cr_descent *s = w->search;
    w->stats->clusters_dropped += s->waiting - s->visited + (uint32_t)(s->hand != CR_HAND_EMPTY);
    w->set->hit_count -= (uint32_t)(s->hand == CR_HAND_ADDING);
    w->set->contacts -= s->hand == CR_HAND_ADDING ? cr_count_lanes(w->set->hits[w->set->hit_count].inside) : 0u;
    for (uint32_t i = 0; i < s->depth; i++) {
        w->stats->clusters_dropped += cr_count_lanes(s->stack[i].lanes);
    }
    s->depth = s->waiting = s->looked_up = s->visited = s->hand = 0u;
}

static void begin_search(cr_descent *search, cr_contact_set *set) {
    search->depth = search->waiting = search->looked_up = search->visited = 0u;
    search->calls = 0u;
    search->hand = CR_HAND_ROOT;
    search->planes.kind = 0u;
    set->way.dropped = set->way.layers.dropped = 0u;
    set->way.dropped_m3 = 0.0f;
#ifdef CR_RIVALS
    set->touch_count = 0u;
#endif
}

int cr_detect(const cr_field *field, const xform *pose, const cr_detect_options *options, cr_motion *motion,
              cr_descent *search, cr_contact_set *set, cr_stats *stats) {
    const float scale = abs_f(pose->t.x) + abs_f(pose->t.y) + abs_f(pose->t.z) + field->scene->meta->tool_radius_m;
    const float rounding = ROUNDING_M + 1e-6f * scale;
    walk w = {
        field, field->scene, pose, options, motion, search, set, stats, field->scene->meta->error_out_m + rounding,
        0.0f,  0.0f};
    search->spent = 0u;
    if (!search->open) {
        set->hit_count = set->contacts = set->way.count = 0u;
        if (tool_is_free(&w)) {
            return 1;
        }
        begin_search(search, set);
    }
    w.slack_in_m = field->scene->meta->error_in_m + rounding;
    w.apart_m = apart_of(field->scene->meta);
    search->open = !walk_on(&w);
    search->calls++;
    if (search->open && search->calls >= options->slices_max &&
        !(search->hand == CR_HAND_ADDING && set->way.layers.step > CR_WAY_ADD)) {
        give_up(&w);
        search->open = 0u;
    }
    if (!search->open && set->way.dropped > 0u) {
        cr_way_lighten(&set->way);
        search->spent += PARTS_OF_LIGHTENED * set->way.count;
    }
    CR_ASSERT(search->open || (search->depth == 0u && search->waiting == 0u && search->hand == CR_HAND_EMPTY));
    return !search->open;
}
