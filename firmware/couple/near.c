/* The samples of the held tool that are near the obstacle, and the planes that each is above: down the tree of spheres, by distance. */
#include "couple/follow_parts.h"

/* A gradient that is shorter tells no direction. */
#define NORMAL_MIN 0.1f

static void add_near(cr_couple_view *v, uint32_t key, cr_vec3 place, float phi_m, cr_vec3 normal) {
    if (v->count == CR_COUPLE_NEAR_MAX) {
        v->dropped++;
        return;
    }
    cr_couple_near *n = &v->near[v->count++];
    n->normal = normal;
    n->arm_m = v3_sub(place, v->middle);
    n->gap_m = phi_m;
    n->key = key;
}

/* The plane of a sample: along the distance; where that has no direction outside, as between two walls, against the tool's surface. Far inside there is none. */
static cr_vec3 plane_of(const cr_couple_view *v, const struct cr_img_cluster *c, const cr_lookup *at, int i) {
    const cr_vec3 n = v3_unit(v3(at->gx[i], at->gy[i], at->gz[i]), NORMAL_MIN);
    const cr_vec3 out = v3(c->ax[i], c->ay[i], c->az[i]);
    return v3_dot(n, n) > 0.5f || at->phi_m[i] <= 0.0f ? n
                                                       : v3_scale(xform_rotate(&v->pose, v3_unit(out, 0.0f)), -1.0f);
}

/* Height above the one facet that a sample's cell sees, where that is what was looked up but for the rounding of the image. */
static float sharpen(const cr_couple_view *v, const cr_lookup *at, int i, cr_vec3 place, float phi_m, cr_vec3 *normal) {
    const cr_scene *s = v->field->scene;
    const struct cr_img_kind *kind = &s->kinds[cr_field_kind(v->field, at, i)];
    if (kind->kind != (uint32_t)CR_KIND_PLANAR || kind->count != 1u || s->facets[kind->facet[0]].curved) {
        return phi_m;
    }
    const struct cr_img_facet *f = &s->facets[kind->facet[0]];
    const float height = v3_dot(v3_from(f->normal), place) - f->offset_m;
    const int same = abs_f(height - phi_m) <= s->meta->error_max_m + 8.0f * s->meta->quantum_m;
    *normal = same ? v3_from(f->normal) : *normal;
    return same ? height : phi_m;
}

/* A plane for each wall.   Output  whether there are any. */
static int add_walls(cr_couple_view *v, const cr_lookup *at, int i, cr_vec3 place, uint32_t key) {
    cr_couple_walls w;
    cr_couple_find_walls(v, at, i, place, &w);
    for (uint32_t k = 0; k < w.count; k++) {
        add_near(v, key + k, place, w.gap_m[k], w.normal[k]);
    }
    return w.count > 0u;
}

/* The one plane of a sample where no walls meet. Where it has none the tool may go no farther than the others were looked for. */
static void add_sample(cr_couple_view *v, uint32_t key, cr_vec3 place, float gap_m, cr_vec3 normal) {
    if (v3_dot(normal, normal) > 0.5f) {
        add_near(v, key, place, gap_m, normal);
    } else {
        v->left_out++;
        v->free_m = lower_f(v->free_m, v->margin_m);
    }
}

/* Samples of a cluster. Where a piece's end, or a place between, is nearer than its middle, that stands for the sample. */
static void look_at_cluster(cr_couple_view *v, uint32_t cluster) {
    const struct cr_img_cluster *c = &v->field->scene->clusters[cluster];
    const uint32_t used = first_lanes(c->count);
    cr_lanes3 world, normal;
    cr_lookup at;
    uint32_t nearer;
    cr_lanes_to_world(&v->pose, c->x, c->y, c->z, &world);
    cr_field_look_up_lanes(v->field, &world, used, &at);
    v->lookups++;
    const uint32_t moved = cr_couple_nearest(v, c, &at, used & ~(uint32_t)c->vertex_mask, &world, &nearer, &normal);
    if (nearer != 0u) {
        cr_field_look_up_lanes(v->field, &world, used, &at);
        v->lookups++;
    }
    for (uint32_t left = used; left != 0u;) {
        const int i = take_lane(&left);
        const cr_vec3 p = lane_of(&world, i);
        if (at.phi_m[i] >= v->margin_m + v->slack_m) {
            const cr_vec3 g = v3_unit(v3(at.gx[i], at.gy[i], at.gz[i]), NORMAL_MIN);
            const float reach = has_lane(moved, i) ? 0.0f : piece_reach(c, i, xform_unrotate(&v->pose, g));
            v->free_m = lower_f(v->free_m, at.phi_m[i] - reach - v->slack_m);
        } else if (i % (int)v->every != 0 && !has_lane(c->vertex_mask, i)) {
            v->left_out++;
        } else {
            const uint32_t key = (cluster * CR_LANES + (uint32_t)i) * CR_KIND_FACETS_MAX;
            if (!add_walls(v, &at, i, p, key)) {
                cr_vec3 n = has_lane(nearer, i) ? lane_of(&normal, i) : plane_of(v, c, &at, i);
                const float gap = has_lane(nearer, i) ? at.phi_m[i] : sharpen(v, &at, i, p, at.phi_m[i], &n);
                add_sample(v, key, p, gap, n);
            }
        }
    }
}

/* Children of a group that may be near. */
static uint32_t find_near_lanes(cr_couple_view *v, const struct cr_img_group *g) {
    const uint32_t used = first_lanes(g->count);
    const float slack = v->slack_m;
    cr_lanes3 world;
    cr_lookup at;
    uint32_t open = 0u;
    cr_lanes_to_world(&v->pose, g->x, g->y, g->z, &world);
    cr_field_look_up_lanes(v->field, &world, used, &at);
    v->lookups++;
    for (uint32_t left = used; left != 0u;) {
        const int i = take_lane(&left);
        const float clear = at.phi_m[i] - g->radius[i] - g->margin[i] - slack;
        if (clear < v->margin_m) {
            open |= 1u << i;
        } else {
            v->free_m = lower_f(v->free_m, clear);
        }
    }
    return open;
}

void cr_couple_gather(cr_couple_view *v) {
    const cr_scene *s = v->field->scene;
    cr_search_level stack[CR_TREE_DEPTH_MAX];
    uint32_t depth = 1u;
    const struct cr_img_meta *m = s->meta;
    const cr_vec3 t = v->pose.t;
    v->slack_m = m->error_out_m + 2e-6f + 1e-6f * (abs_f(t.x) + abs_f(t.y) + abs_f(t.z) + m->tool_radius_m);
    v->count = v->dropped = v->left_out = 0u;
    v->free_m = 1e4f;
    stack[0].group = 0u;
    stack[0].lanes = find_near_lanes(v, &s->groups[0]);
    while (depth > 0u) {
        cr_search_level *level = &stack[depth - 1u];
        const struct cr_img_group *g = &s->groups[level->group];
        if (level->lanes == 0u) {
            depth--;
            continue;
        }
        const int lane = take_lane(&level->lanes);
        if (g->leaf) {
            look_at_cluster(v, g->child[lane]);
        } else {
            CR_ASSERT(depth < CR_TREE_DEPTH_MAX);
            stack[depth].group = g->child[lane];
            stack[depth].lanes = find_near_lanes(v, &s->groups[g->child[lane]]);
            depth++;
        }
    }
}
