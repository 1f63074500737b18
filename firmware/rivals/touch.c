/* touch: what clusters in contact touch of the static surface, for the responses that go by touched areas. EXTENT.md "Zones and area normal". */
#include "contact/stages.h"

/* What the touches of one tick read and write. */
typedef struct {
    const cr_field *field;
    const cr_scene *scene;
    const xform *pose;
    cr_contact_set *set;
    cr_stats *stats;
    float reach_m; /* how far beside it the sample or cluster in hand touches other facets */
} touching;

/* The touch of this hit on the patch of facet, made when missing. */
static cr_touch *find_touch(touching *w, uint32_t first, uint32_t facet) {
    const struct cr_img_facet *facets = w->scene->facets;
    for (uint32_t t = first; t < w->set->touch_count; t++) {
        cr_touch *touch = &w->set->touches[t];
        if (touch->facet == facet) {
            return touch;
        }
        if (facets[touch->facet].patch == facets[facet].patch) {
            touch->mixed = 1u;
            return touch;
        }
    }
    if (w->set->touch_count >= CR_TOUCHES_MAX) {
        w->stats->touches_dropped++;
        return NULL;
    }
    cr_touch *touch = &w->set->touches[w->set->touch_count++];
    touch->hit = (uint16_t)(w->set->hit_count - 1u);
    touch->mixed = (uint16_t)(facets[facet].curved == CR_FACET_CURVED);
    touch->facet = facet;
    touch->area_m2 = 0.0f;
    touch->normal_sum_m2 = v3(0.0f, 0.0f, 0.0f);
    touch->point_sum_m3 = v3(0.0f, 0.0f, 0.0f);
    touch->tool_sum_m2 = v3(0.0f, 0.0f, 0.0f);
    return touch;
}

/* Facet of the static surface that a lane is nearest to, or CR_FACET_NONE away from the surface. */
static uint32_t facet_of_lane(const cr_field *f, const cr_lookup *at, int lane, cr_vec3 p) {
    const cr_scene *s = f->scene;
    if ((at->from_facet >> lane) & 1u) {
        return at->facet[lane];
    }
    const struct cr_img_kind *kind = &s->kinds[cr_field_kind(f, at, lane)];
    if (kind->count < 2u) {
        return kind->count == 1u ? kind->facet[0] : CR_FACET_NONE;
    }
    /* Mixed: the facet whose plane passes nearest and faces the way the distance grows. */
    uint32_t best = kind->facet[0];
    float best_cost = 3.4e38f;
    cr_vec3 g = v3(at->gx[lane], at->gy[lane], at->gz[lane]);
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *plane = &s->facets[kind->facet[k]];
        float off = abs_f(v3_dot(v3_from(plane->normal), p) - plane->offset_m - at->phi_m[lane]);
        float cost = off + (1.0f - v3_dot(v3_from(plane->normal), g)) * s->meta->voxel_m;
        if (cost < best_cost) {
            best_cost = cost;
            best = kind->facet[k];
        }
    }
    return best;
}

static void add_to_touch(cr_touch *touch, float area_m2, cr_vec3 normal, cr_vec3 surface) {
    touch->area_m2 += area_m2;
    touch->normal_sum_m2 = v3_mad(touch->normal_sum_m2, normal, area_m2);
    touch->point_sum_m3 = v3_mad(touch->point_sum_m3, surface, area_m2);
}

/* The other facets that meet in the lane's crease cell, the more the nearer they are: a zone that is inside the tool between its
 * samples must be known, or the normal could not turn towards it. */
static void touch_beside(touching *w, uint32_t first, const cr_lookup *at, int lane, cr_vec3 p_world, float area_m2) {
    const struct cr_img_kind *kind = &w->scene->kinds[at->kind[lane]];
    const float per_reach = 1.0f / max_f(w->reach_m, 1e-9f);
    for (uint32_t k = 0; k < kind->count; k++) {
        if (kind->facet[k] == at->facet[lane]) {
            continue;
        }
        const struct cr_img_facet *facet = &w->scene->facets[kind->facet[k]];
        cr_vec3 normal = v3_from(facet->normal);
        float height = v3_dot(normal, p_world) - facet->offset_m;
        float part = 1.0f - abs_f(height - at->phi_m[lane]) * per_reach;
        if (part <= 0.0f) {
            continue;
        }
        cr_touch *touch = find_touch(w, first, kind->facet[k]);
        if (touch != NULL) {
            add_to_touch(touch, area_m2 * part, normal, v3_mad(p_world, normal, -height));
        }
    }
}

/* What is deeper inside than a sample is wide tells less and less of the surface: half-way between two faces the nearest changes at
 * once. */
static float part_told(float spacing_m, float phi_m) {
    float deeper = -(phi_m + spacing_m);
    return deeper > 0.0f ? spacing_m * spacing_m / (spacing_m * spacing_m + deeper * deeper) : 1.0f;
}

/* Tool surface of area_m2 at p is next to the static surface: note which, with its normal and nearest point. */
static void touch_surface(touching *w, uint32_t first, const cr_lookup *at, int lane, cr_vec3 p_world, float area_m2,
                          cr_vec3 area_tool) {
    uint32_t index = facet_of_lane(w->field, at, lane, p_world);
    if (index == CR_FACET_NONE) {
        return;
    }
    const struct cr_img_facet *facet = &w->scene->facets[index];
    cr_vec3 gradient = v3(at->gx[lane], at->gy[lane], at->gz[lane]);
    cr_vec3 normal = facet->curved == CR_FACET_CURVED ? v3_unit(gradient, 1e-3f) : v3_from(facet->normal);
    cr_touch *touch = find_touch(w, first, index);
    if (touch == NULL) {
        return;
    }
    area_m2 *= part_told(w->scene->meta->spacing_m, at->phi_m[lane]);
    add_to_touch(touch, area_m2, normal, v3_mad(p_world, gradient, -at->phi_m[lane]));
    touch->tool_sum_m2 = v3_add(touch->tool_sum_m2, area_tool);
    if ((at->from_facet >> lane) & 1u) {
        touch_beside(w, first, at, lane, p_world, area_m2);
    }
}

/* Lanes of `among` that are beside `seed`, or beside those, and so on. */
static uint32_t connected_lanes(const struct cr_img_cluster *c, uint32_t seed, uint32_t among) {
    uint32_t found = seed, fresh = seed;
    while (fresh != 0u && found != among) {
        uint32_t next = c->beside[take_lane(&fresh)] & among & ~found;
        found |= next;
        fresh |= next;
    }
    return found;
}

/* The one planar facet that all these lanes are over, or CR_FACET_NONE. */
static uint32_t common_facet(const touching *w, const cr_looked *l, uint32_t lanes) {
    const cr_scene *s = w->scene;
    uint32_t common = CR_FACET_NONE, plain = CR_TOP_FAR; /* plain: the last brick that has one kind for all of it */
    if ((lanes & l->at->from_facet) != 0u) {
        return CR_FACET_NONE;
    }
    while (lanes != 0u) {
        int i = take_lane(&lanes);
        uint32_t entry = l->at->entry[i];
        if (entry == plain) {
            continue;
        }
        const struct cr_img_kind *kind = &s->kinds[cr_field_kind(w->field, l->at, i)];
        uint32_t facet = kind->facet[0];
        if (kind->count != 1u || s->facets[facet].curved == CR_FACET_CURVED ||
            (common != CR_FACET_NONE && facet != common)) {
            return CR_FACET_NONE;
        }
        common = facet;
        plain = s->bricks[entry].cells == CR_CELLS_NONE ? entry : plain;
    }
    return common;
}

/* Part of a hit that is over one planar facet, by its sums: points project onto the plane all alike. */
static void touch_plane(touching *w, uint32_t first, uint32_t facet, const struct cr_img_sum *sum) {
    const struct cr_img_facet *plane = &w->scene->facets[facet];
    cr_touch *touch = find_touch(w, first, facet);
    if (touch == NULL) {
        return;
    }
    cr_vec3 normal = v3_from(plane->normal);
    cr_vec3 points = v3_mad(xform_rotate(w->pose, v3(sum->px, sum->py, sum->pz)), w->pose->t, sum->area);
    float height = v3_dot(normal, points) - plane->offset_m * sum->area;
    float told = part_told(w->scene->meta->spacing_m, height / max_f(sum->area, 1e-20f));
    add_to_touch(touch, told * sum->area, normal, v3(0.0f, 0.0f, 0.0f));
    touch->point_sum_m3 = v3_mad(touch->point_sum_m3, v3_mad(points, normal, -height), told);
    touch->tool_sum_m2 = v3_add(touch->tool_sum_m2, v3(sum->ax, sum->ay, sum->az));
}

/* How far from its nearest facet a lane touches others: a crease or corner of the tool is as wide as its ramp; a face between samples
 * reaches into all of a crease cell. */
static float reach_of_lane(const touching *w, const struct cr_img_cluster *c, int lane) {
    return ((c->crease_mask | c->vertex_mask) >> lane) & 1u ? c->ramp[lane] : w->scene->meta->crease_m;
}

/* Lanes at or near the highest plane of which is plane k: those at less than their reach below. */
static uint32_t lanes_at_plane(const touching *w, const cr_looked *l, uint32_t k, uint32_t lanes) {
    const float *height = l->heights->height_m[k], *top = l->heights->top_m;
    uint32_t at = 0u;
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        at |= (uint32_t)(top[i] - height[i] < reach_of_lane(w, l->c, i)) << i;
    }
    return at;
}

/* Sums over lanes at a plane: the less of a lane the lower the plane lies below its highest. Its area vector faces that alone. */
static struct cr_img_sum sum_at_plane(const touching *w, const cr_looked *l, uint32_t k, uint32_t lanes) {
    const struct cr_img_cluster *c = l->c;
    struct cr_img_sum sum = {0};
    const float *height = l->heights->height_m[k], *top = l->heights->top_m;
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        float share = l->coverage[i], area = share * c->area[i];
        area *= 1.0f - (top[i] - height[i]) / max_f(reach_of_lane(w, c, i), 1e-9f);
        sum.area += area;
        sum.px += area * c->x[i];
        sum.py += area * c->y[i];
        sum.pz += area * c->z[i];
        if ((l->heights->highest[k] >> i) & 1u) {
            sum.ax += share * c->ax[i];
            sum.ay += share * c->ay[i];
            sum.az += share * c->az[i];
        }
    }
    return sum;
}

/* What a hit touches of the planes it lies at: of each lane the highest, and others as far as they come near that. */
static void touch_planes(touching *w, const cr_looked *l, const cr_hit *hit, uint32_t lanes) {
    const uint32_t first = w->set->touch_count;
    for (uint32_t k = 0; k < l->planes->count; k++) {
        if ((lanes & ~l->heights->highest[k]) == 0u) {
            touch_plane(w, first, l->planes->facet[k], &hit->sum);
            continue;
        }
        const uint32_t at = lanes_at_plane(w, l, k, lanes);
        if (at != 0u) {
            const struct cr_img_sum sum = sum_at_plane(w, l, k, at);
            touch_plane(w, first, l->planes->facet[k], &sum);
        }
    }
}

/* What a hit touches, lane by lane as it was looked up. */
static void touch_looked_up(touching *w, const cr_looked *l, const cr_hit *hit, uint32_t lanes) {
    const uint32_t first = w->set->touch_count, facet = common_facet(w, l, lanes);
    if (facet != CR_FACET_NONE) {
        touch_plane(w, first, facet, &hit->sum);
        return;
    }
    while (lanes != 0u) {
        int i = take_lane(&lanes);
        cr_vec3 area_tool = v3_scale(v3(l->c->ax[i], l->c->ay[i], l->c->az[i]), l->coverage[i]);
        cr_vec3 p_world = v3(l->world->x[i], l->world->y[i], l->world->z[i]);
        w->reach_m = reach_of_lane(w, l->c, i);
        touch_surface(w, first, l->at, i, p_world, l->c->area[i] * l->coverage[i], area_tool);
    }
}

/* The hit of some covered lanes of a cluster that hang together. */
static void take_lanes(touching *w, const cr_looked *l, uint32_t lanes) {
    cr_hit *hit = cr_add_hit(w->set, l->cluster, w->stats);
    if (hit == NULL) {
        return;
    }
    uint32_t around = lanes;
    float some[CR_LANES];
    for (int i = 0; i < CR_LANES && lanes != l->covered; i++) {
        some[i] = (lanes >> i) & 1u ? l->coverage[i] : 0.0f;
    }
    for (uint32_t left = lanes; left != 0u && (l->near & ~around) != 0u;) {
        around |= l->c->beside[take_lane(&left)];
    }
    hit->covered = (uint16_t)lanes;
    hit->inside = (uint16_t)(l->inside & lanes);
    hit->near = (uint16_t)(l->near & around);
    cr_sum_cluster(l->c, lanes == l->covered ? l->coverage : some, &hit->sum);
    w->set->contacts += cr_count_lanes(hit->inside);
    if (l->planes != NULL) {
        hit->planes = (uint16_t)l->planes->kind;
        touch_planes(w, l, hit, lanes);
    } else {
        touch_looked_up(w, l, hit, lanes);
    }
}

void cr_touch_points(const cr_field *field, const xform *pose, const cr_looked *l, cr_contact_set *set,
                     cr_stats *stats) {
    touching w = {field, field->scene, pose, set, stats, 0.0f};
    for (uint32_t left = l->covered; left != 0u;) {
        uint32_t lanes = connected_lanes(l->c, left & (~left + 1u), left);
        take_lanes(&w, l, lanes);
        left &= ~lanes;
    }
}

void cr_touch_whole(const cr_field *field, cr_hit *hit, cr_vec3 middle, const cr_lookup *at, int lane,
                    cr_contact_set *set, cr_stats *stats) {
    touching w = {field, field->scene, NULL, set, stats, field->scene->meta->crease_m};
    hit->sum = field->scene->sums[hit->cluster];
    if (abs_f(at->phi_m[lane]) < field->scene->meta->band_m) {
        touch_surface(&w, set->touch_count, at, lane, middle, hit->sum.area, v3(hit->sum.ax, hit->sum.ay, hit->sum.az));
    }
}
