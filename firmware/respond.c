/* respond: from zones to normal, contact plane and depth of each area. DESIGN.md "Zones and area normal".
 *
 * Weights of the zones by cone decomposition, plane, depth and splitting at concave creases are the same for every response; a
 * response may turn the normal. The method as published (hard coverage) has its own path. */
#include "stages.h"
#ifdef CR_RIVALS
#include "rivals/rivals.h"
#endif

/* Pull of a zone's weight to the tool area facing it: breaks ties between dependent zones; larger biases the direction. */
#define PULL_FACING 1e-3f
/* Pull to zero on a zone that less than about one sample sees, so that it appears and leaves with weight zero. */
#define PULL_UNSEEN 0.05f
/* A curved zone may turn the normal this many standard deviations away from its mean. */
#define SPREAD_REACH 2.5f
/* A piece has to land this close to the surface, beside the error of the distances, to count as inside. */
#define LANDING_M 1e-6f
/* Rounding of heights near the origin; elsewhere it grows with the offset. */
#define ROUNDING_M 1e-8f
/* Part of a face sample's piece, from its middle to its border, that is certainly on the tool whatever the piece's shape: the half
 * width of a triangle, by its second moment, reaches 1.22 times as far as its border. */
#define FACE_PART 0.8f
/* A piece of face that is entered beside its sample counts in full from this coverage on: it comes and goes gently. */
#define FACE_FULL 0.125f
/* Sweeps over the zones' planes to find their common point; two planes at 30 degrees converge by 0.75 a sweep. */
#define COMMON_POINT_SWEEPS 24
/* Share of closed surface below which an area has no direction: the tool is wholly inside. */
#define OPEN_MIN 0.01f

/* A zone's part in the contact plane: generator vector (length = area) and offset of its plane times that length. */
typedef struct {
    cr_vec3 vector_m2[CR_ZONES_MAX];
    float offset_m3[CR_ZONES_MAX];
    float alpha[CR_ZONES_MAX];
} weights;

static float dot_zone(const cr_area_work *a, uint32_t i, cr_vec3 v) { return v3_dot(a->zones[i].normal_world, v); }

/* Cone decomposition: s = sum alpha_i n_i, alpha_i >= 0, least squares. Where zones are dependent (parallel, or more than three)
 * a weak pull to the tool area that faces each zone picks the solution; a pull to zero acts on zones that hardly any sample
 * sees, so that they come and go continuously. Projected Gauss-Seidel. */
static void weigh_by_cone(const cr_respond_input *in, const cr_area_work *a, cr_vec3 s, float *alpha) {
    float rarity[CR_ZONES_MAX], facing[CR_ZONES_MAX], seen = 0.0f, h = in->field->scene->meta->spacing_m;
    cr_vec3 left = s;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        seen += a->zones[i].area_m2;
    }
    for (uint32_t i = 0; i < a->zone_count; i++) {
        float rare = min_f(h * h, seen) / a->zones[i].area_m2;
        rarity[i] = PULL_UNSEEN * rare * rare;
        cr_vec3 flux = xform_rotate(in->world_from_tool, a->shapes[i].tool_sum_m2);
        facing[i] = alpha[i] = max_f(0.0f, -dot_zone(a, i, flux));
        left = v3_mad(left, a->zones[i].normal_world, -alpha[i]);
    }
    for (int sweep = 0; sweep < CR_SWEEPS_MAX; sweep++) {
        float moved = 0.0f;
        for (uint32_t i = 0; i < a->zone_count; i++) {
            float pull = PULL_FACING * (facing[i] - alpha[i]) - rarity[i] * alpha[i];
            float step = (dot_zone(a, i, left) + pull) / (1.0f + PULL_FACING + rarity[i]);
            float next = max_f(0.0f, alpha[i] + step);
            left = v3_mad(left, a->zones[i].normal_world, alpha[i] - next);
            moved = max_f(moved, abs_f(next - alpha[i]));
            alpha[i] = next;
        }
        if (moved <= 1e-6f * a->sum.area) {
            break;
        }
    }
}

/* Normal of a group of zones, given the one from the cone decomposition. */
typedef cr_vec3 (*turn_fn)(const cr_area_work *area, const float *share, cr_vec3 n);

static cr_vec3 keep_normal(const cr_area_work *a, const float *share, cr_vec3 n) {
    (void)a;
    (void)share;
    return n;
}

/* The method [1] is compared with: at a corner every zone counts the same, 45 degrees at a right-angled edge. The penetration is
 * that of the zones, so that only the direction differs. */
static cr_vec3 turn_to_45(const cr_area_work *a, const float *share, cr_vec3 n) {
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f);
    for (uint32_t i = 0; i < a->zone_count; i++) {
        sum = share[i] > 0.0f ? v3_add(sum, a->zones[i].normal_world) : sum;
    }
    float length = v3_norm(sum);
    return length > 1e-3f ? v3_scale(sum, 1.0f / length) : n;
}

/* A response of its own: all areas at once, nothing shared with the zone method. */
typedef uint32_t (*answer_fn)(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* The response table: config->response selects a row. */
static const struct {
    turn_fn turn;
    uint32_t as_published; /* 1: hard coverage selects the method to the letter of [1] */
    answer_fn answer;      /* not null: this instead */
} responses[CR_RESPONSE_COUNT] = {
    [CR_RESPONSE_ZONES] = {keep_normal, 1u, NULL},
    [CR_RESPONSE_FIXED45] = {turn_to_45, 0u, NULL},
#ifdef CR_RIVALS
    [CR_RESPONSE_VOXMAP] = {NULL, 0u, cr_rival_voxmap},
    [CR_RESPONSE_DISTANCE_FIELD] = {NULL, 0u, cr_rival_distance_field},
    [CR_RESPONSE_DEEPEST_GROUP] = {NULL, 0u, cr_rival_deepest_group},
    [CR_RESPONSE_OVERLAP] = {NULL, 0u, cr_rival_overlap},
    [CR_RESPONSE_NORMAL_GROUPS] = {NULL, 0u, cr_rival_normal_groups},
    [CR_RESPONSE_GOD_OBJECT] = {NULL, 0u, cr_rival_god_object},
    [CR_RESPONSE_SPHERE_PROXY] = {NULL, 0u, cr_rival_sphere_proxy},
#endif
};

/* W v for one lane. */
static cr_vec3 spread_times(const struct cr_img_cluster *c, int lane, cr_vec3 v) {
    return v3(c->wxx[lane] * v.x + c->wxy[lane] * v.y + c->wzx[lane] * v.z,
              c->wxy[lane] * v.x + c->wyy[lane] * v.y + c->wyz[lane] * v.z,
              c->wzx[lane] * v.x + c->wyz[lane] * v.y + c->wzz[lane] * v.z);
}

/* Where a piece of crease whose end is just outside crosses the static surface: the way down is along W g, W the second moment of
 * the piece, which points along it. Returns 0 when that is further than the piece reaches. */
static int clip_to_surface(const struct cr_img_cluster *c, const cr_lookup *at, const xform *pose, int lane,
                           cr_vec3 *p_world) {
    cr_vec3 g = xform_unrotate(pose, v3(at->gx[lane], at->gy[lane], at->gz[lane]));
    cr_vec3 way = spread_times(c, lane, g);
    float fall = v3_dot(way, g), phi = at->phi_m[lane], reach = c->reach[lane];
    if (!(phi * phi * v3_dot(way, way) < reach * reach * fall * fall)) {
        return 0;
    }
    *p_world = v3_mad(*p_world, xform_rotate(pose, way), -phi / fall);
    return 1;
}

/* Lowest point along n of a straight piece of crease, as far as it is inside: an end, or where it crosses the surface. */
static int lowest_of_crease(const struct cr_img_cluster *c, const cr_lookup *at, const xform *pose, int lane,
                            cr_vec3 n_tool, cr_vec3 *p_world) {
    cr_vec3 way = spread_times(c, lane, n_tool);
    cr_vec3 down = v3_scale(v3_unit(way, 0.0f), -c->reach[lane]);
    cr_vec3 g = xform_unrotate(pose, v3(at->gx[lane], at->gy[lane], at->gz[lane]));
    float phi = at->phi_m[lane], rise = v3_dot(g, down);
    float part = phi + rise <= 0.0f ? 1.0f : -phi / rise;
    if (!(part >= -1.0f && part <= 1.0f)) {
        return 0;
    }
    *p_world = v3_mad(*p_world, xform_rotate(pose, down), part);
    return 1;
}

static cr_vec3 lane_of(const cr_lanes3 *l, int i) { return v3(l->x[i], l->y[i], l->z[i]); }

/* Facet patch that a lane is on, for zones that need their own lanes. */
static int lane_is_on(const cr_field *f, const cr_lookup *at, int lane, uint32_t patch) {
    const cr_scene *s = f->scene;
    if ((at->from_facet >> lane) & 1u) {
        return s->facets[at->facet[lane]].patch == patch;
    }
    const struct cr_img_kind *kind = &s->kinds[cr_field_kind(f, at, lane)];
    for (uint32_t k = 0; k < kind->count; k++) {
        if (s->facets[kind->facet[k]].patch == patch) {
            return 1;
        }
    }
    return 0;
}

/* Was the distance linear on the way from lane i to p, so that p is where the piece enters? Over a facet it was when no other
 * plane of the crease is above p; in a flat brick when p is still in it. */
static int was_straight(const cr_field *f, const cr_lookup *at, int i, cr_vec3 from, cr_vec3 p) {
    if ((at->from_facet >> i) & 1u) {
        const struct cr_img_kind *kind = &f->scene->kinds[at->kind[i]];
        int below = !((at->bent >> i) & 1u);
        for (uint32_t k = 0; k < kind->count && kind->kind == CR_KIND_CONVEX; k++) {
            const struct cr_img_facet *facet = &f->scene->facets[kind->facet[k]];
            below = below && v3_dot(v3_from(facet->normal), p) - facet->offset_m <= LANDING_M;
        }
        return below;
    }
    uint32_t entry = at->entry[i];
    cr_vec3 u = v3_mad(v3(at->ux[i], at->uy[i], at->uz[i]), v3_sub(p, from), f->inv_brick);
    float least = min_f(u.x, min_f(u.y, u.z)), most = max_f(u.x, max_f(u.y, u.z));
    return !(entry & CR_TOP_FAR) && f->scene->bricks[entry].side == 1u && least >= 0.0f && most <= 1.0f;
}

/* Moves the chosen crease lanes of a cluster to the lowest point along n at which their pieces are inside. Two steps: near an
 * edge of the static object the distance bends, so where a step lands is looked at again. Lanes that do not land on the surface
 * leave the set: their piece stays outside. */
static void enter_pieces(const cr_respond_input *in, const struct cr_img_cluster *c, cr_vec3 n_tool,
                         const cr_lookup *at, cr_lanes3 *world, uint32_t *lanes) {
    cr_lookup again;
    uint32_t straight = 0u;
    for (uint32_t left = *lanes; left != 0u;) {
        int i = take_lane(&left);
        cr_vec3 from = lane_of(world, i), p = from;
        *lanes &= lowest_of_crease(c, at, in->world_from_tool, i, n_tool, &p) ? *lanes : ~(1u << i);
        straight |= (uint32_t)was_straight(in->field, at, i, from, p) << i;
        world->x[i] = p.x;
        world->y[i] = p.y;
        world->z[i] = p.z;
    }
    if ((*lanes & ~straight) == 0u) {
        return;
    }
    cr_field_look_up_lanes(in->field, world, *lanes & ~straight, &again);
    uint32_t unsure = 0u;
    for (uint32_t left = *lanes & ~straight; left != 0u;) {
        int i = take_lane(&left);
        cr_vec3 p = lane_of(world, i);
        if (again.phi_m[i] > 0.0f) {
            unsure |= 1u << i;
            *lanes &= clip_to_surface(c, &again, in->world_from_tool, i, &p) ? *lanes : ~(1u << i);
        }
        world->x[i] = p.x;
        world->y[i] = p.y;
        world->z[i] = p.z;
    }
    if ((unsure & *lanes) == 0u) {
        return;
    }
    cr_field_look_up_lanes(in->field, world, unsure & *lanes, &again);
    const float close_m = in->field->scene->meta->error_max_m + LANDING_M;
    for (uint32_t left = unsure & *lanes; left != 0u;) {
        int i = take_lane(&left);
        float above = max_f(0.0f, again.phi_m[i]);
        *lanes &= above <= close_m ? *lanes : ~(1u << i);
        /* What is left of the way is taken off straight: the point ends on the surface. */
        world->x[i] -= above * again.gx[i];
        world->y[i] -= above * again.gy[i];
        world->z[i] -= above * again.gz[i];
    }
}

/* Support of one cluster's touched surface along a direction: the nearest surface points of its lanes inside on a patch. */
static float support_of_cluster(const cr_respond_input *in, const cr_hit *hit, uint32_t patch, cr_vec3 along,
                                float best) {
    const cr_scene *s = in->field->scene;
    const struct cr_img_cluster *c = &s->clusters[hit->cluster];
    cr_lanes3 world;
    cr_lookup at;
    cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
    cr_field_look_up_lanes(in->field, &world, hit->inside, &at);
    for (uint32_t left = hit->inside & ((1u << c->count) - 1u); left != 0u;) {
        int i = take_lane(&left);
        if (abs_f(at.phi_m[i]) < s->meta->band_m && lane_is_on(in->field, &at, i, patch)) {
            cr_vec3 q = v3_mad(lane_of(&world, i), v3(at.gx[i], at.gy[i], at.gz[i]), -at.phi_m[i]);
            best = max_f(best, v3_dot(along, q));
        }
    }
    return best;
}

/* Support of the surface that a curved zone touches: the largest along . q over its points q. */
static float support_of_zone(const cr_respond_input *in, uint32_t area, const cr_zone *zone, cr_vec3 along) {
    const cr_scene *s = in->field->scene;
    float best = v3_dot(along, zone->centre_world_m);
    for (uint32_t t = 0; t < in->set->touch_count; t++) {
        const cr_touch *touch = &in->set->touches[t];
        const cr_hit *hit = &in->set->hits[touch->hit];
        if (hit->area == area && s->facets[touch->facet].patch == zone->patch) {
            best = support_of_cluster(in, hit, zone->patch, along, best);
        }
    }
    return best;
}

/* Generators of the contact plane: planar zones exactly, curved zones turned towards what the tool saw. */
static void make_generators(const cr_respond_input *in, uint32_t area, const cr_area_work *a, cr_vec3 s, weights *w) {
    cr_vec3 left = s;
    float room = 0.0f;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        left = v3_mad(left, a->zones[i].normal_world, -w->alpha[i]);
        room += w->alpha[i] * a->shapes[i].spread_rad * SPREAD_REACH;
    }
    float length = v3_norm(left);
    float part = room > 0.0f ? min_f(1.0f, room / max_f(length, 1e-20f)) / room : 0.0f;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        const cr_zone *zone = &a->zones[i];
        float bend = part * w->alpha[i] * a->shapes[i].spread_rad * SPREAD_REACH;
        w->vector_m2[i] = v3_mad(v3_scale(zone->normal_world, w->alpha[i]), left, bend);
        w->offset_m3[i] =
            a->shapes[i].curved ? support_of_zone(in, area, zone, w->vector_m2[i]) : w->alpha[i] * zone->offset_m;
    }
}

/* The part of an area that answers with one plane. */
typedef struct {
    float share[CR_ZONES_MAX]; /* of each zone, 0..1 */
    uint32_t own;              /* zones with a share */
    uint32_t behind; /* zones behind whose plane a point has to lie to be its own: those at a concave crease */
} group;

/* Zones that touch each hit, as bits, so that a split area measures depth with its own samples only. */
static uint32_t zones_of_hit(const cr_respond_input *in, const cr_area_work *a, uint32_t hit, uint32_t *touch) {
    uint32_t bits = 0u;
    for (; *touch < in->set->touch_count && in->set->touches[*touch].hit == hit; (*touch)++) {
        uint32_t patch = in->field->scene->facets[in->set->touches[*touch].facet].patch;
        for (uint32_t z = 0; z < a->zone_count; z++) {
            bits |= (uint32_t)(a->zones[z].patch == patch) << z;
        }
    }
    return bits;
}

/* The internal points that measure the depth of one group of zones. */
typedef struct {
    cr_vec3 n_world, n_tool;
    float plane_m; /* of the contact plane: n . p on it */
    float shift_m; /* n . p = n_tool . p_tool + shift */
    const cr_area_work *area;
    uint32_t behind; /* zones behind whose plane a point has to lie: those of a split area */
} probe;

static int lies_behind(const probe *d, cr_vec3 p_world) {
    for (uint32_t left = d->behind; left != 0u;) {
        int z = take_lane(&left);
        const cr_zone *zone = &d->area->zones[z];
        float bulge = d->area->shapes[z].spread_rad * zone->radius_m;
        if (v3_dot(zone->normal_world, p_world) > zone->offset_m + bulge) {
            return 0;
        }
    }
    return 1;
}

/* Lowest n . p of a cluster's internal points; best is the lowest so far. */
static float lowest_inside(const cr_respond_input *in, const cr_hit *hit, const probe *d, float best) {
    const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
    uint32_t lanes = in->config->vertices_only ? hit->inside & c->vertex_mask : hit->inside;
    float height[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        height[i] = c->x[i] * d->n_tool.x + c->y[i] * d->n_tool.y + c->z[i] * d->n_tool.z + d->shift_m;
    }
    for (int i = 0; i < CR_LANES; i++) {
        if (((lanes >> i) & 1u) && height[i] < best &&
            (d->behind == 0u || lies_behind(d, xform_point(in->world_from_tool, v3(c->x[i], c->y[i], c->z[i]))))) {
            best = height[i];
        }
    }
    return best;
}

/* Lanes whose piece of surface, reaching in where the sample does not, could come below best. A piece goes down by the part of n
 * along it, sqrt(n W n) over its full width: a crease to its end, a face as far as it is taken to go. */
static uint32_t find_low_pieces(const struct cr_img_cluster *c, const cr_hit *hit, const probe *d, float best) {
    const cr_vec3 n = d->n_tool;
    uint32_t lanes = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        if (CR_SCALAR && !((hit->near >> i) & 1u)) {
            continue;
        }
        float cross = c->wxy[i] * n.x * n.y + c->wyz[i] * n.y * n.z + c->wzx[i] * n.z * n.x;
        float fall2 = c->wxx[i] * n.x * n.x + c->wyy[i] * n.y * n.y + c->wzz[i] * n.z * n.z + 2.0f * cross;
        float part = (c->crease_mask >> i) & 1u ? c->reach[i] / (2.0f * c->ramp[i]) : 0.5f * FACE_PART;
        float height = c->x[i] * n.x + c->y[i] * n.y + c->z[i] * n.z + d->shift_m;
        lanes |= (uint32_t)(height - part * sqrtf(max_f(0.0f, fall2)) < best) << i;
    }
    return lanes & hit->near & ((1u << c->count) - 1u);
}

/* Moves a face sample that is outside down the distance along its piece, as far as the surface or FACE_PART of the way to the
 * piece's border. */
static cr_vec3 slide_on_face(const struct cr_img_cluster *c, const cr_lookup *at, const xform *pose, int i,
                             cr_vec3 p_world) {
    cr_vec3 g = xform_unrotate(pose, v3(at->gx[i], at->gy[i], at->gz[i]));
    cr_vec3 way = spread_times(c, i, g);
    float length2 = v3_dot(way, way), fall = v3_dot(way, g);
    if (!(length2 > 0.0f) || !(fall > 0.0f)) {
        return p_world;
    }
    float half = 0.5f * FACE_PART * sqrtf(max_f(0.0f, v3_dot(way, spread_times(c, i, way))) / length2);
    float part = min_f(at->phi_m[i] / fall, half / sqrtf(length2));
    return v3_mad(p_world, xform_rotate(pose, way), -part);
}

/* Lowest n . p where a static edge or corner reaches into faces between their samples: each sample goes to where its piece enters.
 * What it still lacks to the surface, and the bow of the piece, count against it; and it counts as far as its piece is covered. */
static float lowest_on_faces(const cr_respond_input *in, const struct cr_img_cluster *c, const probe *d,
                             const cr_lookup *at, cr_lanes3 *world, uint32_t lanes, float best) {
    float coverage[CR_LANES];
    cr_lookup there;
    cr_cover(in->field->scene, in->world_from_tool, in->config->coverage, c, world, at, coverage);
    for (uint32_t left = lanes; left != 0u;) {
        int i = take_lane(&left);
        cr_vec3 p = slide_on_face(c, at, in->world_from_tool, i, lane_of(world, i));
        world->x[i] = p.x;
        world->y[i] = p.y;
        world->z[i] = p.z;
    }
    cr_field_look_up_lanes(in->field, world, lanes, &there);
    while (lanes != 0u) {
        int i = take_lane(&lanes);
        cr_vec3 p = lane_of(world, i);
        float height = v3_dot(d->n_world, p) + max_f(0.0f, there.phi_m[i]) + c->bow[i];
        float depth = min_f(1.0f, coverage[i] / FACE_FULL) * max_f(0.0f, d->plane_m - height);
        best = lies_behind(d, p) ? min_f(best, d->plane_m - depth) : best;
    }
    return best;
}

/* Lowest n . p of the pieces of a cluster whose middle may be outside. */
static float lowest_near(const cr_respond_input *in, const cr_hit *hit, const probe *d, float best) {
    const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
    uint32_t lanes = find_low_pieces(c, hit, d, best), creases = lanes & c->crease_mask, faces = lanes & ~creases;
    if (lanes == 0u) {
        return best;
    }
    cr_lanes3 world;
    cr_lookup at;
    cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
    cr_field_look_up_lanes(in->field, &world, lanes, &at);
    if (faces != 0u) {
        best = lowest_on_faces(in, c, d, &at, &world, faces, best);
    }
    if (creases != 0u) {
        enter_pieces(in, c, d->n_tool, &at, &world, &creases);
    }
    while (creases != 0u) {
        cr_vec3 p = lane_of(&world, take_lane(&creases));
        best = lies_behind(d, p) ? min_f(best, v3_dot(d->n_world, p)) : best;
    }
    return best;
}

/* Lowest point along n of the internal surface of a group of zones: of hits that touch one of them, or none. */
static float find_lowest(const cr_respond_input *in, uint32_t area, const cr_area_work *a, const group *part, cr_vec3 n,
                         float plane_m) {
    const probe d = {n,           xform_unrotate(in->world_from_tool, n), plane_m, v3_dot(n, in->world_from_tool->t), a,
                     part->behind};
    float best = plane_m;
    uint32_t all = (1u << a->zone_count) - 1u;
    for (int near = 0; near < 2 && !(near && in->config->vertices_only); near++) {
        uint32_t touch = 0u;
        for (uint32_t h = 0; h < in->set->hit_count; h++) {
            const cr_hit *hit = &in->set->hits[h];
            uint32_t bits = part->own == all ? all : zones_of_hit(in, a, h, &touch);
            if (hit->area != area || (bits != 0u && (bits & part->own) == 0u)) {
                continue;
            }
            if (near) {
                best = hit->near ? lowest_near(in, hit, &d, best) : best;
            } else {
                best = lowest_inside(in, hit, &d, best);
            }
        }
    }
    return best;
}

static uint32_t pair_label(const cr_scene *s, uint32_t a, uint32_t b) {
    uint32_t first = a < b ? a : b, second = a < b ? b : a;
    uint32_t low = 0u, high = s->pair_count;
    while (low < high) {
        uint32_t mid = low + (high - low) / 2u;
        const struct cr_img_pair *p = &s->pairs[mid];
        if (p->first < first || (p->first == first && p->second < second)) {
            low = mid + 1u;
        } else {
            high = mid;
        }
    }
    return low < s->pair_count && s->pairs[low].first == first && s->pairs[low].second == second ? s->pairs[low].label
                                                                                                 : 0u;
}

/* Zones of one area that meet each zone, as bits. The label of their crease decides. Where they share creases of both kinds it is
 * concave when each lies above the plane of the other; zones that share none are beside each other when each lies below. */
typedef struct {
    uint32_t convex[CR_ZONES_MAX], concave[CR_ZONES_MAX], beside[CR_ZONES_MAX];
} relations;

static void relate(const cr_scene *s, const cr_area_work *a, uint32_t i, uint32_t j, relations *r) {
    uint32_t label = pair_label(s, a->zones[i].patch, a->zones[j].patch);
    cr_vec3 d = v3_sub(a->zones[j].centre_world_m, a->zones[i].centre_world_m);
    float j_above_i = dot_zone(a, i, d), i_above_j = -dot_zone(a, j, d);
    int convex = label == CR_PAIR_CONVEX, concave = label == CR_PAIR_CONCAVE, beside = 0;
    if (label == (CR_PAIR_CONVEX | CR_PAIR_CONCAVE)) {
        concave = j_above_i > 0.0f && i_above_j > 0.0f;
        convex = !concave;
    } else if (label == 0u) {
        beside = j_above_i <= 0.0f && i_above_j <= 0.0f;
    }
    r->convex[i] |= (uint32_t)convex << j;
    r->concave[i] |= (uint32_t)concave << j;
    r->beside[i] |= (uint32_t)beside << j;
}

static relations relate_zones(const cr_scene *s, const cr_area_work *a) {
    relations r = {{0u}, {0u}, {0u}};
    for (uint32_t i = 0; i < a->zone_count; i++) {
        for (uint32_t j = 0; j < a->zone_count; j++) {
            if (i != j) {
                relate(s, a, i, j, &r);
            }
        }
    }
    return r;
}

/* Zones that hang together with zone i round the outside. */
static uint32_t component_of(const relations *r, uint32_t i) {
    uint32_t found = 1u << i, fresh = found;
    while (fresh != 0u) {
        int z = take_lane(&fresh);
        uint32_t next = (r->convex[z] | r->beside[z]) & ~found;
        found |= next;
        fresh |= next;
    }
    return found;
}

/* Shares of one zone that leads nothing: those of the zones it meets, by their weight. */
static void share_zone(const float *alpha, uint32_t meets, uint32_t z, group *groups, uint32_t count) {
    float total = 0.0f;
    for (uint32_t left = meets; left != 0u;) {
        total += alpha[take_lane(&left)];
    }
    float even = 1.0f / (float)count_lanes(meets);
    for (uint32_t g = 0; g < count; g++) {
        for (uint32_t left = meets; left != 0u;) {
            int j = take_lane(&left);
            groups[g].share[z] += groups[g].share[j] * (total > 0.0f ? alpha[j] / total : even);
        }
    }
}

/* The zones of a mixed corner that lead nothing, ring by ring: first over convex creases, then to what is beside. */
static void share_out(const relations *r, const float *alpha, uint32_t members, uint32_t leaders, group *groups,
                      uint32_t count) {
    uint32_t known = leaders, ring = 1u;
    while (ring != 0u) {
        ring = 0u;
        for (int how = 0; how < 2 && ring == 0u; how++) {
            for (uint32_t left = members & ~known; left != 0u;) {
                uint32_t z = (uint32_t)take_lane(&left);
                uint32_t meets = (how == 0 ? r->convex[z] : r->beside[z]) & known;
                if (meets != 0u) {
                    share_zone(alpha, meets, z, groups, count);
                    ring |= 1u << z;
                }
            }
        }
        known |= ring;
    }
}

/* Concave creases split an area: zones joined by convex ones answer together, unless a concave crease lies within such a set (a
 * mixed corner). Then every zone at it leads a group of its own, and the others are shared among those they meet. Returns the
 * number of groups. */
static uint32_t split_at_creases(const cr_scene *s, const cr_area_work *a, const float *alpha, group *groups) {
    const relations r = relate_zones(s, a);
    static const group none = {{0.0f}, 0u, 0u};
    uint32_t count = 0u, left = (1u << a->zone_count) - 1u;
    while (left != 0u) {
        uint32_t first = left & (~left + 1u), seed = first, leaders = 0u;
        uint32_t members = component_of(&r, (uint32_t)take_lane(&seed)), base = count;
        for (uint32_t m = members; m != 0u;) {
            int z = take_lane(&m);
            leaders |= (r.concave[z] & members) != 0u ? 1u << z : 0u;
        }
        for (uint32_t m = leaders != 0u ? leaders : first; m != 0u;) {
            groups[count] = none;
            groups[count++].share[take_lane(&m)] = 1.0f;
        }
        share_out(&r, alpha, members, leaders != 0u ? leaders : first, &groups[base], count - base);
        left &= ~members;
    }
    for (uint32_t g = 0; g < count; g++) {
        for (uint32_t z = 0; z < a->zone_count; z++) {
            groups[g].own |= (uint32_t)(groups[g].share[z] > 0.0f) << z;
        }
        for (uint32_t own = groups[g].own; own != 0u;) {
            int z = take_lane(&own);
            groups[g].behind |= (r.concave[z] & ~groups[g].own) != 0u ? 1u << z : 0u;
        }
    }
    return count;
}

/* ---- the method as published [1] ---------------------------------------------------------------------------------- */

/* Normal of an area: its zone's; with two zones the reversed tool normals in the plane of the zone normals; with more, as is. */
static cr_vec3 published_normal(const cr_area_work *a, cr_vec3 s) {
    if (a->zone_count == 1u) {
        return a->zones[0].normal_world;
    }
    if (a->zone_count == 2u) {
        cr_vec3 across = v3_unit(v3_cross(a->zones[0].normal_world, a->zones[1].normal_world), 1e-6f);
        s = v3_mad(s, across, -v3_dot(s, across));
    }
    return v3_unit(s, 1e-6f * a->sum.area);
}

/* Point of the contact plane: the sphere's centre, or where the planes of several zones meet (their common vertex or a point of
 * their common edge), by projecting onto one after the other. */
static cr_vec3 published_point(const cr_area_work *a) {
    cr_vec3 p = v3(0.0f, 0.0f, 0.0f);
    for (uint32_t i = 0; i < a->zone_count; i++) {
        p = v3_mad(p, a->zones[i].centre_world_m, 1.0f / (float)a->zone_count);
    }
    for (int sweep = 0; sweep < COMMON_POINT_SWEEPS && a->zone_count > 1u; sweep++) {
        for (uint32_t i = 0; i < a->zone_count; i++) {
            const cr_zone *zone = &a->zones[i];
            p = v3_mad(p, zone->normal_world, zone->offset_m - v3_dot(zone->normal_world, p));
        }
    }
    return p;
}

/* In the inner half of some zone's sphere. */
static int is_internal(const cr_area_work *a, cr_vec3 p) {
    for (uint32_t i = 0; i < a->zone_count; i++) {
        cr_vec3 d = v3_sub(p, a->zones[i].centre_world_m);
        float r = a->zones[i].radius_m;
        if (v3_dot(d, d) <= r * r && v3_dot(d, a->zones[i].normal_world) < 0.0f) {
            return 1;
        }
    }
    return 0;
}

/* Lowest n . p of the internal vertices, the contact plane at least. */
static float published_lowest(const cr_respond_input *in, uint32_t area, const cr_area_work *a, cr_vec3 n,
                              float start) {
    float best = start;
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        const cr_hit *hit = &in->set->hits[h];
        if (hit->area != area) {
            continue;
        }
        const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
        cr_lanes3 world;
        cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
        uint32_t lanes = ((1u << c->count) - 1u) & (in->config->vertices_only ? c->vertex_mask : 0xffffu);
        while (lanes != 0u) {
            cr_vec3 p = lane_of(&world, take_lane(&lanes));
            float height = v3_dot(n, p);
            best = height < best && is_internal(a, p) ? height : best;
        }
    }
    return best;
}

static void report_area(const cr_area_work *a, const float *alpha, const float *share, cr_area *out);

static uint32_t answer_as_published(const cr_respond_input *in, uint32_t index, const cr_area_work *a, cr_vec3 s,
                                    cr_area *out) {
    float whole[CR_ZONES_MAX], weight[CR_ZONES_MAX];
    for (uint32_t i = 0; i < a->zone_count; i++) {
        whole[i] = 1.0f;
        weight[i] = a->zones[i].area_m2;
    }
    cr_vec3 n = published_normal(a, s);
    out->normal_world = n;
    out->offset_m = v3_dot(n, published_point(a));
    out->depth_m = out->offset_m - published_lowest(in, index, a, n, out->offset_m);
    if (!(out->depth_m > 0.0f) || !(v3_dot(n, n) > 0.5f)) {
        return 0u;
    }
    out->point_world_m =
        xform_point(in->world_from_tool, v3_scale(v3(a->sum.px, a->sum.py, a->sum.pz), 1.0f / a->sum.area));
    report_area(a, weight, whole, out);
    return 1u;
}

/* ---- areas -------------------------------------------------------------------------------------------------------- */

/* Where the force of a group acts: the area's centroid, moved by how far the group's zones lie from the middle of all. */
static cr_vec3 acting_point(const cr_respond_input *in, const cr_area_work *a, const weights *w, const float *share) {
    cr_vec3 centre =
        xform_point(in->world_from_tool, v3_scale(v3(a->sum.px, a->sum.py, a->sum.pz), 1.0f / a->sum.area));
    cr_vec3 mine = v3(0.0f, 0.0f, 0.0f), all = mine;
    float mine_weight = 0.0f, all_weight = 0.0f;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        cr_vec3 d = v3_sub(a->zones[i].centre_world_m, centre);
        mine = v3_mad(mine, d, w->alpha[i] * share[i]);
        all = v3_mad(all, d, w->alpha[i]);
        mine_weight += w->alpha[i] * share[i];
        all_weight += w->alpha[i];
    }
    if (!(mine_weight > 0.0f) || !(all_weight > 0.0f)) {
        return centre;
    }
    return v3_add(centre, v3_sub(v3_scale(mine, 1.0f / mine_weight), v3_scale(all, 1.0f / all_weight)));
}

static void report_area(const cr_area_work *a, const float *alpha, const float *share, cr_area *out) {
    out->force_world_N = v3(0.0f, 0.0f, 0.0f);
    out->area_m2 = a->sum.area;
    out->zone_count = 0u;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        if (share[i] > 0.0f) {
            cr_zone *zone = &out->zones[out->zone_count++];
            *zone = a->zones[i];
            zone->weight_m2 = alpha[i] * share[i];
        }
    }
}

/* One group of zones: normal, plane, depth. A shared zone counts once in all: the group answers with the share it holds of its
 * zones, so that it appears with force zero. Returns 0 when it has no direction or no depth. */
static int answer_group(const cr_respond_input *in, uint32_t index, const cr_area_work *a, const weights *w,
                        const group *part, cr_area *out) {
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f), whole = sum;
    float offset = 0.0f;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        sum = v3_mad(sum, w->vector_m2[i], part->share[i]);
        whole = (part->own >> i) & 1u ? v3_add(whole, w->vector_m2[i]) : whole;
        offset += w->offset_m3[i] * part->share[i];
    }
    float length = v3_norm(sum);
    if (!(length > 1e-6f * a->sum.area)) {
        return 0;
    }
    out->normal_world = v3_scale(sum, 1.0f / length);
    out->offset_m = offset / length;
    float lowest = find_lowest(in, index, a, part, out->normal_world, out->offset_m);
    float open = v3_norm(v3(a->sum.ax, a->sum.ay, a->sum.az)) / (OPEN_MIN * a->sum.area);
    float held = min_f(1.0f, length / max_f(v3_norm(whole), 1e-20f));
    float raw_m = out->offset_m - lowest;
    out->depth_m = held * raw_m * min_f(1.0f, open);
    /* Less than the rounding of the two heights is no contact. */
    if (!(raw_m > ROUNDING_M + 2e-7f * abs_f(out->offset_m)) || !(out->depth_m > 0.0f)) {
        return 0;
    }
    out->normal_world = responses[in->config->response].turn(a, part->share, out->normal_world);
    out->point_world_m = acting_point(in, a, w, part->share);
    report_area(a, w->alpha, part->share, out);
    return 1;
}

static uint32_t answer_area(const cr_respond_input *in, uint32_t index, const cr_area_work *a, cr_area *out,
                            uint32_t room) {
    weights w;
    group groups[CR_ZONES_MAX];
    uint32_t made = 0u;
    cr_vec3 s = xform_rotate(in->world_from_tool, v3(-a->sum.ax, -a->sum.ay, -a->sum.az));
    if (in->config->coverage == CR_COVERAGE_HARD && responses[in->config->response].as_published) {
        return answer_as_published(in, index, a, s, out);
    }
    weigh_by_cone(in, a, s, w.alpha);
    make_generators(in, index, a, s, &w);
    uint32_t count = split_at_creases(in->field->scene, a, w.alpha, groups);
    for (uint32_t g = 0; g < count && made < room; g++) {
        made += (uint32_t)answer_group(in, index, a, &w, &groups[g], &out[made]);
    }
    if (made == 0u && count > 1u && room > 0u) {
        /* No part of a split area reached deep enough on its own: it answers as one. */
        groups[0].own = (1u << a->zone_count) - 1u;
        groups[0].behind = 0u;
        for (uint32_t i = 0; i < a->zone_count; i++) {
            groups[0].share[i] = 1.0f;
        }
        made = (uint32_t)answer_group(in, index, a, &w, &groups[0], &out[0]);
    }
    return made;
}

uint32_t cr_respond(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t out_max,
                    cr_stats *stats) {
    uint32_t made = 0u;
    const answer_fn answer = responses[in->config->response].answer;
    if (answer != NULL) {
        return answer(in, areas, out, out_max);
    }
    for (uint32_t i = 0; i < areas->count; i++) {
        const cr_area_work *a = &areas->areas[i];
        if (a->zone_count == 0u || !(a->sum.area > 0.0f)) {
            continue;
        }
        if (made >= out_max) {
            stats->areas_merged++;
            continue;
        }
        made += answer_area(in, i, a, &out[made], out_max - made);
    }
    return made;
}
