/* The samples of the held tool that are near the obstacle, and the planes that each is above: down the tree of spheres, by distance. */
#include "couple/follow_parts.h"

/* A gradient that is shorter tells no direction. */
#define NORMAL_MIN 0.1f

/* The gap of a place in the list that holds no sample, m. */
#define NO_SAMPLE_M 1e4f
/* A sample near the surface that is left out may be nearer than it was looked up by so many of the image's errors, root mean square: what is more is
 * seen a look late, and no deeper than the image is wrong. */
#define NEAR_ERRORS 2.0f
/* Cosine of a round surface's normal and the plane that it is held by, at least, and tangent, by which it falls away at most: of 20 degrees, by which facets turn that are no corner. */
#define FACES 0.94f
#define BENDS 0.36f
/* What a clearance loses to the rounding of odometers. */
#define CLEAR_SHARE 0.999999f

static void add_near(cr_couple_found *f, uint32_t key, cr_vec3 arm_m, float gap_m, cr_vec3 normal) {
    if (f->near_count == CR_COUPLE_NEAR_MAX) {
        f->dropped++;
        f->crowded = 1u;
        return;
    }
    cr_couple_near *n = &f->near[f->near_count / CR_LANES];
    const uint32_t i = f->near_count++ % CR_LANES;
    if (i == 0u) {
        static const cr_couple_near none = {{0.0f}, {0.0f}, {0.0f}, {0.0f}, {0.0f}, {0.0f}, {0.0f}, {0u}};
        *n = none;
        for (uint32_t k = 0; k < CR_LANES; k++) {
            n->gap_m[k] = NO_SAMPLE_M;
        }
    }
    n->normal_x[i] = normal.x;
    n->normal_y[i] = normal.y;
    n->normal_z[i] = normal.z;
    n->arm_x_m[i] = arm_m.x;
    n->arm_y_m[i] = arm_m.y;
    n->arm_z_m[i] = arm_m.z;
    n->gap_m[i] = gap_m;
    n->key[i] = key;
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

/* A plane for each wall that is near.   Output  whether there are any. */
static int add_walls(cr_couple_view *v, const cr_lookup *at, int i, cr_vec3 place, uint32_t key) {
    cr_couple_walls w;
    cr_couple_find_walls(v, at, i, place, &w);
    for (uint32_t k = 0; k < w.count; k++) {
        if (w.gap_m[k] < v->margin_m + v->slack_m) {
            add_near(v->found, key + k, v3_sub(place, v->middle), w.gap_m[k], w.normal[k]);
        } else {
            v->found->free_m = lower_f(v->found->free_m, w.gap_m[k] - v->slack_m);
        }
    }
    return w.count > 0u;
}

/* The one plane of a sample where no walls meet. Where it has none the tool may go no farther than the others were looked for. */
static void add_sample(cr_couple_view *v, uint32_t key, cr_vec3 place, float gap_m, cr_vec3 normal) {
    if (v3_dot(normal, normal) > 0.5f) {
        add_near(v->found, key, v3_sub(place, v->middle), gap_m, normal);
    } else {
        v->found->dropped++;
        v->found->free_m = lower_f(v->found->free_m, v->margin_m);
    }
}

/* Whether a sample of a surface that bends little faces away from its plane: that touches the tool elsewhere, and between facets a corner stands out beyond the
 * pieces beside it by a little, a ledge on which a ball of 1,280 triangles hung from an edge by 25 N instead of 2. What bends more may be the tip of a cone; and over a
 * static corner all that is near faces away from each of its planes. */
static int faces_away(const cr_couple_view *v, const struct cr_img_cluster *c, const cr_lookup *at, int i, cr_vec3 n) {
    const cr_field *f = v->field;
    return c->bow[i] > 0.0f && c->bow[i] < BENDS * c->ramp[i] &&
           n.x * c->ax[i] + n.y * c->ay[i] + n.z * c->az[i] > -FACES * c->area[i] &&
           !cr_is_corner(&f->scene->kinds[cr_field_kind(f, at, i)]);
}

/* Samples of a cluster. Where a piece's end, or a place between, is nearer than its middle, that stands for the sample.
 * Output   no piece of theirs is nearer, m; below 0 where one is inside. */
static float look_at_cluster(cr_couple_view *v, uint32_t cluster) {
    const struct cr_img_cluster *c = &v->field->scene->clusters[cluster];
    const uint32_t used = first_lanes(c->count);
    cr_couple_found *f = v->found;
    cr_lanes3 world, normal;
    cr_lookup at;
    uint32_t nearer;
    cr_lanes_to_world(&v->pose, c->x, c->y, c->z, &world);
    cr_couple_raise(v, c, &world);
    cr_field_look_up_lanes(v->field, &world, used, &at);
    v->lookups++;
    const float clear_m = cr_couple_find_lines(v, c, &at);
    if (clear_m >= v->margin_m) {
        f->free_m = lower_f(f->free_m, clear_m);
        return clear_m;
    }
    const uint32_t moved = cr_couple_nearest(v, c, &at, &world, &nearer, &normal);
    for (uint32_t left = used; left != 0u;) {
        const int i = take_lane(&left);
        if (at.phi_m[i] >= v->margin_m + v->slack_m) {
            const float reach = has_lane(moved, i) ? 0.0f : f->lines[i].reach_m;
            f->free_m = lower_f(f->free_m, at.phi_m[i] - reach - v->slack_m);
        } else if (i % (int)v->every != 0 && !has_lane(c->vertex_mask, i)) {
            f->dropped++;
        } else {
            const uint32_t key = (cluster * CR_LANES + (uint32_t)i) * CR_KIND_FACETS_MAX;
            const cr_vec3 p = lane_of(&world, i);
            if (!add_walls(v, &at, i, p, key)) {
                cr_vec3 n = has_lane(nearer, i) ? lane_of(&normal, i) : plane_of(v, c, &at, i);
                const cr_vec3 in_tool = xform_unrotate(&v->pose, n);
                if (faces_away(v, c, &at, i, in_tool)) {
                    continue;
                }
                float gap = has_lane(nearer, i) ? at.phi_m[i] : sharpen(v, &at, i, p, at.phi_m[i], &n);
                gap += has_lane(c->vertex_mask, i) ? cr_couple_yield(v->field->scene, c, i, in_tool) : 0.0f;
                add_sample(v, key, p, gap, n);
            }
        }
    }
    return clear_m;
}

/* How far any point below a lane of a group can have moved since its odometer began. */
static float moved_below(const cr_couple_found *f, const struct cr_img_group *g, int lane) {
    return f->slide_m + f->turn_rad * g->rho[lane];
}

/* What a lane of a group was found to be: free until the tool has moved so far; told by its samples, or by their sphere. */
static void remember(cr_couple_found *f, const struct cr_img_group *g, uint32_t group, int lane, float clear_m,
                     int by_points) {
    if (group < CR_COUPLE_GROUPS_MAX) {
        const uint32_t bit = 1u << lane, others = (uint32_t)f->by_points[group] & ~bit;
        f->wake_m[group * CR_LANES + (uint32_t)lane] = moved_below(f, g, lane) + higher_f(0.0f, clear_m) * CLEAR_SHARE;
        f->by_points[group] = (uint16_t)(by_points ? others | bit : others);
    }
}

/* Lanes of a group that may have come near since they were looked at. */
static uint32_t find_due(const cr_couple_view *v, const struct cr_img_group *g, uint32_t group) {
    cr_couple_found *f = v->found;
    uint32_t due = first_lanes(g->count);
    if (group < CR_COUPLE_GROUPS_MAX) {
        float clear_m[CR_LANES];
        for (int i = 0; i < CR_LANES; i++) {
            clear_m[i] = f->wake_m[group * CR_LANES + (uint32_t)i] - (f->slide_m + f->turn_rad * g->rho[i]);
        }
        for (uint32_t left = due; left != 0u;) {
            const int i = take_lane(&left);
            if (clear_m[i] >= v->margin_m) {
                f->free_m = lower_f(f->free_m, clear_m[i]);
                due &= ~(1u << i);
            }
        }
    }
    return due;
}

/* Children of a group that may be near. A cluster whose samples were looked at and are due again is not asked for its sphere. */
static uint32_t find_near_lanes(cr_couple_view *v, uint32_t group) {
    const struct cr_img_group *g = &v->field->scene->groups[group];
    const uint32_t due = find_due(v, g, group);
    uint32_t open = group < CR_COUPLE_GROUPS_MAX ? due & v->found->by_points[group] : 0u;
    const uint32_t asked = due & ~open;
    cr_lanes3 world;
    cr_lookup at;
    if (asked == 0u) {
        return open;
    }
    cr_lanes_to_world(&v->pose, g->x, g->y, g->z, &world);
    cr_field_look_up_lanes(v->field, &world, asked, &at);
    v->lookups++;
    for (uint32_t left = asked; left != 0u;) {
        const int i = take_lane(&left);
        const float clear_m = at.phi_m[i] - g->radius[i] - g->margin[i] - v->slack_far_m;
        if (clear_m >= v->margin_m) {
            remember(v->found, g, group, i, clear_m, 0);
            v->found->free_m = lower_f(v->found->free_m, clear_m);
        } else {
            open |= 1u << i;
        }
    }
    return open;
}

/* Odometers of the tool's way to a pose. Where they begin anew, or in another scene, all spheres are awake. */
static void advance(cr_couple_found *f, const cr_scene *s, const cr_pose *tool) {
    const uint32_t groups = s->group_count < CR_COUPLE_GROUPS_MAX ? s->group_count : CR_COUPLE_GROUPS_MAX;
    cr_motion m = {0};
    m.slide_m = f->slide_m;
    m.slide_lost_m = f->slide_lost_m;
    m.turn_rad = f->turn_rad;
    m.turn_lost_rad = f->turn_lost_rad;
    m.last = f->tool;
    m.valid = f->image == s->meta;
    m.wake_m = f->wake_m;
    m.wake_count = groups * CR_LANES;
    cr_motion_advance(&m, tool);
    if (m.stale != 0u) {
        cr_motion_wake(&m);
    }
    f->slide_m = m.slide_m;
    f->slide_lost_m = m.slide_lost_m;
    f->turn_rad = m.turn_rad;
    f->turn_lost_rad = m.turn_lost_rad;
    f->tool = *tool;
    f->image = s->meta;
}

void cr_couple_gather(cr_couple_view *v, const cr_pose *tool) {
    const cr_scene *s = v->field->scene;
    cr_couple_found *f = v->found;
    cr_search_level stack[CR_TREE_DEPTH_MAX];
    uint32_t depth = 1u;
    const struct cr_img_meta *m = s->meta;
    const cr_vec3 t = v->pose.t, at = f->centre.pos_m; /* one is told from the other */
    const float far = abs_f(t.x) + abs_f(t.y) + abs_f(t.z) + abs_f(at.x) + abs_f(at.y) + abs_f(at.z);
    const float rounding = 2e-6f + 1e-6f * (far + m->tool_radius_m);
    v->slack_m = NEAR_ERRORS * m->error_rms_m + rounding;
    v->slack_far_m = m->error_out_m + rounding;
    advance(f, s, tool);
    f->near_count = f->dropped = f->crowded = 0u;
    f->free_m = 1e4f;
    stack[0].group = 0u;
    stack[0].lanes = find_near_lanes(v, 0u);
    while (depth > 0u) {
        cr_search_level *level = &stack[depth - 1u];
        const struct cr_img_group *g = &s->groups[level->group];
        if (level->lanes == 0u) {
            depth--;
            continue;
        }
        const int lane = take_lane(&level->lanes);
        if (g->leaf) {
            const float clear_m = look_at_cluster(v, g->child[lane]);
            remember(f, g, level->group, lane, clear_m, clear_m < g->radius[lane]);
        } else {
            CR_ASSERT(depth < CR_TREE_DEPTH_MAX);
            stack[depth].group = g->child[lane];
            stack[depth].lanes = find_near_lanes(v, g->child[lane]);
            depth++;
        }
    }
}
