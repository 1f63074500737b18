/* layers: what the samples of a cluster are inside of, surface by surface, and how deep. WAY_OUT.md "Zones". */
#include "contact/way_out.h"

/* Least share of the full width over which the depth of a piece, or of a part of one, fades in: with half of it the block in the groove is 0.5 degrees off as a wall lets go. */
#define WIDTH_MIN 0.25f
/* Times that the parts of a piece tell more of its depth than its coverage, or less, at most. Whatever they tell, a cube that comes down on an edge of 25 degrees is pushed 0.12 mm farther within a
 * micrometre instead of 0.016. */
#define PARTS_MOST 4.0f

float cr_way_share(cr_vec3 g, uint32_t side) {
    const float parts[3] = {g.x, g.y, g.z}, length2 = v3_dot(g, g);
    const float along = parts[side >> 1] * ((side & 1u) != 0u ? -1.0f : 1.0f);
    /* less than rounding is none: a weight that small has no mean */
    return along > 0.0f && length2 > 0.0f ? max_f(0.0f, along * along / length2 - 1e-12f) : 0.0f;
}

/* Saturation of an image's distances beside the diagonal of a brick, as a share of how far its bricks reach: host/crease/bake/voxmap.py. With 1, a cube
 * that a wall swallows is let go by jumps of 1 mm, without the passage of 8, instead of 0.2: tests/property/test_force_of_way_out.py. */
#define BAND_PER_REACH 1.1f
/* Work, in parts of a unit: of a lane that is asked what it is over, again over one surface, thrice over several; of each plane that a lane may count for, and
 * two more, and a layer that something counts for, beside others, four a part; of a facet that a lane may count for, and
 * again, if it is curved; of a layer that is made; of a cell, and each of its planes; of each layer of a lane that may fade, and two more. */
#define PARTS_OF_LANE 12u
#define PARTS_OF_SHARE 9u
#define PARTS_OF_CUT 32u
#define PARTS_OF_FACET 36u
#define PARTS_OF_CURVED 12u
#define PARTS_OF_MADE 24u
#define PARTS_OF_PLANE 32u
#define PARTS_OF_FADED 3u

/* The layer of a surface, made when missing; null, and counted, when all are taken. */
static cr_way_layer *layer_of(cr_way_layers *l, uint32_t surface, uint32_t patch) {
    CR_ASSERT(l->count <= CR_WAY_LAYERS_MAX);
    l->parts += PARTS_OF_SHARE + l->count / 4u;
    for (uint32_t k = 0; k < l->count; k++) {
        if (l->layers[k].surface == surface) {
            return &l->layers[k];
        }
    }
    if (l->count == CR_WAY_LAYERS_MAX) {
        l->dropped++;
        return NULL;
    }
    cr_way_layer *made = &l->layers[l->count++];
    l->parts += PARTS_OF_MADE;
    made->surface = surface;
    made->patch = patch;
    made->lanes = 0u;
    for (int i = 0; i < CR_LANES; i++) {
        made->depth_m[i] = made->coverage[i] = 0.0f;
    }
    for (int i = 0; i < CR_LANES && surface >= CR_WAY_CURVED; i++) {
        made->normal_m.x[i] = made->normal_m.y[i] = made->normal_m.z[i] = 0.0f;
    }
    return made;
}

/* Part of a piece that is inside, the mean depth of all of it, what is outside counting as zero, and the width over which the height varies. */
typedef struct {
    float share, depth_m, across_m;
} part;

/* Of a piece over one plane. Across it the height varies evenly by sqrt(n W n), as the coverage has it. */
CR_IN_LANES part part_below(const struct cr_img_cluster *c, int i, cr_vec3 n, float height_m) {
    const float across = piece_width(c, i, n), most = 2.0f * c->ramp[i];
    CR_ASSERT(v3_is_unit_or_zero(n));
    const float width = clamp_f(across, WIDTH_MIN * most, most);
    part p = {clamp_f(0.5f - height_m / width, 0.0f, 1.0f), 0.0f, across};
    p.depth_m = p.share < 1.0f ? 0.5f * width * p.share * p.share : -height_m;
    return p;
}

/* How deep it is at most. */
static float deepest(part p, float height_m) { return 0.5f * CR_WAY_END * p.across_m - height_m; }

/* Mean depth where other planes cut the piece too: by what they leave of it. */
static float depth_left(part of_nearest, float coverage) {
    return of_nearest.share > 0.0f ? of_nearest.depth_m * min_f(1.0f, coverage / of_nearest.share) : 0.0f;
}

/* The same below the nearest of several planes, as far as they are a corner. */
static float depth_below_corner(const struct cr_img_cluster *c, int i, part p, float height_m, float corner,
                                float coverage) {
    const float ramp = c->ramp[i], most = 2.0f * ramp;
    if (height_m <= -(corner > 0.0f ? CR_CORNER_REACH : 1.0f) * ramp) {
        return -height_m * coverage; /* all of it is below, however wide it is */
    }
    if (corner > 0.0f) {
        const float width = clamp_f(p.across_m, WIDTH_MIN * most, most), at = height_m / width,
                    rest = cr_rest_of_square(at);
        p.share += corner * (cr_square_below(at, rest) - p.share);
        p.depth_m += corner * (width * cr_square_depth(at, rest) - p.depth_m);
    }
    return depth_left(p, coverage);
}

/* All lanes over one plane, heights in the tool frame. Returns how deep they are at most. */
static float fill_flat(const struct cr_img_cluster *c, uint32_t lanes, uint32_t near, cr_vec3 n, const float *height_m,
                       cr_way_layer *out) {
    float deep = 0.0f, each[CR_LANES];
    for (int i = lane_at(near, 0); i < CR_LANES; i = lane_at(near, i + 1)) {
        const part p = part_below(c, i, n, height_m[i]);
        out->depth_m[i] = has_lane(lanes, i) ? p.depth_m : out->depth_m[i]; /* others may be known from another cell */
        out->coverage[i] = has_lane(lanes, i) ? p.share : out->coverage[i];
        const float on = CR_SCALAR ? 1.0f : (float)((near >> i) & 1u);
        each[i] = on * deepest(p, height_m[i]);
        deep = CR_SCALAR ? higher_f(deep, each[i]) : 0.0f;
    }
    for (int i = 0; i < CR_LANES && !CR_SCALAR; i++) {
        deep = higher_f(deep, each[i]);
    }
    out->lanes |= lanes;
    return deep;
}

static void add_lane(cr_way_layer *layer, int i, float depth_m, float coverage) {
    layer->lanes |= 1u << i;
    layer->depth_m[i] += depth_m;
    layer->coverage[i] += coverage;
}

static void lane_to(cr_way_layers *l, uint32_t surface, uint32_t patch, int i, float depth_m, float coverage) {
    cr_way_layer *layer = depth_m > 0.0f ? layer_of(l, surface, patch) : NULL;
    if (layer != NULL) {
        add_lane(layer, i, depth_m, coverage);
    }
}

/* A piece that two planes cut counts in parts, side by side from one to the other. */
#define PARTS 4
/* From the middle of the piece to that of an outer part, in widths. */
#define OUTERMOST 0.375f
/* A plane that is so many ramps lower than another is nowhere nearer: the piece is two ramps wide at most, and the normals are less than 2 apart. */
#define CUT_REACH (4.0f * OUTERMOST)

/* Mean depth of a part whose middle is so far above a plane, in widths of a part. */
static float depth_of_part(float height) {
    const float in = clamp_f(0.5f - height, 0.0f, 1.0f);
    return in < 1.0f ? 0.5f * in * in : -height;
}

/* What another plane takes from the mean depth of a piece below its nearest: of the parts that are nearer to it. */
static float taken_by(const struct cr_img_cluster *c, int i, cr_vec3 n, float height_m, cr_vec3 other, float other_m) {
    const cr_vec3 apart = v3_sub(other, n), spread = spread_times(c, i, apart);
    const float across2 = v3_dot(apart, spread), gap_m = height_m - other_m;
    const float most = 2.0f * c->ramp[i], across = sqrtf(higher_f(across2, 1e-14f));
    if (!(gap_m < OUTERMOST * across)) {
        return 0.0f;
    }
    const float per = 1.0f / across;
    const float rise = per * v3_dot(spread, n), others = per * v3_dot(spread, other);
    const float along2 = higher_f(0.0f, v3_dot(n, spread_times(c, i, n)) - rise * rise);
    const float each2 = (rise * rise + others * others) * (0.5f / (PARTS * PARTS));
    const float width = clamp_f(sqrtf(along2 + each2), WIDTH_MIN * most, most), in_widths = 1.0f / width;
    float at = -OUTERMOST, taken = 0.0f;
    for (int j = 0; j < PARTS; j++) {
        const float its = (height_m + at * rise) * in_widths, top = (other_m + at * others) * in_widths;
        taken += top > its ? depth_of_part(its) - depth_of_part(top) : 0.0f;
        at += 1.0f / PARTS;
    }
    return (1.0f / PARTS) * width * taken;
}

/* A lane counts for its nearest plane, shared with those that are as near within half the width of its piece. of: layers of the planes, as far as they were asked for (bits). */
static void fill_lane_over_solid(const cr_scene *s, const struct cr_img_cluster *c, int i, uint32_t top, float coverage,
                                 const cr_planes *p, const cr_heights *h, cr_way_layers *out, cr_way_layer **of,
                                 uint32_t *asked) {
    const uint32_t count = p->count;
    float height_m[CR_KIND_FACETS_MAX], share[CR_KIND_FACETS_MAX], corner = 0.0f, total = 0.0f;
    if (p->reach > 1.0f) {
        out->parts += PARTS_OF_SHARE * count;
        for (uint32_t k = 0; k < count; k++) {
            height_m[k] = h->height_m[k][i];
        }
        corner = cr_corner_part(height_m, count, c->ramp[i]);
    }
    const float top_m = h->top_m[i], reach_m = cr_corner_reach(corner) * c->ramp[i];
    const part all = {1.0f, -top_m, 0.0f}; /* of it is below, however wide it is */
    const part whole = top_m > -CR_CORNER_REACH * c->ramp[i] ? part_below(c, i, p->normal_tool[top], top_m) : all;
    float depth = depth_below_corner(c, i, whole, top_m, corner, coverage), second_m = -3.4e38f;
    uint32_t second = top;
    out->parts += PARTS_OF_SHARE * (2u + count);
    for (uint32_t k = 0; k < count; k++) {
        const float its_m = h->height_m[k][i];
        share[k] = max_f(0.0f, its_m - top_m + reach_m);
        total += share[k];
        if (k != top && its_m > second_m) {
            second = k;
            second_m = its_m;
        }
    }
    if (corner < 1.0f && top_m - second_m < CUT_REACH * c->ramp[i]) {
        const float taken = taken_by(c, i, p->normal_tool[top], top_m, p->normal_tool[second], second_m);
        const float deep = clamp_f(whole.depth_m - taken, depth / PARTS_MOST, depth * PARTS_MOST);
        depth = deep + corner * (depth - deep);
        out->parts += PARTS_OF_CUT;
    }
    out->deep_m = higher_f(out->deep_m, depth);
    for (uint32_t k = 0; k < count; k++) {
        const float its = share[k] > 0.0f ? share[k] / total : 0.0f, deep = depth * its;
        if (!(deep > 0.0f)) {
            continue;
        }
        if (!has_lane(*asked, (int)k)) {
            of[k] = layer_of(out, p->facet[k], s->facets[p->facet[k]].patch);
            *asked |= 1u << k;
        }
        if (of[k] != NULL) {
            add_lane(of[k], i, deep, coverage * its);
        }
    }
}

/* Samples behind walls that meet concavely: inside of each by its own height. Their planes are turned inside out. */
static void fill_behind_walls(const cr_scene *s, const struct cr_img_cluster *c, uint32_t lanes, const cr_planes *p,
                              const cr_heights *h, cr_way_layers *out) {
    float height_m[CR_LANES];
    out->parts += PARTS_OF_LANE * p->count * (1u + cr_count_lanes(out->near));
    for (uint32_t k = 0; k < p->count; k++) {
        cr_way_layer *wall = layer_of(out, p->facet[k], s->facets[p->facet[k]].patch);
        if (wall != NULL) {
            for (int i = 0; i < CR_LANES; i++) {
                height_m[i] = -h->height_m[k][i];
            }
            out->deep_m += fill_flat(c, lanes, out->near, v3_scale(p->normal_tool[k], -1.0f), height_m, wall);
        }
    }
}

/* All lanes are over one surface: how deep they are below planes like this. */
static void reach_to(cr_way_layers *l, cr_vec3 n, float spread, float deep_m) {
    l->deep_m += deep_m;
    l->reach.toward = n;
    l->reach.spread = spread;
    l->reach.bound_m = deep_m;
}

void cr_way_over_planes(const cr_scene *s, const struct cr_img_cluster *c, uint32_t lanes, const float *coverage,
                        const cr_planes *p, const cr_heights *h, cr_way_layers *out) {
    if (p->sign < 0.0f) {
        fill_behind_walls(s, c, lanes, p, h, out);
        return;
    }
    if (p->count == 1u) {
        cr_way_layer *floor = layer_of(out, p->facet[0], s->facets[p->facet[0]].patch);
        out->parts += PARTS_OF_LANE * cr_count_lanes(out->near);
        if (floor != NULL) {
            reach_to(out, p->normal_tool[0], 0.0f,
                     fill_flat(c, lanes, out->near, p->normal_tool[0], h->height_m[0], floor));
        }
        return;
    }
    cr_way_layer *of[CR_KIND_FACETS_MAX];
    uint32_t asked = 0u;
    for (uint32_t top = 0; top < p->count; top++) {
        for (uint32_t left = lanes & h->highest[top]; left != 0u;) {
            const int i = take_lane(&left);
            fill_lane_over_solid(s, c, i, top, coverage[i], p, h, out, of, &asked);
        }
    }
}

/* A lane inside of a curved surface, which has a normal of its own there. */
static void lane_to_curved(cr_way_layers *l, const xform *pose, uint32_t surface, uint32_t patch, int i,
                           cr_vec3 n_world, float depth_m, float coverage) {
    cr_way_layer *layer = depth_m > 0.0f ? layer_of(l, surface, patch) : NULL;
    l->parts += PARTS_OF_CURVED;
    if (layer != NULL) {
        const cr_vec3 n = xform_unrotate(pose, n_world);
        add_lane(layer, i, depth_m, coverage);
        layer->normal_m.x[i] += depth_m * n.x;
        layer->normal_m.y[i] += depth_m * n.y;
        layer->normal_m.z[i] += depth_m * n.z;
    }
}

/* A looked-up lane: its facets are known, or only the direction of the distance, or nothing. */
static void fill_looked_up(const cr_field *f, const xform *pose, const cr_way_facets *on, int i, cr_vec3 g_world,
                           float depth_m, float coverage, cr_way_layers *out) {
    if (on->count == 0u && v3_dot(g_world, g_world) > 0.5f) {
        lane_to_curved(out, pose, CR_WAY_DEEP, CR_FACET_NONE, i, g_world, depth_m, coverage);
    } else if (on->count == 0u) {
        lane_to(out, CR_WAY_NONE, CR_FACET_NONE, i, depth_m, coverage);
    }
    out->parts += PARTS_OF_FACET * on->count;
    for (uint32_t k = 0; k < on->count; k++) {
        const struct cr_img_facet *facet = &f->scene->facets[on->facet[k]];
        const float share = on->share[k];
        if (facet->curved == CR_FACET_CURVED) {
            lane_to_curved(out, pose, CR_WAY_CURVED | facet->patch, facet->patch, i, on->normal[k], depth_m * share,
                           coverage * share);
        } else {
            lane_to(out, on->facet[k], facet->patch, i, depth_m * share, coverage * share);
        }
    }
}

uint32_t cr_way_common(const cr_field *f, const cr_lookup *at, uint32_t lanes) {
    uint32_t common = CR_WAY_NONE, last = CR_TOP_FAR;
    if ((lanes & at->on_planes) != 0u) {
        return CR_WAY_NONE;
    }
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        const uint32_t entry = at->entry[i];
        if (entry == last) {
            continue;
        }
        if ((entry & CR_TOP_FAR) != 0u) {
            return CR_WAY_NONE;
        }
        const struct cr_img_kind *kind = &f->scene->kinds[cr_field_kind(f, at, i)];
        if (kind->count != 1u) {
            return CR_WAY_NONE;
        }
        const struct cr_img_facet *facet = &f->scene->facets[kind->facet[0]];
        const uint32_t surface = facet->curved == CR_FACET_CURVED ? CR_WAY_CURVED | facet->patch : kind->facet[0];
        if (common != CR_WAY_NONE && surface != common) {
            return CR_WAY_NONE;
        }
        common = surface;
        last = f->scene->bricks[entry].cells == CR_CELLS_NONE ? entry : last;
    }
    return common;
}

/* All lanes over one curved surface: as one, to the sides by the mean of their normals. */
static void fill_curved(const struct cr_img_cluster *c, uint32_t lanes, const cr_lookup *at, const cr_lanes3 *g,
                        cr_way_layers *out, cr_way_layer *layer) {
    float deep = 0.0f, apart2 = 0.0f;
    for (int i = lane_at(out->near, 0); i < CR_LANES; i = lane_at(out->near, i + 1)) {
        const cr_vec3 n = v3(g->x[i], g->y[i], g->z[i]);
        const part p = part_below(c, i, n, at->phi_m[i]);
        const float in = (float)((lanes >> i) & 1u), near = (float)((out->near >> i) & 1u);
        const float x = n.x - g->x[0], y = n.y - g->y[0], z = n.z - g->z[0];
        layer->depth_m[i] = out->full_m[i] = in * p.depth_m;
        layer->normal_m.x[i] = layer->depth_m[i] * n.x;
        layer->normal_m.y[i] = layer->depth_m[i] * n.y;
        layer->normal_m.z[i] = layer->depth_m[i] * n.z;
        layer->coverage[i] = in * p.share;
        deep = higher_f(deep, near * deepest(p, at->phi_m[i]));
        apart2 = higher_f(apart2, near * (x * x + y * y + z * z));
    }
    layer->lanes |= lanes;
    reach_to(out, v3(g->x[0], g->y[0], g->z[0]), sqrtf(apart2), deep);
}

/* All lanes over one facet that is not curved. */
static void fill_facet(const cr_field *f, const xform *pose, const struct cr_img_cluster *c, uint32_t lanes,
                       uint32_t index, cr_way_layers *out, cr_way_layer *floor) {
    float height_m[CR_LANES];
    const cr_vec3 n = cr_way_heights(f->scene, pose, c, index, height_m);
    reach_to(out, n, 0.0f, fill_flat(c, lanes, out->near, n, height_m, floor));
}

static void fill_common(const cr_field *f, const xform *pose, const struct cr_img_cluster *c, uint32_t lanes,
                        uint32_t surface, const cr_lookup *at, const cr_lanes3 *g, cr_way_layers *out) {
    const int curved = (surface & CR_WAY_CURVED) != 0u;
    const uint32_t patch = curved ? surface & ~CR_WAY_CURVED : f->scene->facets[surface].patch;
    cr_way_layer *layer = layer_of(out, surface, patch);
    out->parts += PARTS_OF_LANE * cr_count_lanes(out->near);
    if (layer != NULL && curved) {
        fill_curved(c, lanes, at, g, out, layer);
    } else if (layer != NULL) {
        fill_facet(f, pose, c, lanes, surface, out, layer);
    }
}

float cr_way_plane(const cr_scene *s, const xform *pose, uint32_t index, cr_vec3 *normal) {
    const struct cr_img_facet *facet = &s->facets[index];
    *normal = xform_unrotate(pose, v3_from(facet->normal));
    return v3_dot(v3_from(facet->normal), pose->t) - facet->offset_m;
}

cr_vec3 cr_way_heights(const cr_scene *s, const xform *pose, const struct cr_img_cluster *c, uint32_t index,
                       float *height_m) {
    cr_vec3 n;
    const float offset_m = cr_way_plane(s, pose, index, &n);
    for (int i = 0; i < CR_LANES; i++) {
        height_m[i] = height_above(c, i, n, offset_m);
    }
    return n;
}

void cr_way_normals(const xform *pose, const float *gx, const float *gy, const float *gz, uint32_t lanes,
                    cr_lanes3 *g) {
    const xform m = *pose;
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float x = gx[i], y = gy[i], z = gz[i], length2 = x * x + y * y + z * z;
        const float per = length2 > 1e-6f ? 1.0f / sqrtf(length2) : 0.0f;
        g->x[i] = (m.r0.x * x + m.r1.x * y + m.r2.x * z) * per;
        g->y[i] = (m.r0.y * x + m.r1.y * y + m.r2.y * z) * per;
        g->z[i] = (m.r0.z * x + m.r1.z * y + m.r2.z * z) * per;
    }
}

uint32_t cr_way_same_cell(const cr_lookup *at, uint32_t lanes) {
    uint32_t same = 0u, left = lanes;
    const uint32_t kind = at->kind[take_lane(&left)];
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        same |= (uint32_t)(at->kind[i] == kind) << i;
    }
    return same;
}

/* Lanes in one cell whose planes give the distance. */
static void fill_over_cell(const cr_field *f, const xform *pose, const struct cr_img_cluster *c, uint32_t lanes,
                           const float *coverage, const cr_lookup *at, cr_way_layers *out) {
    cr_planes planes;
    cr_heights heights;
    uint32_t first = lanes;
    const uint32_t kind = at->kind[take_lane(&first)];
    cr_planes_turn(f->scene, pose, kind, &planes);
    out->planes = lanes == out->near ? kind : 0u;
    cr_planes_measure(&planes, c, &heights);
    out->parts += PARTS_OF_PLANE * (1u + planes.count);
    cr_way_over_planes(f->scene, c, lanes, coverage, &planes, &heights, out);
    out->reach.spread = out->planes != 0u ? out->reach.spread : CR_WAY_NO_SPREAD;
}

/* A lane in a cell whose distances are not from planes. */
static void fill_over_samples(const cr_field *f, const xform *pose, const cr_looked *l, int i, cr_way_layers *out) {
    const cr_lookup *at = l->at;
    const part in = part_below(l->c, i, lane_of(&out->normal, i), at->phi_m[i]);
    cr_way_facets on;
    out->full_m[i] = in.depth_m;
    out->deep_m = higher_f(out->deep_m, in.depth_m);
    out->parts += 2u * PARTS_OF_LANE;
    cr_way_facets_of(f, at, i, lane_of(l->world, i), &on);
    fill_looked_up(f, pose, &on, i, v3_unit(v3(at->gx[i], at->gy[i], at->gz[i]), 1e-3f), depth_left(in, l->coverage[i]),
                   l->coverage[i], out);
}

/* All lanes over one surface, or none of them. */
static void fill_all(const cr_field *f, const xform *pose, const cr_looked *l, cr_way_layers *out) {
    const uint32_t surface = cr_way_common(f, l->at, out->left);
    out->parts += PARTS_OF_LANE * cr_count_lanes(out->near);
    out->facet = surface < CR_WAY_CURVED && out->near == out->left ? surface : CR_FACET_NONE;
    if (out->facet == CR_FACET_NONE) {
        cr_way_normals(pose, l->at->gx, l->at->gy, l->at->gz, out->near | 1u,
                       &out->normal); /* the first is what others are compared with */
    }
    if (surface != CR_WAY_NONE) {
        fill_common(f, pose, l->c, out->left, surface, l->at, &out->normal, out);
        out->reach.spread = out->near == out->left ? out->reach.spread : CR_WAY_NO_SPREAD;
        out->left = 0u;
    }
}

void cr_way_over_lookup(const cr_field *f, const xform *pose, const cr_looked *l, cr_way_layers *out) {
    const uint32_t cells = out->left & l->at->on_planes;
    if (out->step == CR_WAY_COMMON) {
        fill_all(f, pose, l, out);
        out->step = CR_WAY_CELLS;
    } else if (cells != 0u) {
        const uint32_t same = cr_way_same_cell(l->at, cells);
        out->left &= ~same;
        fill_over_cell(f, pose, l->c, same, l->coverage, l->at, out);
    } else {
        fill_over_samples(f, pose, l, take_lane(&out->left), out);
    }
    out->step = out->left == 0u ? CR_WAY_FADE : out->step;
}

/* Distance up to which the image has samples, m: bricks farther inside say no more than how far at least. */
static float depth_of_bricks(const struct cr_img_meta *m) {
    return (m->band_m - 1.7320508f * m->brick_m) / BAND_PER_REACH;
}

/* Lanes that are deeper than a limit were once known by their facets, and are not farther in: in the last voxel before that they pass from the
 * surfaces that they are over to none. */
int cr_way_fade(const cr_scene *s, uint32_t lanes, cr_way_layers *l) {
    const float most_m = depth_of_bricks(s->meta), voxel_m = s->meta->voxel_m;
    if (l->deep_m + (float)l->count * s->meta->ramp_max_m < most_m - voxel_m) {
        return 0; /* no lane is: level with a plane it is less deep than its ramp */
    }
    l->parts += PARTS_OF_FADED * (2u + l->count) * cr_count_lanes(lanes);
    while (lanes != 0u) {
        const int i = take_lane(&lanes);
        float depth = 0.0f, moved = 0.0f, seen = 0.0f;
        for (uint32_t k = 0; k < l->count; k++) {
            depth += l->layers[k].depth_m[i];
        }
        if (!(depth > most_m - voxel_m)) {
            continue;
        }
        const float kept = clamp_f((most_m - depth) / voxel_m, 0.0f, 1.0f), scale = min_f(1.0f, most_m / depth);
        for (uint32_t k = 0; k < l->count; k++) {
            cr_way_layer *layer = &l->layers[k];
            moved += scale * (1.0f - kept) * layer->depth_m[i];
            seen += (1.0f - kept) * layer->coverage[i];
            layer->depth_m[i] *= scale * kept;
            if (layer->surface >= CR_WAY_CURVED) {
                layer->normal_m.x[i] *= scale * kept;
                layer->normal_m.y[i] *= scale * kept;
                layer->normal_m.z[i] *= scale * kept;
            }
            layer->coverage[i] *= kept;
        }
        lane_to(l, CR_WAY_NONE, CR_FACET_NONE, i, moved, seen);
    }
    return 1;
}
