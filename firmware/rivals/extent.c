/* extent: from zones to normal, contact plane and depth of each area. EXTENT.md "Zones and area normal".
 *
 * Weights of the zones by cone decomposition, plane, depth and splitting at concave creases are the same for every response; a
 * response may turn the normal. The method as published (hard coverage) has its own path. */
#include "rivals/extent.h"

/* Pull of a zone's weight to the tool area facing it: breaks ties between dependent zones; larger biases the direction. */
#define PULL_FACING 1e-3f
/* Pull to zero on a zone that less than about one sample sees, so that it appears and leaves with weight zero. */
#define PULL_UNSEEN 0.05f
/* A curved zone may turn the normal this many standard deviations away from its mean. */
#define SPREAD_REACH 2.5f
/* Rounding of heights near the origin; elsewhere it grows with the offset. */
#define ROUNDING_M 1e-8f
/* Share of an area, and of what a group of zones touches, below which what the zones explain of its vector gives no direction: the
 * tool is wholly inside, or through a plate whose faces balance. The answer fades. */
#define OPEN_MIN 0.01f
/* Part of a sample, or of what is touched in all when that is less, from which on a zone's plane bounds the overlap where it is. */
#define SEEN_WELL 0.25f

/* A zone's part in the contact plane: weight, generator vector of weight 1 (near unit length) and its plane. */
typedef struct {
    float alpha[CR_ZONES_MAX];
    cr_vec3 toward[CR_ZONES_MAX];
    float offset_m[CR_ZONES_MAX];
} weights;

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

/* Support of one cluster's touched surface along a direction: the nearest surface points of its lanes inside on a patch. */
static float support_of_cluster(const cr_respond_input *in, const cr_hit *hit, uint32_t patch, cr_vec3 along,
                                float best) {
    const cr_scene *s = in->field->scene;
    const struct cr_img_cluster *c = &s->clusters[hit->cluster];
    cr_lanes3 world;
    cr_lookup at;
    cr_lanes_to_world(in->world_from_tool, c->x, c->y, c->z, &world);
    cr_field_look_up_lanes(in->field, &world, hit->inside, &at);
    for (uint32_t left = hit->inside & first_lanes(c->count); left != 0u;) {
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
        float bend = part * a->shapes[i].spread_rad * SPREAD_REACH;
        w->toward[i] = v3_mad(zone->normal_world, left, bend);
        w->offset_m[i] = a->shapes[i].curved ? support_of_zone(in, area, zone, w->toward[i]) : zone->offset_m;
    }
}

/* Where the force of a group acts: the area's centroid, moved by how far the group's zones lie from the middle of all. */
static cr_vec3 acting_point(const cr_respond_input *in, const cr_area_work *a, const weights *w, const float *share) {
    cr_vec3 centre =
        cr_xform_point(in->world_from_tool, v3_scale(v3(a->sum.px, a->sum.py, a->sum.pz), 1.0f / a->sum.area));
    cr_vec3 mine = v3(0.0f, 0.0f, 0.0f), all = mine;
    float mine_weight = 0.0f, all_weight = 0.0f;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        cr_vec3 d = v3_sub(a->zones[i].centre_world_m, centre);
        mine = v3_mad(mine, d, w->alpha[i] * share[i]);
        all = v3_mad(all, d, w->alpha[i]);
        mine_weight += w->alpha[i] * share[i];
        all_weight += w->alpha[i];
    }
    /* Neither weight is zero: the group has a direction. */
    return v3_add(centre, v3_sub(v3_scale(mine, 1.0f / mine_weight), v3_scale(all, 1.0f / all_weight)));
}

void cr_report_area(const cr_area_work *a, const float *alpha, const float *share, cr_area *out) {
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

/* Planes of the zones of a group, from a point near them. A zone that few samples see cuts less: its plane stands off, so that it comes
 * and goes from afar. No plane cuts off what another zone touches: that would be a corner that is not convex. */
static uint32_t planes_of_group(const cr_respond_input *in, const cr_area_work *a, const weights *w, const float *share,
                                cr_vec3 from, cr_plane *planes) {
    float seen = 0.0f, part[CR_ZONES_MAX], h = in->field->scene->meta->spacing_m;
    uint32_t count = 0u;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        seen += a->zones[i].area_m2;
    }
    for (uint32_t i = 0; i < a->zone_count; i++) {
        part[i] = min_f(1.0f, a->zones[i].area_m2 * share[i] / (SEEN_WELL * min_f(h * h, seen)));
    }
    for (uint32_t i = 0; i < a->zone_count; i++) {
        float length = v3_norm(w->toward[i]), above = 0.0f;
        if (!(part[i] > 0.0f && length > 0.0f)) {
            continue;
        }
        cr_plane *p = &planes[count++];
        p->normal = v3_scale(w->toward[i], 1.0f / length);
        p->offset_m = w->offset_m[i] / length - v3_dot(p->normal, from);
        for (uint32_t k = 0; k < a->zone_count; k++) {
            float over = v3_dot(p->normal, v3_sub(a->zones[k].centre_world_m, from)) - p->offset_m;
            above = max_f(above, part[k] * over);
        }
        p->offset_m += above + h * (1.0f / part[i] - 1.0f);
    }
    return count;
}

/* Height along n of the contact plane, at most that of the highest point behind the planes of all zones: where the weights depend on each
 * other many are right, and the planes they give lie anywhere above the end of the overlap. */
static float end_of_overlap(const cr_respond_input *in, const cr_area_work *a, const weights *w, const float *share,
                            cr_vec3 n, float plane_m) {
    cr_plane planes[CR_ZONES_MAX];
    cr_vec3 from = a->zones[0].centre_world_m;
    uint32_t count = planes_of_group(in, a, w, share, from, planes);
    float base = v3_dot(n, from);
    return base + cr_top_behind(planes, count, n, plane_m - base);
}

/* Sum of the vectors of all zones of an area: what is left of the reversed tool sum that they can explain. */
static cr_vec3 out_of_all(const cr_area_work *a, const weights *w) {
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f);
    for (uint32_t i = 0; i < a->zone_count; i++) {
        sum = v3_mad(sum, w->toward[i], w->alpha[i]);
    }
    return sum;
}

/* One group of zones: normal, plane, depth. A shared zone counts once in all: the group answers with the share it holds of its
 * zones, so that it appears with force zero. Returns 0 when it has no direction or no depth. */
static int answer_group(const cr_respond_input *in, uint32_t index, const cr_area_work *a, const weights *w,
                        const cr_group *part, cr_area *out) {
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f), whole = sum;
    float offset = 0.0f, touched = 0.0f;
    for (uint32_t i = 0; i < a->zone_count; i++) {
        touched += a->zones[i].area_m2 * part->share[i];
        float weight = w->alpha[i] * part->share[i];
        sum = v3_mad(sum, w->toward[i], weight);
        whole = (part->own >> i) & 1u ? v3_mad(whole, w->toward[i], w->alpha[i]) : whole;
        offset += w->offset_m[i] * weight;
    }
    float length = v3_norm(sum);
    if (length <= 1e-6f * a->sum.area) {
        return 0;
    }
    out->normal_world = v3_scale(sum, 1.0f / length);
    out->offset_m = end_of_overlap(in, a, w, part->share, out->normal_world, offset / length);
    float lowest = cr_lowest(in, index, a, part, out->normal_world, out->offset_m);
    float open = min_f(v3_norm(out_of_all(a, w)) / a->sum.area, length / touched) / OPEN_MIN;
    float held = min_f(1.0f, length / max_f(v3_norm(whole), 1e-20f));
    /* No overlap is deeper than the tool is long. */
    const struct cr_img_meta *meta = in->field->scene->meta;
    float raw_m = min_f(out->offset_m - lowest, 2.0f * min_f(meta->root_radius_m, meta->tool_radius_m));
    out->depth_m = held * raw_m * min_f(1.0f, open);
    /* Less than the rounding of the two heights is no contact; what is no number goes on and is a fault. */
    if (raw_m <= ROUNDING_M + 2e-7f * abs_f(out->offset_m) || out->depth_m <= 0.0f) {
        return 0;
    }
    if (in->config->response == CR_RESPONSE_FIXED45) {
        out->normal_world = turn_to_45(a, part->share, out->normal_world);
    }
    out->point_world_m = acting_point(in, a, w, part->share);
    cr_report_area(a, w->alpha, part->share, out);
    return 1;
}

static uint32_t answer_area(const cr_respond_input *in, uint32_t index, const cr_area_work *a, cr_area *out,
                            uint32_t room) {
    weights w = {{0.0f}, {{0.0f, 0.0f, 0.0f}}, {0.0f}};
    cr_group groups[CR_ZONES_MAX];
    uint32_t made = 0u;
    cr_vec3 s = xform_rotate(in->world_from_tool, v3(-a->sum.ax, -a->sum.ay, -a->sum.az));
    if (in->config->coverage == CR_COVERAGE_HARD && in->config->response == CR_RESPONSE_EXTENT) {
        return cr_answer_as_published(in, index, a, s, out);
    }
    weigh_by_cone(in, a, s, w.alpha);
    make_generators(in, index, a, s, &w);
    uint32_t count = cr_split(in->field->scene, a, w.alpha, groups);
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
