/* relate: zones into half-spaces. WAY_OUT.md "Half-spaces".
 *
 * Zones of one piece of the tool whose static surfaces meet convexly share one way out; those that meet concavely have one each. In
 * between each counts for the other by a part that changes continuously. */
#include "contact/way_out.h"

/* Sine of the elevation of a zone above the plane of another from which on they are apart. */
#define APART_SINE 0.2f
/* Pieces of a surface that are touched nearer to each other than so many samples are apart are told apart as if they were as far: with a sample more or less
 * their means turn. As near as they are, 117 of 146 jumps of the stress campaign are left instead of 102. */
#define NEAR 2.0f
/* What is left of a sum outside the cone of the normals touched is sampling error up to this share of it. Taken out (0) it breaks 52 golden bounds:
 * wall_cube_50 is 0.4 deg off. When nothing that is left counts, 51 of 132 random poses deep inside are cleared instead of 80. */
#define OUTSIDE 0.3f
/* The error is larger where few samples are inside: so many of them, by area, tell of a direction that no normal touched has.
 * Taken out it breaks 21 golden bounds: wall_cube_50 is 4.7 deg off. */
#define SEEN_BY 4.0f
/* A sum tells a way out that no normal touched does where it holds most of all that the tool touches: none up to this share of it. Taken out it
 * breaks 7 golden bounds: the largest error of bar_u's torque is 0.099 mm instead of 0.033. */
#define RULES_FROM 0.5f
/* And where it holds all of its own overlap: as it holds less than this share of it and of what is beside its zones it is a part of one. With 0.5 41 of 12,000 cases of the
 * stress campaign are violated instead of 28; without it ribs and pads that are deeper than half as wide are not felt when there are several:
 * tests/property/test_many_pads.py. */
#define ALL_FROM 0.9f
/* Part of a sum that the normals must explain to lead: in full, and not at all. */
#define LEADS 0.5f
#define LEADS_FROM 0.2f
/* 1 - cosine of two normals from which on they are of sides of their own: the faces of an edge of 120 degrees. Were all facets sides of their own, a ball
 * over the round rim of a cylinder of 96 sides would jump by 0.28 mm: tests/property/test_found_by_rims.py. */
#define OTHER_SIDE 0.5f
/* Share of the weight below which a sum gives no direction. The answer fades; else one of 224 random slow paths more jumps, by 1.1 mm. */
#define OPEN_MIN 0.01f
/* Share of the weight that faces a way which less than SEEN_BY samples tell. The answer fades; else the end of a nut that hardly touches pushes it along its slot by
 * 0.6 mm: tests/property/test_inner_corners.py. */
#define FACING 0.25f
/* Relations that differ by less than this are one. */
#define SAME 1e-3f
/* Difference of two normals from which on they are not one direction. Were none, four pads on a floor would turn the tool: tests/property/test_force_of_way_out.py. */
#define ONE_WAY 0.2f
/* Zones that hold less than this share of their half-space do not lead it: it has its weight from others, which lead their own. */
#define MINOR 0.1f
/* Lead from which on samples of a zone count in full for their own half-space, whatever they count for others: what belongs to two in part is as deep in one of
 * them. At 1 a flat block over a step of 0.5 mm is 17 % short: tests/property/test_found_beside_facets.py. */
#define OWN_FULL 0.667f
/* Most sweeps of the projection into the cone of normals: it ends when no part moves by 1e-6 of the sum. */
#define SWEEPS 32
/* A surface counts for at most this many times what is inside of it: what hardly touches cannot turn the normal. Where less than SEEN_BY samples are
 * inside, which surface they are inside of tells less than which way they face: more by what is missing, up to tenfold. */
#define TWICE 2.0f
/* Before it is known how large all parts of a sum are together, this many times its share of the weight: what weighs next to nothing has no part in that either. With 8 the impeller
 * of tests/property/test_found_by_parts.py kicks by 12.9 mm instead of 12.0, with 2 the gears by 0.29 instead of 0.15. */
#define LOOSE 3.0f
#define SEEN_LEAST 0.1f
/* Weight of two zones, as a share of that of a third, from which on their disagreement counts in full. Whatever they weigh: bar_u amplifies 1.45 instead
 * of 0.62. */
#define COUNTS 0.3f
/* Beyond an end of a facet, from a voxel on, one solid falls by so much of the way at least: END_SINE of host/crease/bake/kinds.py, which is where it was looked. */
#define FALLS 0.5f
/* Of a zone that weighs little more than what there was no room for at least this share is kept: were all as light, none would push. */
#define KEPT_MIN 0.25f
/* Where zones had no room a half-space whose leading zone weighs less than they did fades, as what is gone may have turned its way; else a screw under a ball kicks by 4.9 mm instead
 * of 3.3 (tests/property/test_found_by_parts.py). Up to about half of the share of all that each zone has where all are alike: of those each pushes. */
#define LITTLE 0.02f

/* Not in line: once for each sum of a zone. */
CR_OUT_OF_LINE void lessen(cr_vec3 *sum, float kept) { *sum = v3_scale(*sum, kept); }

/* Which of two zones gives way turns at once as they weigh the same: by then the one that stays is hardly more than none. As much as it holds, 102 of 146 jumps
 * of the stress campaign are left instead of 90. */
void cr_way_lighten(cr_way_zones *zones) {
    for (uint32_t i = 0; i < zones->count; i++) {
        cr_way_zone *z = &zones->zones[i];
        const float kept = max_f(KEPT_MIN, 1.0f - zones->dropped_m3 / z->weight_m3);
        z->weight_m3 *= kept;
        z->area_m2 *= kept;
        lessen(&z->push_m3, kept);
        lessen(&z->turn_m4, kept);
        lessen(&z->centre_m4, kept);
        lessen(&z->normal_m3, kept);
        lessen(&z->above_m4, kept);
    }
}

/* A zone by its means. */
static void find_means(const cr_way_zone *z, uint32_t zone, cr_way_relations *r) {
    CR_ASSERT(!(z->weight_m3 <= 0.0f) && (!z->flat || v3_is_unit(z->plane_normal)));
    const float inverse = 1.0f / z->weight_m3;
    const cr_vec3 centre = v3_scale(z->centre_m4, inverse), n = z->plane_normal;
    if (z->flat) {
        r->normal[zone] = r->unit[zone] = n;
        r->touched[zone] = v3_mad(centre, n, -(v3_dot(n, centre) + z->plane_offset_m));
    } else {
        r->normal[zone] = v3_scale(z->normal_m3, inverse);
        r->unit[zone] = v3_unit(r->normal[zone], 1e-3f);
        r->touched[zone] = v3_mad(centre, z->above_m4, inverse);
    }
}

/* How high one of two places of a surface, with their outward normals, lies above the plane of the other: a sine. */
static float rise_of(cr_vec3 p, cr_vec3 n, cr_vec3 q, cr_vec3 m) {
    const cr_vec3 way = v3_sub(q, p);
    const float far = v3_norm(way), high = max_f(v3_dot(way, n), -v3_dot(way, m));
    return far > 0.0f ? high / far : 0.0f;
}

static float part_at(float rise) { return clamp_f(1.0f - rise / APART_SINE, 0.0f, 1.0f); }

/* Standard deviation of directions whose mean has this length. */
static float spread_of(cr_vec3 mean) { return sqrtf(max_f(0.0f, 2.0f * (1.0f - v3_norm(mean)))); }

/* 1 where two pieces of a surface, by the means of their places and outward normals, bend away from each other or lie in one plane; 0 where they bend
 * towards each other, or one lies above the other. The mean normals are as short as they are spread: so pieces of a sphere are told right whatever their
 * extent. What is nearer than near_m is told apart as if it were so far. */
static float meet(cr_vec3 p, cr_vec3 n, cr_vec3 q, cr_vec3 m, float ended_m, float near_m) {
    const cr_vec3 way = v3_sub(q, p);
    const float far = v3_norm(way), bent = 0.5f * v3_dot(way, v3_sub(n, m));
    const float above = max_f(v3_dot(way, n), -v3_dot(way, m)) - far * (spread_of(n) + spread_of(m));
    return part_at(max_f(ended_m, max_f(bent, above)) / max_f(far, near_m));
}

/* How high a place lies above all that may be of one convex solid with a flat zone: beyond an end of its facet that falls off. */
CR_OUT_OF_LINE float above_end(const cr_scene *s, const xform *pose, const cr_way_zone *z, cr_vec3 p) {
    if (z->flat == 0u) {
        return 0.0f;
    }
    const float margin_m = cr_way_margin(&s->facets[z->key.surface], cr_xform_point(pose, p));
    return FALLS * max_f(0.0f, -margin_m - s->meta->voxel_m) +
           min_f(0.0f, v3_dot(z->plane_normal, p) + z->plane_offset_m);
}

/* The relation of two zones of one piece: by the label of the crease of their patches where there is but one, else by the means, and by where the faces that are
 * touched end: what stands beyond an end, and no lower than one solid could, is another one. A convex crease goes round with two round patches, a bore and its chamfer:
 * sides across the hole do not meet in it, and are told by their means. */
static float meet_static(const cr_scene *s, const xform *pose, const cr_way_zones *zones, const cr_way_relations *r,
                         uint32_t a, uint32_t b, uint32_t label, uint32_t *asked) {
    const cr_way_zone *za = &zones->zones[a], *zb = &zones->zones[b];
    if (za->key.surface == CR_WAY_NONE || zb->key.surface == CR_WAY_NONE ||
        (za->key.surface == zb->key.surface && (za->key.surface & CR_WAY_CURVED) == 0u)) {
        return 1.0f;
    }
    if (label == CR_PAIR_CONCAVE || (label == CR_PAIR_CONVEX && za->flat + zb->flat > 0u)) {
        return label == CR_PAIR_CONVEX ? 1.0f : 0.0f;
    }
    const float ended_m = max_f(above_end(s, pose, za, r->touched[b]), above_end(s, pose, zb, r->touched[a]));
    *asked += 1u;
    return meet(r->touched[a], r->normal[a], r->touched[b], r->normal[b], ended_m, NEAR * s->meta->spacing_m);
}

/* How far two zones that are both related to a third, and are of one piece, are not related to each other. */
static float conflict_of(const cr_way_zones *zones, const cr_way_relations *r, uint32_t a, uint32_t b, uint32_t c) {
    const float less = lower_f(zones->zones[b].weight_m3, zones->zones[c].weight_m3);
    const float counts = lower_f(1.0f, less / (COUNTS * zones->zones[a].weight_m3));
    const float turned = lower_f(1.0f, v3_norm(v3_sub(r->unit[b], r->unit[c])));
    const float both = lower_f(1.0f, 2.0f * r->part[a][b]) * lower_f(1.0f, 2.0f * r->part[a][c]);
    return both * (1.0f - r->part[b][c]) * counts * turned;
}

/* Zones that are related to one but not to each other leave it no direction of its own: it does not lead, as far as they weigh. */
uint32_t cr_way_lead(const cr_way_zones *zones, uint32_t a, cr_way_relations *r) {
    float conflict = 0.0f;
    uint32_t related = 0u;
    for (uint32_t b = 0; b < zones->count; b++) {
        related += (uint32_t)(r->part[a][b] > 0.0f);
        for (uint32_t c = 0; c < b && r->part[a][b] > 0.0f && b != a; c++) {
            const int may = (c != a) & (r->part[a][c] > 0.0f) & (1.0f - r->part[b][c] > conflict);
            if (may && zones->zones[b].key.piece == zones->zones[c].key.piece) {
                conflict = max_f(conflict, conflict_of(zones, r, a, b, c));
            }
        }
    }
    r->lead[a] = 1.0f - conflict;
    return related;
}

/* How far two zones make one side of the obstacle: facets that turn little from each other do. */
static float one_side(cr_vec3 n, cr_vec3 m) { return max_f(0.0f, 1.0f - (1.0f - v3_dot(n, m)) / OTHER_SIDE); }

/* Of the sides that make a sum each counts by what it is of the largest, r: 2.5 r^2 - 1.5 r^3. So a wall leans less towards a face that is little touched, and a
 * face is felt nearly flat until its neighbour takes over; steeper curves are flatter there and turn more sharply beyond (tests/golden/gen/force). How a round
 * side is cut into facets, and which of them make the sum, is all one. */
static cr_vec3 favour_large(uint32_t zones, const cr_vec3 *unit, const float *alpha) {
    float of[CR_WAY_ZONES_MAX], most = 1e-30f;
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f);
    for (uint32_t left = zones; left != 0u;) {
        const int c = take_lane(&left);
        zones &= ~((uint32_t)(alpha[c] <= 0.0f) << c); /* not a number is kept: it is a fault in the end */
    }
    for (uint32_t left = zones; left != 0u;) {
        const int c = take_lane(&left);
        cr_vec3 side = v3(0.0f, 0.0f, 0.0f);
        for (uint32_t others = zones; others != 0u;) {
            const int d = take_lane(&others);
            side = v3_mad(side, unit[d], alpha[d] * one_side(unit[c], unit[d]));
        }
        of[c] = v3_norm(side);
        most = max_f(most, of[c]);
    }
    for (uint32_t left = zones; left != 0u;) {
        const int c = take_lane(&left);
        const float r = of[c] / most; /* cppcheck-suppress uninitvar ; set for the same lanes above */
        sum = v3_mad(sum, unit[c], alpha[c] * r * (2.5f - 1.5f * r));
    }
    return sum;
}

/* The projection begins: alphas that make the sum of the normals, each at most limit times its zone's share of the weight. One that is related by a part only is held
 * back. */
static void begin_projection(const cr_way_zones *zones, const float *part, float limit, cr_way_cone *cone) {
    cone->sweeps = 0u;
    cone->limit = limit;
    for (uint32_t left = cone->zones; left != 0u;) {
        const int c = take_lane(&left);
        cone->held[c] = 1.0f / part[c] - 1.0f;
        cone->most[c] = part[c] * limit * zones->zones[c].weight_m3 * cone->per_weight;
    }
}

/* One sweep of it: projected Gauss-Seidel, on what is left of the sum. Of more than three normals many alphas make the same sum: zones are taken in the order of
 * their keys, or which of these are found would depend on which samples touched first. Returns 1 when it was the last. */
static int sweep(const cr_vec3 *unit, cr_way_cone *cone) {
    float moved = 0.0f;
    cr_vec3 left = cone->left;
    for (uint32_t k = 0; k < cone->count; k++) {
        const uint32_t c = cone->order[k];
        const float before = cone->alpha[c], held = cone->held[c];
        const float next =
            clamp_f(before + (v3_dot(unit[c], left) - held * before) / (1.0f + held), 0.0f, cone->most[c]);
        left = v3_mad(left, unit[c], before - next);
        moved = max_f(moved, abs_f(next - before));
        cone->alpha[c] = next;
    }
    cone->left = left;
    cone->sweeps++;
    return moved <= 1e-6f * v3_norm(cone->sum) || cone->sweeps == SWEEPS;
}

/* Once more, so that what hardly touches does not turn the normal. */
static void limit_projection(const cr_way_zones *zones, const float *part, cr_way_cone *cone) {
    float whole = 0.0f;
    for (uint32_t left = cone->zones; left != 0u;) {
        whole += cone->alpha[take_lane(&left)];
    }
    begin_projection(zones, part, TWICE * whole / max_f(cone->seen * cone->known, 1e-6f), cone);
}

/* Room for one more bound of this weight: where there is none, that of the lightest. Null when none is lighter. dropped_m3: of the heaviest without room. */
static cr_way_bound *bound_for(cr_way_half *out, float weight_m3, float *dropped_m3) {
    if (out->bound_count < CR_WAY_BOUNDS_MAX) {
        return &out->bounds[out->bound_count++];
    }
    cr_way_bound *least = &out->bounds[0];
    for (uint32_t b = 1; b < CR_WAY_BOUNDS_MAX; b++) {
        least = out->bounds[b].weight_m3 < least->weight_m3 ? &out->bounds[b] : least;
    }
    *dropped_m3 = higher_f(*dropped_m3, lower_f(least->weight_m3, weight_m3));
    return least->weight_m3 < weight_m3 ? least : NULL;
}

/* Planes that zone a is below: of the flat zones that it is related to and does not lie above, the weightiest; each is of one zone. */
static void find_bounds(const cr_scene *scene, const cr_way_zones *zones, const cr_way_relations *r, uint32_t a,
                        cr_way_half *out) {
    float dropped_m3 = 0.0f;
    out->bound_count = 0u;
    for (uint32_t c = 0; c < zones->count; c++) {
        const cr_way_zone *z = &zones->zones[c];
        const int sure = a == c || (z->patch != zones->zones[a].patch &&
                                    cr_pair_label(scene, z->patch, zones->zones[a].patch) == CR_PAIR_CONVEX);
        const float held =
            r->part[a][c] * (sure ? 1.0f : part_at(rise_of(r->touched[a], r->unit[a], r->touched[c], r->unit[c])));
        if ((z->key.surface & CR_WAY_CURVED) != 0u || !(held > 0.0f)) {
            continue;
        }
        cr_way_bound *bound = bound_for(out, held * z->weight_m3, &dropped_m3);
        if (bound != NULL) {
            *bound = (cr_way_bound){z->key.surface, r->unit[c],     -v3_dot(r->unit[c], r->touched[c]),
                                    held,           (uint32_t)sure, held * z->weight_m3};
        }
    }
    /* which of two gives way turns at once: by then the one that stays bounds nothing */
    for (uint32_t b = 0; b < out->bound_count; b++) {
        out->bounds[b].weight_m3 -= dropped_m3;
    }
}

static int rows_agree(const float *a, const float *b, uint32_t count) {
    for (uint32_t c = 0; c < count; c++) {
        if (abs_f(a[c] - b[c]) > SAME) {
            return 0;
        }
    }
    return 1;
}

/* The sum of the zones that one zone is related to, each by its part, and the projection of it into the cone of their normals. */
static void begin_half(const cr_way_zones *zones, const cr_way_relations *r, uint32_t zone, float spacing_m,
                       cr_way_half *out, cr_way_cone *cone) {
    const cr_vec3 *unit = r->unit;
    const float *part = r->part[zone];
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f), turn = sum, centre = sum;
    float weight = 0.0f, area = 0.0f, bends = 0.0f, bent = 0.0f;
    float known = 0.0f, beside = 0.0f; /* of the weight, what has a normal; and what is beside it */
    const float per_all = 1.0f / r->all_m3;
    out->zones = out->bound_count = 0u;
    out->led_m3 = out->joined_m3 = out->depth_m = out->deep_m = out->curved_m3 = 0.0f;
    cone->zones = cone->count = cone->projected = 0u;
    for (uint32_t k = 0; k < zones->count; k++) {
        const uint32_t c = r->order[k];
        const cr_way_zone *z = &zones->zones[c];
        if (!(part[c] > 0.0f)) {
            continue;
        }
        cone->zones |= 1u << c;
        cone->order[cone->count++] = (uint8_t)c;
        out->deep_m = max_f(out->deep_m, part[c] * z->deep_m);
        sum = v3_mad(sum, z->push_m3, part[c]);
        turn = v3_mad(turn, z->turn_m4, part[c]);
        centre = v3_mad(centre, z->centre_m4, part[c]);
        weight += part[c] * z->weight_m3;
        known += part[c] * z->weight_m3 * v3_dot(unit[c], unit[c]);
        beside += part[c] * z->weight_m3 * per_all * r->beside_m3[c];
        area += part[c] * z->area_m2;
        out->curved_m3 += z->flat ? 0.0f : part[c] * z->weight_m3;
        if (!z->flat && z->patch != CR_FACET_NONE) {
            bends += part[c] * z->weight_m3;
            bent += part[c] * z->weight_m3 * spread_of(v3_scale(z->normal_m3, 1.0f / z->weight_m3));
        }
    }
    /* Per weight: squares of the sums of a tool of micrometres would be no numbers of 32 bits. */
    const float per_weight = 1.0f / weight;
    const float share = weight * per_all, all = weight / (weight + beside / share);
    const float most = (share - RULES_FROM) / (1.0f - RULES_FROM);
    const float rules = clamp_f(max_f(most, (all - ALL_FROM) / (1.0f - ALL_FROM)), 0.0f, 1.0f);
    const float samples = area / (spacing_m * spacing_m);
    out->weight_m3 = weight;
    out->own_m = v3_scale(turn, per_weight);   /* yet of the sum, */
    out->arm_m = v3_scale(centre, per_weight); /* and the middle */
    cone->per_weight = per_weight;
    cone->trusted = rules * clamp_f((samples - 1.0f) / (SEEN_BY - 1.0f), 0.0f, 1.0f);
    cone->seen = clamp_f(samples / SEEN_BY, SEEN_LEAST, 1.0f);
    cone->bent = bent * per_weight * bends * per_weight;
    cone->sum = cone->left = v3_scale(sum, per_weight);
    for (uint32_t left = cone->zones; left != 0u;) {
        const int c = take_lane(&left);
        cone->alpha[c] = part[c] * max_f(0.0f, v3_dot(v3_scale(zones->zones[c].push_m3, per_weight), unit[c]));
        cone->left = v3_mad(cone->left, unit[c], -cone->alpha[c]);
    }
    cone->known = known * per_weight;
    begin_projection(zones, part, LOOSE / cone->seen, cone);
}

/* Share of the weight that faces a way, of FACING: 1 where more does. */
static float facing(const cr_vec3 *unit, const cr_way_cone *cone, cr_vec3 way) {
    float faces = 0.0f;
    for (uint32_t left = cone->zones; left != 0u;) {
        const int c = take_lane(&left);
        faces += cone->most[c] * higher_f(0.0f, v3_dot(unit[c], way));
    }
    return min_f(1.0f, faces / higher_f(FACING * cone->limit, 1e-30f));
}

/* Normal and arm of a half-space: the part of the sum in the cone of the normals that it is related to, and what is outside, as far as it is trusted: beyond
 * sampling error, and where most of what is touched bends, as far as its normals are spread: their mean turns as facets come and go, the sum does not. */
static void end_half(const cr_vec3 *unit, const cr_way_cone *cone, cr_way_half *out) {
    const float size = v3_norm(cone->sum), per_left = size / max_f(v3_norm(cone->left), 1e-30f);
    const cr_vec3 way = v3_mad(favour_large(cone->zones, unit, cone->alpha), cone->left,
                               cone->trusted * max_f(1.0f - OUTSIDE * per_left, min_f(1.0f, cone->bent * per_left)));
    const float length = v3_norm(way),
                led = (length - LEADS_FROM * size) / ((LEADS - LEADS_FROM) * max_f(size, 1e-30f));
    const cr_vec3 couple = v3_sub(out->own_m, v3_cross(out->arm_m, cone->sum)); /* of all of it, about the middle */
    out->normal = v3_unit(way, 1e-6f);
    out->own_m = v3_mad(v3_cross(out->arm_m, out->normal), couple, 1.0f / max_f(max_f(length, size), 1e-30f));
    const float few = (1.0f - cone->seen) / (1.0f - SEEN_LEAST), faced = facing(unit, cone, out->normal);
    out->open = min_f(1.0f, size / OPEN_MIN) * clamp_f(led, 0.0f, 1.0f) * (1.0f - few * (1.0f - faced * faced));
}

static int is_before(const cr_way_key *a, const cr_way_key *b) {
    if (a->surface != b->surface) {
        return a->surface < b->surface;
    }
    return a->piece != b->piece ? a->piece < b->piece : a->side < b->side;
}

static void put_in_order(const cr_way_zones *zones, uint32_t zone, cr_way_relations *r) {
    uint32_t k = zone;
    for (; k > 0u && is_before(&zones->zones[zone].key, &zones->zones[r->order[k - 1u]].key); k--) {
        r->order[k] = r->order[k - 1u];
    }
    r->order[k] = (uint8_t)zone;
}

uint32_t cr_way_relate(const cr_scene *scene, const xform *pose, const cr_way_zones *zones, uint32_t zone,
                       cr_way_relations *r) {
    const cr_way_zone *z = &zones->zones[zone];
    uint32_t asked = 0u;
    CR_ASSERT(zone < zones->count && zones->count <= CR_WAY_ZONES_MAX);
    find_means(z, zone, r);
    put_in_order(zones, zone, r);
    r->beside_m3[zone] = 0.0f;
    r->all_m3 += z->weight_m3;
    r->part[zone][zone] = 1.0f;
    for (uint32_t b = 0; b < zone; b++) {
        const cr_way_zone *o = &zones->zones[b];
        const int same = (z->patch == o->patch) | (z->patch == CR_FACET_NONE) | (o->patch == CR_FACET_NONE);
        const uint32_t label = same ? 0u : cr_pair_label(scene, z->patch, o->patch);
        const int one = z->key.piece == o->key.piece;
        const float part = one ? meet_static(scene, pose, zones, r, zone, b, label, &asked) : 0.0f;
        const float beside = (same & !one) != 0 || label != 0u ? 1.0f - part : 0.0f;
        r->part[zone][b] = r->part[b][zone] = part;
        r->beside_m3[zone] += beside * o->weight_m3;
        r->beside_m3[b] += beside * z->weight_m3;
        CR_ASSERT(!(part < 0.0f || part > 1.0f));
    }
    return asked;
}

uint32_t cr_way_join(const cr_scene *scene, const cr_way_zones *zones, uint32_t zone, cr_way_relations *r,
                     cr_way_half *halves, cr_way_cone *cone) {
    uint32_t h = 0u, made = 0u;
    CR_ASSERT(zone < zones->count && r->half_count <= zone); /* no more half-spaces than zones that have joined */
    while (h < r->half_count && !rows_agree(r->part[zone], r->part[r->first[h]], zones->count)) {
        h++;
    }
    cr_way_half *half = &halves[h];
    if (h == r->half_count) {
        begin_half(zones, r, zone, scene->meta->spacing_m, half, cone);
        r->first[r->half_count++] = zone;
        made = cone->zones;
    }
    CR_ASSERT(!has_lane(half->zones, (int)zone));
    half->zones |= 1u << zone;
    half->joined_m3 += zones->zones[zone].weight_m3;
    if (zones->zones[zone].weight_m3 > half->led_m3) {
        half->led_m3 = zones->zones[zone].weight_m3;
        find_bounds(scene, zones, r, zone, half);
    }
    r->half_of[zone] = h;
    return made;
}

int cr_way_turn(const cr_way_zones *zones, uint32_t zone, const cr_way_relations *r, cr_way_half *halves,
                cr_way_cone *cone) {
    if (cone->projected == 2u) {
        end_half(r->unit, cone, &halves[r->half_of[zone]]);
        return 1;
    }
    if (sweep(r->unit, cone) && cone->projected++ == 0u) {
        limit_projection(zones, r->part[zone], cone);
    }
    return 0;
}

/* Most weight of a zone that leads it; one that could lead two is related to nearly the same weight counts as far as it is. */
uint32_t cr_way_agree(const cr_way_zones *zones, const cr_way_relations *r, uint32_t index, cr_way_half *halves) {
    cr_way_half *half = &halves[index];
    const float little_m3 = lower_f(zones->dropped_m3, LITTLE * r->all_m3);
    const float enough = higher_f(MINOR * half->weight_m3, little_m3), *own = r->part[r->first[index]];
    float led = half->led_m3;
    uint32_t compared = 0u;
    CR_ASSERT(index < r->half_count);
    for (uint32_t c = 0; c < zones->count && led < enough; c++) {
        const float spare = 2.0f * zones->zones[c].weight_m3 - enough;
        float apart = 0.0f; /* weight that it is not related to alike */
        if (!(spare > led)) {
            continue;
        }
        for (uint32_t d = 0; d < zones->count && apart < enough; d++) {
            apart += abs_f(r->part[c][d] - own[d]) * zones->zones[d].weight_m3;
        }
        compared++;
        led = max_f(led, spare * max_f(0.0f, 1.0f - apart / enough));
    }
    half->open *= min_f(1.0f, led / enough);
    return compared;
}

uint32_t cr_way_tell_counts(uint32_t count, uint32_t a, cr_way_relations *r) {
    const float lead = r->lead[a];
    float *part = r->part[a], led = 0.0f;
    uint32_t counts = 0u;
    r->counts_for[a] = 1u << a;
    if (!(lead < 1.0f)) {
        return 0u;
    }
    for (uint32_t b = 0; b < count; b++) {
        led = b == a ? led : max_f(led, part[b] * r->lead[b]);
        part[b] = (1.0f - lead) * part[b] * r->lead[b];
    }
    part[a] = 1.0f - higher_f(0.0f, 1.0f - lead * (1.0f / OWN_FULL)) * led;
    for (uint32_t b = 0; b < count; b++) {
        counts |= (uint32_t)(part[b] > 0.0f) << b;
    }
    r->counts_for[a] = counts;
    return count;
}

/* The sum of the moments of one direction acts for each half-space, by their weights, so that which of them is deepest by a hair does not matter. One that
 * does not push has no part in it: its arm is a moment over next to no force. */
void cr_way_share_arm(uint32_t count, uint32_t index, cr_way_half *halves) {
    cr_vec3 sum = v3(0.0f, 0.0f, 0.0f);
    float total = 0.0f;
    CR_ASSERT(index < count);
    for (uint32_t j = 0; j < count; j++) {
        const cr_way_half *h = &halves[j];
        const float one = clamp_f(1.0f - v3_norm(v3_sub(halves[index].normal, h->normal)) / ONE_WAY, 0.0f, 1.0f);
        const float counts = one * h->open * h->joined_m3;
        sum = v3_mad(sum, h->own_m, counts);
        total += counts;
    }
    halves[index].arm_m = total <= 0.0f ? halves[index].own_m : v3_scale(sum, 1.0f / total);
}
