/* depth: the lowest point of the tool surface that is inside, for one group of zones. DESIGN.md "Contact plane and depth". */
#include "respond.h"

/* A piece has to land this close to the surface, beside the error of the distances, to count as inside. */
#define LANDING_M 1e-6f
/* Part of the way from the middle of a face sample's piece to its border that is certainly on the tool whatever the piece's shape: the
 * half width of a triangle, by its second moment, reaches 1.22 times as far as its border. With 0.9 a cube on a wall came out deeper. */
#define FACE_PART 0.8f
/* A piece of face that is entered beside its sample counts in full from this coverage on: it comes and goes gently. */
#define FACE_FULL 0.125f
/* It counts in full when it is this deep where it enters, as a share of the largest distance at which it can be covered. */
#define FACE_INSIDE 0.2f
/* It is led this much deeper than the surface, as a share of the same, in this many steps: three find a
 * corner's tip. */
#define FACE_AIM 0.3f
#define FACE_STEPS 3

/* W v for one lane. */
static cr_vec3 spread_times(const struct cr_img_cluster *c, int lane, cr_vec3 v) {
    return v3(c->wxx[lane] * v.x + c->wxy[lane] * v.y + c->wzx[lane] * v.z,
              c->wxy[lane] * v.x + c->wyy[lane] * v.y + c->wyz[lane] * v.z,
              c->wzx[lane] * v.x + c->wyz[lane] * v.y + c->wzz[lane] * v.z);
}

/* Where a piece of crease that is just outside at p crosses the static surface: the way down is along W g, W the second moment of
 * the piece, which points along it. Returns 0 when that is beyond an end of the piece. */
static int clip_to_surface(const struct cr_img_cluster *c, const cr_lookup *at, const xform *pose, int lane,
                           cr_vec3 *p_world) {
    cr_vec3 g = xform_unrotate(pose, v3(at->gx[lane], at->gy[lane], at->gz[lane]));
    cr_vec3 way = spread_times(c, lane, g);
    float fall = v3_dot(way, g), reach = c->reach[lane];
    if (!(fall > 0.0f)) {
        return 0;
    }
    *p_world = v3_mad(*p_world, xform_rotate(pose, way), -at->phi_m[lane] / fall);
    cr_vec3 off = v3_sub(*p_world, xform_point(pose, v3(c->x[lane], c->y[lane], c->z[lane])));
    return v3_dot(off, off) <= reach * reach;
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
 * leave the set: their piece stays outside. `at` is overwritten. */
static void enter_pieces(const cr_respond_input *in, const struct cr_img_cluster *c, cr_vec3 n_tool, cr_lookup *at,
                         cr_lanes3 *world, uint32_t *lanes) {
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
    cr_field_look_up_lanes(in->field, world, *lanes & ~straight, at);
    uint32_t unsure = 0u;
    for (uint32_t left = *lanes & ~straight; left != 0u;) {
        int i = take_lane(&left);
        cr_vec3 p = lane_of(world, i);
        if (at->phi_m[i] > 0.0f) {
            unsure |= 1u << i;
            *lanes &= clip_to_surface(c, at, in->world_from_tool, i, &p) ? *lanes : ~(1u << i);
        }
        world->x[i] = p.x;
        world->y[i] = p.y;
        world->z[i] = p.z;
    }
    if ((unsure & *lanes) == 0u) {
        return;
    }
    cr_field_look_up_lanes(in->field, world, unsure & *lanes, at);
    const float close_m = in->field->scene->meta->error_max_m + LANDING_M;
    for (uint32_t left = unsure & *lanes; left != 0u;) {
        int i = take_lane(&left);
        float above = max_f(0.0f, at->phi_m[i]);
        *lanes &= above <= close_m ? *lanes : ~(1u << i);
        /* What is left of the way is taken off straight: the point ends on the surface. */
        world->x[i] -= above * at->gx[i];
        world->y[i] -= above * at->gy[i];
        world->z[i] -= above * at->gz[i];
    }
}

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

/* Moves a face sample, now at p, down the distance along its piece: a little beyond the surface, at most FACE_PART of the way from
 * the piece's middle to its border. */
static cr_vec3 slide_on_face(const struct cr_img_cluster *c, const cr_lookup *at, const xform *pose, int i,
                             cr_vec3 middle_world, cr_vec3 p_world) {
    cr_vec3 g = xform_unrotate(pose, v3(at->gx[i], at->gy[i], at->gz[i]));
    cr_vec3 way = spread_times(c, i, g);
    float fall = v3_dot(way, g);
    if (!(fall > 0.0f) || !(at->phi_m[i] > -FACE_AIM * c->ramp[i])) {
        return p_world;
    }
    cr_vec3 to = v3_mad(p_world, xform_rotate(pose, way), -(at->phi_m[i] + FACE_AIM * c->ramp[i]) / fall);
    cr_vec3 out = v3_sub(to, middle_world), out_tool = xform_unrotate(pose, out);
    float length2 = v3_dot(out, out);
    /* Half the piece's width that way is 1/2 sqrt(u W u) for the unit vector u. */
    float half2 = 0.25f * FACE_PART * FACE_PART * v3_dot(out_tool, spread_times(c, i, out_tool));
    return length2 * length2 > half2 ? v3_mad(middle_world, out, sqrtf(max_f(0.0f, half2)) / length2) : to;
}

/* Height along n that the piece of face lane i gives, entered at p: the contact plane's where it does not count. It counts as far as
 * it is certainly inside there, the bow of the piece and the error of the distance taken off, and as far as it is covered. */
static float height_on_face(const cr_respond_input *in, const struct cr_img_cluster *c, const probe *d,
                            const cr_lookup *at, int i, cr_vec3 p, float coverage) {
    int exact = (int)((at->from_facet >> i) & 1u); /* distances from planes are */
    float unsure_m = c->bow[i] + (exact ? LANDING_M : in->field->scene->meta->error_max_m);
    float inside = clamp_f(-(at->phi_m[i] + unsure_m) / (FACE_INSIDE * c->ramp[i]), 0.0f, 1.0f);
    float depth = max_f(0.0f, d->plane_m - v3_dot(d->n_world, p) - c->bow[i]);
    return lies_behind(d, p) ? d->plane_m - min_f(1.0f, coverage / FACE_FULL) * inside * depth : d->plane_m;
}

/* Lowest n . p where a static edge or corner reaches into faces between their samples: each sample goes to where its piece enters.
 * A piece that is outside gives nothing. */
static float lowest_on_faces(const cr_respond_input *in, const struct cr_img_cluster *c, const probe *d, cr_lookup *at,
                             cr_lanes3 *world, uint32_t lanes, float best) {
    float coverage[CR_LANES];
    cr_cover(in->field->scene, in->world_from_tool, in->config->coverage, c, world, at, coverage);
    const cr_lanes3 middle = *world;
    for (int step = 0; step < FACE_STEPS && lanes != 0u; step++) {
        for (uint32_t left = lanes; left != 0u;) {
            int i = take_lane(&left);
            cr_vec3 p = slide_on_face(c, at, in->world_from_tool, i, lane_of(&middle, i), lane_of(world, i));
            world->x[i] = p.x;
            world->y[i] = p.y;
            world->z[i] = p.z;
        }
        cr_field_look_up_lanes(in->field, world, lanes, at);
        for (uint32_t left = lanes; left != 0u;) {
            int i = take_lane(&left);
            best = min_f(best, height_on_face(in, c, d, at, i, lane_of(world, i), coverage[i]));
            /* Deep enough to count in full: there is no further to go. */
            lanes &= at->phi_m[i] > -0.8f * FACE_AIM * c->ramp[i] ? lanes : ~(1u << i);
        }
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
    /* Each overwrites what it is given: two lookups one after the other take half the stack of two at once. */
    if (faces != 0u) {
        cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
        cr_field_look_up_lanes(in->field, &world, faces, &at);
        best = lowest_on_faces(in, c, d, &at, &world, faces, best);
    }
    if (creases != 0u) {
        cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
        cr_field_look_up_lanes(in->field, &world, creases, &at);
        enter_pieces(in, c, d->n_tool, &at, &world, &creases);
    }
    while (creases != 0u) {
        cr_vec3 p = lane_of(&world, take_lane(&creases));
        best = lies_behind(d, p) ? min_f(best, v3_dot(d->n_world, p)) : best;
    }
    return best;
}

/* Lowest point along n of the internal surface of a group of zones: of hits that touch one of them, or none. */
float cr_lowest(const cr_respond_input *in, uint32_t index, const cr_area_work *area, const cr_group *part, cr_vec3 n,
                float plane_m) {
    const probe d = {
        n, xform_unrotate(in->world_from_tool, n), plane_m, v3_dot(n, in->world_from_tool->t), area, part->behind};
    float best = plane_m;
    uint32_t all = (1u << area->zone_count) - 1u;
    for (int near = 0; near < 2 && !(near && in->config->vertices_only); near++) {
        uint32_t touch = 0u;
        for (uint32_t h = 0; h < in->set->hit_count; h++) {
            const cr_hit *hit = &in->set->hits[h];
            uint32_t bits = part->own == all ? all : zones_of_hit(in, area, h, &touch);
            if (hit->area != index || (bits != 0u && (bits & part->own) == 0u)) {
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
