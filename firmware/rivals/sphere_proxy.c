/* sphere_proxy: a copy of a round tool that stays outside. Ruspini, Kolarov, Khatib 1997.
 *
 * The tool's point shell at the proxy's place finds what surface is near. For a ball each find gives the foot of the centre on that
 * face, and the creases their nearest points: planes that the next step must not cross, exact on polyhedra. A tool that is no ball
 * keeps the device's attitude, and its samples give the planes. */
#include "rivals/rivals.h"

/* A tool is round when its box and its radius agree to this share. */
#define ROUND_SHARE 0.02f
/* A foot this share of a voxel off the surface lies on no face: it has passed an edge. Nearer ones may be on a curved face. */
#define OFF_SURFACE 0.5f

/* What is left to do in one group on the way down the sphere tree. */
typedef struct {
    uint32_t group, lanes;
} level;

static uint32_t lanes_near(const cr_respond_input *in, const xform *at_proxy, uint32_t group, float reach_m) {
    const struct cr_img_group *g = &in->field->scene->groups[group];
    cr_lanes3 world;
    cr_lookup at;
    uint32_t near = 0u;
    cr_lanes_to_world(at_proxy, g->x, g->y, g->z, &world);
    cr_field_look_up(in->field, &world, &at);
    for (uint32_t i = 0; i < g->count; i++) {
        near |= (uint32_t)(at.phi_m[i] - g->radius[i] < reach_m) << i;
    }
    return near;
}

/* Radius of a tool that is a ball about its origin, else 0: its box is as wide as the sphere that holds it, all three ways. */
static float ball_radius(const struct cr_img_meta *m) {
    for (int a = 0; a < 3; a++) {
        float high = m->tool_max_m[a], low = -m->tool_min_m[a];
        if (abs_f(high - m->tool_radius_m) > ROUND_SHARE * m->tool_radius_m ||
            abs_f(low - m->tool_radius_m) > ROUND_SHARE * m->tool_radius_m) {
            return 0.0f;
        }
    }
    return m->tool_radius_m;
}

static cr_vec3 gradient_of(const cr_lookup *at, uint32_t i) { return v3(at->gx[i], at->gy[i], at->gz[i]); }
static cr_vec3 place_of(const cr_lanes3 *l, uint32_t i) { return v3(l->x[i], l->y[i], l->z[i]); }

/* Moves each sample to the foot of the ball's centre on the plane below it. Returns the lanes whose foot is near enough to the
 * sample to lie on the same face; others are better placed for theirs. */
static uint32_t drop_centre(const cr_lookup *at, cr_vec3 centre, float most_m, cr_lanes3 *world) {
    uint32_t near = 0u;
    for (uint32_t i = 0; i < CR_LANES; i++) {
        cr_vec3 g = gradient_of(at, i), on = v3_mad(place_of(world, i), g, -at->phi_m[i]);
        cr_vec3 foot = v3_mad(centre, g, -v3_dot(v3_sub(centre, on), g));
        near |= (uint32_t)(v3_norm(v3_sub(foot, on)) <= most_m) << i;
        world->x[i] = foot.x;
        world->y[i] = foot.y;
        world->z[i] = foot.z;
    }
    return near;
}

static void add_point(cr_rival_planes *planes, cr_vec3 centre, float radius, cr_vec3 p) {
    cr_vec3 away = v3_sub(centre, p);
    cr_rival_add_plane(planes, v3_unit(away, 1e-9f), v3_norm(away) - radius);
}

/* The nearest point of every crease that the ball could reach in one step. */
static void add_edges(const cr_scene *s, cr_vec3 centre, float radius, float reach, cr_rival_planes *planes) {
    for (uint32_t e = 0; e < s->edge_count; e++) {
        cr_vec3 a = v3_from(s->edges[e].a_m), way = v3_sub(v3_from(s->edges[e].b_m), a), d = v3_sub(centre, a);
        float along = clamp_f(v3_dot(d, way) / max_f(v3_dot(way, way), 1e-20f), 0.0f, 1.0f);
        cr_vec3 p = v3_mad(a, way, along), away = v3_sub(centre, p);
        if (v3_dot(away, away) < (radius + reach) * (radius + reach)) {
            add_point(planes, centre, radius, p);
        }
    }
}

/* A ball: each sample near a face knows the foot of the centre there. Feet off the surface have passed an edge. */
static void add_feet(const cr_respond_input *in, cr_vec3 centre, float radius, const cr_lookup *at, uint32_t lanes,
                     cr_lanes3 *world, cr_rival_planes *planes) {
    const struct cr_img_meta *m = in->field->scene->meta;
    const float most_m = 2.0f * m->spacing_m + m->voxel_m;
    cr_lookup below;
    lanes &= drop_centre(at, centre, most_m, world);
    cr_field_look_up(in->field, world, &below);
    lanes &= ~(below.from_facet & below.bent);
    while (lanes != 0u) {
        uint32_t i = (uint32_t)take_lane(&lanes);
        cr_vec3 g = gradient_of(&below, i);
        if (abs_f(below.phi_m[i]) < OFF_SURFACE * m->voxel_m) {
            add_point(planes, centre, radius, v3_mad(place_of(world, i), g, -below.phi_m[i]));
        }
    }
}

static void add_cluster(const cr_respond_input *in, const xform *at_proxy, uint32_t cluster, cr_rival_planes *planes) {
    const struct cr_img_cluster *c = &in->field->scene->clusters[cluster];
    const float radius = ball_radius(in->field->scene->meta), reach = cr_rival_reach(in);
    cr_lanes3 world;
    cr_lookup at;
    uint32_t feet = 0u;
    cr_lanes_to_world(at_proxy, c->x, c->y, c->z, &world);
    cr_field_look_up(in->field, &world, &at);
    for (uint32_t i = 0; i < c->count; i++) {
        cr_vec3 normal = gradient_of(&at, i), sample = place_of(&world, i);
        if (!(at.phi_m[i] < reach)) {
            continue;
        }
        /* A centre that is inside has no nearest point to be pushed away from: the sample's plane serves. */
        float height = v3_dot(v3_sub(at_proxy->t, sample), normal) + at.phi_m[i];
        if (radius > 0.0f && height > 0.0f) {
            feet |= 1u << i;
        } else {
            cr_rival_add_plane(planes, normal, at.phi_m[i]);
        }
    }
    if (feet != 0u) {
        add_feet(in, at_proxy->t, radius, &at, feet, &world, planes);
    }
}

/* Planes of all samples within reach of the surface, down the sphere tree. */
static void find_planes(const cr_respond_input *in, const xform *at_proxy, cr_rival_planes *planes) {
    const cr_scene *s = in->field->scene;
    level stack[CR_TREE_DEPTH_MAX];
    int depth = 0;
    const float radius = ball_radius(s->meta), reach = cr_rival_reach(in);
    planes->count = 0u;
    if (radius > 0.0f) {
        add_edges(s, at_proxy->t, radius, reach, planes);
    }
    stack[0].group = 0u;
    stack[0].lanes = lanes_near(in, at_proxy, 0u, reach);
    while (depth >= 0) {
        level *v = &stack[depth];
        if (v->lanes == 0u) {
            depth--;
            continue;
        }
        const struct cr_img_group *g = &s->groups[v->group];
        uint32_t child = g->child[take_lane(&v->lanes)];
        if (g->leaf) {
            add_cluster(in, at_proxy, child, planes);
        } else {
            depth++;
            stack[depth].group = child;
            stack[depth].lanes = lanes_near(in, at_proxy, child, reach);
        }
    }
}

uint32_t cr_rival_sphere_proxy(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    const cr_vec3 device_m = in->world_from_tool->t;
    xform at_proxy = *in->world_from_tool;
    cr_rival_planes planes;
    (void)areas;
    cr_rival_start(in);
    for (int step = 0; step < CR_RIVAL_STEPS; step++) {
        at_proxy.t = in->proxy->pos_m;
        find_planes(in, &at_proxy, &planes);
        if (!cr_rival_step(in->proxy, device_m, &planes, cr_rival_reach(in))) {
            break;
        }
    }
    return room > 0u ? cr_rival_pull(in->proxy, device_m, out) : 0u;
}
