/* lowest: the lowest point of the tool surface that is inside, for one group of zones. EXTENT.md "Contact plane and depth". */
#include "rivals/extent.h"

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
    cr_vec3 off = v3_sub(*p_world, cr_xform_point(pose, v3(c->x[lane], c->y[lane], c->z[lane])));
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

static int is_own(const cr_respond_input *in, const probe *d, cr_vec3 p_tool) {
    return d->behind == 0u || lies_behind(d, cr_xform_point(in->world_from_tool, p_tool));
}

/* One cluster, and what is measured at it. */
typedef struct {
    const cr_respond_input *in;
    const struct cr_img_cluster *c;
    const probe *probe;
} spot;

/* Lowest n . p of a cluster's internal points; best is the lowest so far. */
static float lowest_inside(const cr_respond_input *in, const cr_hit *hit, const probe *d, float best) {
    const struct cr_img_cluster *c = &in->field->scene->clusters[hit->cluster];
    const cr_vec3 n = d->n_tool;
    for (uint32_t left = in->config->vertices_only ? hit->inside & c->vertex_mask : hit->inside; left != 0u;) {
        const int i = take_lane(&left);
        float height = c->x[i] * n.x + c->y[i] * n.y + c->z[i] * n.z + d->shift_m;
        if (height < best && is_own(in, d, v3(c->x[i], c->y[i], c->z[i]))) {
            best = height;
        }
    }
    return best;
}

/* Lanes whose piece of surface, reaching in where the sample does not, could come below best. A piece goes down by the part of n
 * along it, sqrt(n W n) over its full width: a crease to its end, a face as far as it is taken to go. */
static uint32_t find_low_pieces(const struct cr_img_cluster *c, const cr_hit *hit, const probe *d, float best) {
    const cr_vec3 n = d->n_tool;
    uint32_t lanes = 0u;
    for (uint32_t left = hit->near & first_lanes(c->count); left != 0u;) {
        const int i = take_lane(&left);
        float height = c->x[i] * n.x + c->y[i] * n.y + c->z[i] * n.z + d->shift_m;
        if (height - 1.001f * c->ramp[i] >= best) {
            continue; /* half the width is at most the ramp */
        }
        float cross = c->wxy[i] * n.x * n.y + c->wyz[i] * n.y * n.z + c->wzx[i] * n.z * n.x;
        float fall2 = c->wxx[i] * n.x * n.x + c->wyy[i] * n.y * n.y + c->wzz[i] * n.z * n.z + 2.0f * cross;
        float part = (c->crease_mask >> i) & 1u ? c->reach[i] / (2.0f * c->ramp[i]) : 0.5f * FACE_PART;
        lanes |= (uint32_t)(height - part * sqrtf(max_f(0.0f, fall2)) < best) << i;
    }
    return lanes;
}

/* Distance and its gradient at a point, tool frame. */
typedef struct {
    float phi_m;
    cr_vec3 gradient;
} sloped_at;

static cr_vec3 middle_of(const struct cr_img_cluster *c, int lane) { return v3(c->x[lane], c->y[lane], c->z[lane]); }

/* Moves a face sample, now at p, down the distance along its piece: a little beyond the surface, at most FACE_PART of the way from
 * the piece's middle to its border. */
static cr_vec3 slide_on_face(const struct cr_img_cluster *c, int i, sloped_at at, cr_vec3 p_tool) {
    cr_vec3 way = spread_times(c, i, at.gradient);
    float fall = v3_dot(way, at.gradient), aim_m = FACE_AIM * c->ramp[i];
    if (!(fall > 0.0f) || !(at.phi_m > -aim_m)) {
        return p_tool;
    }
    cr_vec3 middle = middle_of(c, i), to = v3_mad(p_tool, way, -(at.phi_m + aim_m) / fall), out = v3_sub(to, middle);
    float length2 = v3_dot(out, out);
    /* Half the piece's width that way is 1/2 sqrt(u W u) for the unit vector u. */
    float half2 = 0.25f * FACE_PART * FACE_PART * v3_dot(out, spread_times(c, i, out));
    return length2 * length2 > half2 ? v3_mad(middle, out, sqrtf(max_f(0.0f, half2)) / length2) : to;
}

/* Deep enough to count in full: there is no further to go. */
static int is_entered(const struct cr_img_cluster *c, int i, float phi_m) {
    return phi_m <= -0.8f * FACE_AIM * c->ramp[i];
}

/* Height along n that the piece of face lane i gives, entered at p, at a distance that error_m may be off: the contact plane's where
 * it does not count. It counts as far as it is certainly inside there, the bow of the piece and the error taken off, and as far as it
 * is covered. */
static float height_on_face(const spot *r, int i, cr_vec3 p_tool, float phi_m, float error_m, float coverage) {
    const struct cr_img_cluster *c = r->c;
    const probe *d = r->probe;
    float inside = clamp_f(-(phi_m + c->bow[i] + error_m) / (FACE_INSIDE * c->ramp[i]), 0.0f, 1.0f);
    float depth = max_f(0.0f, d->plane_m - v3_dot(d->n_tool, p_tool) - d->shift_m - c->bow[i]);
    return is_own(r->in, d, p_tool) ? d->plane_m - min_f(1.0f, coverage / FACE_FULL) * inside * depth : d->plane_m;
}

/* Lowest n . p where a static edge or corner reaches into faces between their samples: each sample goes to where its piece enters.
 * A piece that is outside gives nothing. */
static float lowest_on_faces(const spot *r, uint32_t lanes, float best) {
    const cr_respond_input *in = r->in;
    const struct cr_img_cluster *c = r->c;
    float coverage[CR_LANES];
    cr_lanes3 place, world;
    cr_lookup at;
    cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
    cr_field_look_up_lanes(in->field, &world, lanes, &at);
    (void)cr_cover(in->field->scene, in->world_from_tool, cr_coverage_of(in->config->coverage, 1u), c, &at, coverage);
    for (int i = 0; i < CR_LANES; i++) {
        place.x[i] = c->x[i];
        place.y[i] = c->y[i];
        place.z[i] = c->z[i];
    }
    for (int step = 0; step < FACE_STEPS && lanes != 0u; step++) {
        for (uint32_t left = lanes; left != 0u;) {
            int i = take_lane(&left);
            const sloped_at slope = {at.phi_m[i],
                                     xform_unrotate(in->world_from_tool, v3(at.gx[i], at.gy[i], at.gz[i]))};
            cr_vec3 p = slide_on_face(c, i, slope, lane_of(&place, i));
            place.x[i] = p.x;
            place.y[i] = p.y;
            place.z[i] = p.z;
        }
        cr_lanes_to_world(in->world_from_tool, place.x, place.y, place.z, &world);
        cr_field_look_up_lanes(in->field, &world, lanes, &at);
        for (uint32_t left = lanes; left != 0u;) {
            int i = take_lane(&left);
            /* Distances from planes are exact. */
            float error_m = (at.from_facet >> i) & 1u ? LANDING_M : in->field->scene->meta->error_max_m;
            best = min_f(best, height_on_face(r, i, lane_of(&place, i), at.phi_m[i], error_m, coverage[i]));
            lanes &= is_entered(c, i, at.phi_m[i]) ? ~(1u << i) : lanes;
        }
    }
    return best;
}

/* Lowest n . p of pieces of creases, looked up. */
static float lowest_on_creases(const spot *r, uint32_t lanes, float best) {
    cr_lanes3 world;
    cr_lookup at;
    cr_lanes_to_world(r->in->world_from_tool, r->c->x, r->c->y, r->c->z, &world);
    cr_field_look_up_lanes(r->in->field, &world, lanes, &at);
    enter_pieces(r->in, r->c, r->probe->n_tool, &at, &world, &lanes);
    while (lanes != 0u) {
        cr_vec3 p = lane_of(&world, take_lane(&lanes));
        best = lies_behind(r->probe, p) ? min_f(best, v3_dot(r->probe->n_world, p)) : best;
    }
    return best;
}

/* Distance at a point above planes, and the largest height. */
static sloped_at measure_at(const cr_planes *p, cr_vec3 p_tool, float *height, float *top) {
    sloped_at at;
    uint32_t nearest;
    for (uint32_t k = 0; k < p->count; k++) {
        height[k] = v3_dot(p->normal_tool[k], p_tool) + p->offset_m[k];
    }
    at.phi_m = p->sign * cr_convex_distance(p->normal_tool, height, p->count, &nearest, &at.gradient);
    at.gradient = v3_scale(at.gradient, p->sign);
    *top = height[nearest];
    return at;
}

/* The same as lowest_on_faces for one lane where the static object is planes: no lookups. */
static float lowest_on_face_over(const spot *r, const cr_planes *planes, int i, float best) {
    float height[CR_KIND_FACETS_MAX], top;
    cr_vec3 p = middle_of(r->c, i);
    sloped_at at = measure_at(planes, p, height, &top);
    float share = cr_cover_by_planes(planes, r->c, i, height, top, at.phi_m * planes->sign);
    const float coverage = planes->sign < 0.0f ? 1.0f - share : share;
    for (int step = 0; step < FACE_STEPS; step++) {
        p = slide_on_face(r->c, i, at, p);
        at = measure_at(planes, p, height, &top);
        best = min_f(best, height_on_face(r, i, p, at.phi_m, LANDING_M, coverage));
        if (is_entered(r->c, i, at.phi_m)) {
            break;
        }
    }
    return best;
}

/* Crease pieces run from part -1, their upper end, over their middle at 0 to part 1. NOWHERE is before all of them. */
#define NOWHERE (-2.0f)

/* Last part of a piece that lies below all planes. */
static float last_below_all(const cr_planes *p, cr_vec3 middle, cr_vec3 down) {
    float first = -1.0f, last = 1.0f;
    for (uint32_t k = 0; k < p->count; k++) {
        float height = v3_dot(p->normal_tool[k], middle) + p->offset_m[k], rise = v3_dot(p->normal_tool[k], down);
        if (rise > 0.0f) {
            last = min_f(last, -height / rise);
        } else if (rise < 0.0f) {
            first = max_f(first, -height / rise);
        } else if (height > 0.0f) {
            return NOWHERE;
        }
    }
    return first <= last ? last : NOWHERE;
}

/* Last part of a piece that lies above some plane: inside, where the planes bound the space round the static object. */
static float last_above_one(const cr_planes *p, cr_vec3 middle, cr_vec3 down) {
    float last = NOWHERE;
    for (uint32_t k = 0; k < p->count; k++) {
        float height = v3_dot(p->normal_tool[k], middle) + p->offset_m[k], rise = v3_dot(p->normal_tool[k], down);
        float leaves = rise < 0.0f ? -height / rise : NOWHERE;
        last = max_f(last, height + rise >= 0.0f ? 1.0f : leaves);
    }
    return last;
}

/* Lowest n . p of a piece of crease where the static object is planes. */
static float lowest_on_crease_over(const spot *r, const cr_planes *planes, int i, float best) {
    const probe *d = r->probe;
    cr_vec3 middle = middle_of(r->c, i);
    cr_vec3 down = v3_scale(v3_unit(spread_times(r->c, i, d->n_tool), 0.0f), -r->c->reach[i]);
    float part = planes->sign < 0.0f ? last_above_one(planes, middle, down) : last_below_all(planes, middle, down);
    if (part < -1.0f) {
        return best;
    }
    cr_vec3 p = v3_mad(middle, down, part);
    return is_own(r->in, d, p) ? min_f(best, v3_dot(d->n_tool, p) + d->shift_m) : best;
}

/* Lowest n . p of the pieces of a cluster whose middle may be outside. */
static float lowest_near(const cr_respond_input *in, const cr_hit *hit, const probe *d, cr_planes *planes, float best) {
    const spot r = {in, &in->field->scene->clusters[hit->cluster], d};
    uint32_t lanes = find_low_pieces(r.c, hit, d, best);
    const uint32_t creases = lanes & r.c->crease_mask, faces = lanes & ~creases;
    if (hit->planes == 0u) {
        /* One after the other: they take half the stack of two lookups at once. */
        best = faces != 0u ? lowest_on_faces(&r, faces, best) : best;
        return creases != 0u ? lowest_on_creases(&r, creases, best) : best;
    }
    if (planes->kind != hit->planes && lanes != 0u) {
        cr_planes_turn(in->field->scene, in->world_from_tool, hit->planes, planes);
        planes->reach = 1.0f;
    }
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        best =
            (creases >> i) & 1u ? lowest_on_crease_over(&r, planes, i, best) : lowest_on_face_over(&r, planes, i, best);
    }
    return best;
}

/* Is the middle of a hit where one of these zones is, in the zone's sphere? The tip of a tool in a groove touches the
 * wall it is less deep in, and is the lowest point of the other one too. */
static int is_at_zones(const cr_respond_input *in, const cr_area_work *area, const cr_hit *hit, uint32_t zones) {
    const cr_vec3 sum = v3(hit->sum.px, hit->sum.py, hit->sum.pz);
    const cr_vec3 middle = cr_xform_point(in->world_from_tool, v3_scale(sum, 1.0f / max_f(hit->sum.area, 1e-20f)));
    int at = 0;
    while (zones != 0u) {
        const cr_zone *zone = &area->zones[take_lane(&zones)];
        const cr_vec3 off = v3_sub(middle, zone->centre_world_m);
        at = at || v3_dot(off, off) <= zone->radius_m * zone->radius_m;
    }
    return at;
}

/* Lowest point along n of the internal surface of a group of zones: of hits that touch one of them, or none, or are where they are. */
float cr_lowest(const cr_respond_input *in, uint32_t index, const cr_area_work *area, const cr_group *part, cr_vec3 n,
                float plane_m) {
    const probe d = {
        n, xform_unrotate(in->world_from_tool, n), plane_m, v3_dot(n, in->world_from_tool->t), area, part->behind};
    float best = plane_m;
    cr_planes planes;
    planes.kind = 0u;
    uint32_t all = (1u << area->zone_count) - 1u;
    for (int near = 0; near < 2 && !(near && in->config->vertices_only); near++) {
        uint32_t touch = 0u;
        for (uint32_t h = 0; h < in->set->hit_count; h++) {
            const cr_hit *hit = &in->set->hits[h];
            uint32_t bits = part->own == all ? all : zones_of_hit(in, area, h, &touch);
            if (hit->area != index ||
                (bits != 0u && (bits & part->own) == 0u && !is_at_zones(in, area, hit, part->own))) {
                continue;
            }
            if (near) {
                best = hit->near ? lowest_near(in, hit, &d, &planes, best) : best;
            } else {
                best = lowest_inside(in, hit, &d, best);
            }
        }
    }
    return best;
}
