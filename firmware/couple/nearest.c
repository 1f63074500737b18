/* What of the obstacle holds a sample: walls that meet, and where a piece of the tool's surface comes nearest: an edge or a corner of that may reach between two samples. */
#include "couple/follow_parts.h"

/* In a cell of many facets, shares of a voxel: a sample is no deeper behind a wall; the nearest wall explains the distance so well, as
 * walls that meet bend that between samples of the image. */
#define BEHIND_VOXELS 0.3f
#define SAME_VOXELS 0.3f

/* A crease that turns by more has a sample of its own there (TIP_TURN in host/crease/bake/features.py). */
#define BEND_MAX 0.3473f
/* A gradient that is shorter tells no direction. */
#define GRADIENT_MIN 0.1f
/* A piece is looked at where its end is nearer than its middle by more, m. */
#define LEAN_MIN_M 1e-7f
/* The least bend of a distance along a line, m: rounding. */
#define BEND_LEAST_M 1e-9f
/* How samples beside a piece tell its bend: where they are farther along its line than this share of its ramp. */
#define BESIDE_MIN 0.1f
/* Times that a least between two ends is looked for. */
#define BETWEEN_MAX 2
/* A corner gives way by this share of how far a crease leads down from it to the next sample. */
#define YIELD_SHARE 5e-3f

/* Tool frame. */
static cr_vec3 gradient_of(const cr_couple_view *v, const cr_lookup *at, int i) {
    return xform_unrotate(&v->pose, v3_unit(v3(at->gx[i], at->gy[i], at->gz[i]), GRADIENT_MIN));
}

static void put_place(cr_lanes3 *places, int i, cr_vec3 p) {
    places->x[i] = p.x;
    places->y[i] = p.y;
    places->z[i] = p.z;
}

static cr_vec3 out_of(const struct cr_img_cluster *c, int i) { return v3_unit(v3(c->ax[i], c->ay[i], c->az[i]), 0.0f); }

static cr_vec3 at_sample(const struct cr_img_cluster *c, int i) { return v3(c->x[i], c->y[i], c->z[i]); }

/* On a piece at a share of its line: a face that bends falls away behind its plane, a crease that does bulges beyond the line between its ends. Tool frame. */
static cr_vec3 on_piece(const struct cr_img_cluster *c, const cr_couple_line *l, int i, float share) {
    const cr_vec3 p = v3_mad(at_sample(c, i), l->way, share);
    return v3_mad(p, l->bend, (has_lane(c->crease_mask, i) ? 1.0f : 0.0f) - share * share);
}

/* Where the line goes there. */
static cr_vec3 along_piece(const cr_couple_line *l, float share) { return v3_mad(l->way, l->bend, -2.0f * share); }

/* And the surface's normal there, of a face. */
static cr_vec3 out_there(const cr_couple_line *l, cr_vec3 out, float share) {
    const float turn = 2.0f * v3_dot(out, l->bend) * share / v3_dot(l->way, l->way);
    return v3_unit(v3_mad(out, l->way, turn), 0.0f);
}

/* Outward normals of the samples, tool frame: those of out_of, all at once. */
static void find_outs(const struct cr_img_cluster *c, cr_lanes3 *out) {
    for (int i = 0; i < CR_LANES; i++) {
        const float x = c->ax[i], y = c->ay[i], z = c->az[i], norm = sqrtf(x * x + y * y + z * z);
        const float scale = norm > 0.0f ? 1.0f / norm : 0.0f;
        out->x[i] = x * scale;
        out->y[i] = y * scale;
        out->z[i] = z * scale;
    }
}

/* How far a piece falls away behind its plane at the end of its line. The bow says no more than how far it does somewhere: a cylinder's does not along its
 * axis. How normals turn along the line from the samples beside it tells its bend there. */
static float drop_of(const struct cr_img_cluster *c, const cr_lanes3 *out, int i, cr_vec3 w) {
    const float from = v3_dot(w, at_sample(c, i)), turned = v3_dot(w, lane_of(out, i)), long2 = v3_dot(w, w);
    float along[CR_LANES], turn[CR_LANES], top = 0.0f, bottom = 0.0f;
    for (int j = 0; j < CR_LANES; j++) {
        along[j] = w.x * c->x[j] + w.y * c->y[j] + w.z * c->z[j] - from;
        turn[j] = w.x * out->x[j] + w.y * out->y[j] + w.z * out->z[j] - turned;
    }
    for (uint32_t left = c->beside[i]; left != 0u;) {
        const int j = take_lane(&left);
        if (c->bow[j] > 0.0f) {
            top += along[j] * turn[j];
            bottom += along[j] * along[j];
        }
    }
    const float least = BESIDE_MIN * c->ramp[i];
    return bottom > least * least * long2 ? clamp_f(0.5f * long2 * top / bottom, 0.0f, c->bow[i]) : c->bow[i];
}

/* From the middle of a crease's piece to an end. */
static cr_vec3 crease_way(const struct cr_img_cluster *c, int i) {
    const float x = c->wxx[i], y = c->wyy[i], z = c->wzz[i], most = higher_f(x, higher_f(y, z));
    const cr_vec3 row = x >= most   ? v3(x, c->wxy[i], c->wzx[i])
                        : y >= most ? v3(c->wxy[i], y, c->wyz[i])
                                    : v3(c->wzx[i], c->wyz[i], z);
    return v3_scale(row, most > 0.0f ? 0.5f / sqrtf(most) : 0.0f);
}

/* How creases beside one turn from its way: weighted by how far along that they are. */
typedef struct {
    cr_vec3 from, way, top;
    float long2, bottom;
} turn_sum;

static void begin_turns(const struct cr_img_cluster *c, int i, turn_sum *sum) {
    sum->from = at_sample(c, i);
    sum->way = crease_way(c, i);
    sum->long2 = v3_dot(sum->way, sum->way);
    sum->top = v3(0.0f, 0.0f, 0.0f);
    sum->bottom = 0.0f;
}

static void add_turn(turn_sum *sum, cr_vec3 from, cr_vec3 way) {
    const float along = v3_dot(sum->way, way), share = v3_dot(sum->way, v3_sub(from, sum->from)) / sum->long2;
    const cr_vec3 turned = v3_mad(v3_scale(way, sum->long2 / along), sum->way, -1.0f);
    if (v3_dot(turned, turned) < BEND_MAX * BEND_MAX * sum->long2) {
        sum->top = v3_mad(sum->top, turned, -0.5f * share);
        sum->bottom += share * share;
    }
}

/* Creases of a neighbouring cluster. */
static void add_turns(turn_sum *sum, const struct cr_img_cluster *c, uint32_t lanes) {
    for (uint32_t left = lanes & c->crease_mask; left != 0u;) {
        const int j = take_lane(&left);
        add_turn(sum, at_sample(c, j), crease_way(c, j));
    }
}

/* How far creases' pieces bulge beyond the lines between their ends: pieces are straight, and turn from one to the next where it is round. */
static void find_bulges(const cr_scene *s, const struct cr_img_cluster *c, cr_couple_line *lines) {
    const uint32_t own = (uint32_t)(c - s->clusters), creases = c->crease_mask;
    turn_sum sums[CR_LANES];
    for (uint32_t left = creases; left != 0u;) {
        const int i = take_lane(&left);
        begin_turns(c, i, &sums[i]);
    }
    for (uint32_t left = creases; left != 0u;) {
        const int i = take_lane(&left);
        for (uint32_t beside = c->beside[i] & creases; beside != 0u;) {
            const int j = take_lane(&beside);
            add_turn(&sums[i], sums[j].from, sums[j].way);
        }
    }
    for (uint32_t k = s->adj_start[own]; k < s->adj_start[own + 1u]; k++) {
        const struct cr_img_neighbour *n = &s->adj[k];
        for (uint32_t left = n->mine & creases; left != 0u;) {
            add_turns(&sums[take_lane(&left)], &s->clusters[n->cluster], n->theirs);
        }
    }
    for (uint32_t left = creases; left != 0u;) {
        const int i = take_lane(&left);
        lines[i].bend = v3_scale(sums[i].top, sums[i].bottom > 1.0f ? 1.0f / sums[i].bottom : 0.0f);
    }
}

void cr_couple_raise(const cr_couple_view *v, const struct cr_img_cluster *c, cr_lanes3 *place) {
    cr_couple_line *lines = v->found->lines;
    for (int i = 0; i < CR_LANES; i++) {
        lines[i].bend = v3(0.0f, 0.0f, 0.0f);
    }
    if (c->crease_mask != 0u) {
        find_bulges(v->field->scene, c, lines);
    }
    for (uint32_t left = c->crease_mask; left != 0u;) {
        const int i = take_lane(&left);
        put_place(place, i, v3_add(lane_of(place, i), xform_rotate(&v->pose, lines[i].bend)));
    }
}

static int has_direction(const cr_lookup *at, int i) {
    const float gx = at->gx[i], gy = at->gy[i], gz = at->gz[i];
    return gx * gx + gy * gy + gz * gz > GRADIENT_MIN * GRADIENT_MIN;
}

/* Along the gradient: where the pieces of some samples go, as spread_times has it, and how far they reach; nowhere where the gradient tells no direction. */
static void find_reaches(const xform *m, const struct cr_img_cluster *c, const cr_lookup *at, uint32_t lanes,
                         cr_lanes3 *way, float *reach_m) {
    const float flat2 = GRADIENT_MIN * GRADIENT_MIN;
    for (int i = lane_at(lanes, 0); i < CR_LANES; i = lane_at(lanes, i + 1)) {
        const float gx = at->gx[i], gy = at->gy[i], gz = at->gz[i], long2 = gx * gx + gy * gy + gz * gz;
        const float scale = long2 > flat2 ? 1.0f / sqrtf(higher_f(long2, flat2)) : 0.0f;
        const float x = scale * (m->r0.x * gx + m->r1.x * gy + m->r2.x * gz);
        const float y = scale * (m->r0.y * gx + m->r1.y * gy + m->r2.y * gz);
        const float z = scale * (m->r0.z * gx + m->r1.z * gy + m->r2.z * gz);
        const float wx = c->wxx[i] * x + c->wxy[i] * y + c->wzx[i] * z;
        const float wy = c->wxy[i] * x + c->wyy[i] * y + c->wyz[i] * z;
        const float wz = c->wzx[i] * x + c->wyz[i] * y + c->wzz[i] * z;
        way->x[i] = wx;
        way->y[i] = wy;
        way->z[i] = wz;
        reach_m[i] = 0.5f * sqrtf(higher_f(0.0f, x * wx + y * wy + z * wz));
    }
}

/* Where the gradient tells no direction a piece is no nearer than its middle, for this step; it may be, for what may sleep. */
float cr_couple_find_lines(const cr_couple_view *v, const struct cr_img_cluster *c, const cr_lookup *at) {
    const uint32_t used = first_lanes(c->count);
    const float far = v->trust_m + v->slack_m;
    float least_m = 1e4f, reach_m[CR_LANES];
    cr_lanes3 way;
    find_reaches(&v->pose, c, at, used, &way, reach_m);
    for (uint32_t left = used; left != 0u;) {
        const int i = take_lane(&left);
        const float phi = at->phi_m[i], ramp = has_lane(c->vertex_mask, i) ? 0.0f : c->ramp[i];
        cr_couple_line *l = &v->found->lines[i];
        float down = ramp;
        l->reach_m = ramp;
        if (phi - ramp < far && ramp > 0.0f) {
            l->way = lane_of(&way, i);
            l->reach_m = reach_m[i];
            down = (has_direction(at, i) ? reach_m[i] : ramp) + v3_norm(l->bend);
        }
        least_m = lower_f(least_m, phi - down - (phi < 2.0f * v->trust_m ? v->slack_m : v->slack_far_m));
    }
    return least_m;
}

/* Lines along which a piece may come near enough to be looked at. */
static uint32_t begin_lines(const cr_couple_view *v, const struct cr_img_cluster *c, const cr_lookup *at) {
    uint32_t leaning = 0u, asked = first_lanes(c->count) & ~(uint32_t)c->vertex_mask;
    cr_lanes3 out;
    find_outs(c, &out);
    while (asked != 0u) {
        const int i = take_lane(&asked);
        cr_couple_line *l = &v->found->lines[i];
        if (l->reach_m > LEAN_MIN_M && at->phi_m[i] - l->reach_m < v->margin_m + v->slack_m) {
            l->way = v3_scale(l->way, -0.25f / l->reach_m);
            if (c->bow[i] > 0.0f) {
                l->bend = v3_scale(lane_of(&out, i), drop_of(c, &out, i, l->way));
            }
            l->low.share = 0.0f;
            l->low.phi_m = at->phi_m[i];
            l->low.slope = -l->reach_m;
            l->low.gradient = gradient_of(v, at, i);
            leaning |= 1u << i;
        }
    }
    return leaning;
}

/* Lanes that are not asked for are where a sample is. */
static void look_up_at(cr_couple_view *v, const struct cr_img_cluster *c, uint32_t lanes, const float *share,
                       cr_lanes3 *place, cr_lookup *at) {
    cr_lanes3 tool;
    for (int i = 0; i < CR_LANES; i++) {
        put_place(&tool, i, at_sample(c, 0));
    }
    for (uint32_t left = lanes; left != 0u;) {
        const int i = take_lane(&left);
        put_place(&tool, i, on_piece(c, &v->found->lines[i], i, share[i]));
    }
    cr_lanes_to_world(&v->pose, tool.x, tool.y, tool.z, place);
    cr_field_look_up_lanes(v->field, place, lanes, at);
    v->lookups++;
}

/* Least of a line of which both ends are known. The distance to a plane bends as the piece does: either end goes on in a parabola, and the least is where the two
 * meet, as over an edge, or at the lowest place of the one that is higher there. Exact where there is one edge, or none. */
static float find_least(const cr_couple_line *l) {
    const float steps = l->high.share - l->low.share;
    const float bend = 2.0f * higher_f(-v3_dot(l->bend, l->low.gradient), BEND_LEAST_M);
    const float less = l->low.slope + bend * steps - l->high.slope;
    const float rest = l->high.phi_m - l->low.phi_m - (l->high.slope - 0.5f * bend * steps) * steps;
    const float meet = less < -BEND_LEAST_M ? clamp_f(rest / less, 0.0f, steps) : 0.5f * steps;
    const float low = -l->low.slope / bend, high = steps - l->high.slope / bend;
    const float t = lower_f(low, higher_f(meet, high));
    return l->low.share + (t > 0.0f && t < steps ? t : 0.5f * steps);
}

/* Of all directions between two the one nearest to a third: how much of each. */
static void share_between(const cr_vec3 *n, cr_vec3 to, float *share) {
    const float c = v3_dot(n[0], n[1]), a = v3_dot(n[0], to), b = v3_dot(n[1], to);
    share[0] = higher_f(0.0f, a - c * b);
    share[1] = higher_f(0.0f, b - c * a);
}

/* The normal at a least between two ends. A crease has one way to lie: of all directions between their gradients the one that does not lean along it; where two
 * edges cross it is at right angles to both. A face has two: it is the one that faces its surface there most. Either gradient alone leans. Tool frame. */
static cr_vec3 level_between(const struct cr_img_cluster *c, const cr_couple_line *l, int i, float at, cr_vec3 there) {
    const cr_vec3 n[2] = {l->low.gradient, l->high.gradient};
    float share[2];
    if (has_lane(c->crease_mask, i)) {
        share[0] = higher_f(0.0f, v3_dot(n[1], l->way));
        share[1] = higher_f(0.0f, -v3_dot(n[0], l->way));
    } else {
        share_between(n, v3_scale(out_there(l, out_of(c, i), at), -1.0f), share);
    }
    const cr_vec3 sum = v3_mad(v3_scale(n[0], share[0]), n[1], share[1]);
    return v3_norm(sum) > GRADIENT_MIN * (share[0] + share[1]) ? v3_unit(sum, 0.0f) : there;
}

/* A bit of one set of lanes as it is in another. */
static uint32_t with_lane(uint32_t lanes, uint32_t from, int i) { return (lanes & ~(1u << i)) | (from & (1u << i)); }

/* A piece is nearer elsewhere: what was looked up there stands for its sample. */
static void take_found(const cr_lookup *there, const cr_lanes3 *found, int i, cr_lookup *at, cr_lanes3 *place) {
    at->phi_m[i] = there->phi_m[i];
    at->gx[i] = there->gx[i];
    at->gy[i] = there->gy[i];
    at->gz[i] = there->gz[i];
    at->ux[i] = there->ux[i];
    at->uy[i] = there->uy[i];
    at->uz[i] = there->uz[i];
    at->entry[i] = there->entry[i];
    at->facet[i] = there->facet[i];
    at->kind[i] = there->kind[i];
    at->on_planes = with_lane(at->on_planes, there->on_planes, i);
    at->from_facet = with_lane(at->from_facet, there->from_facet, i);
    at->bent = with_lane(at->bent, there->bent, i);
    put_place(place, i, lane_of(found, i));
}

/* Whether a place sees flat faces only, that may meet convexly. */
static int is_flat(const cr_couple_view *v, const cr_lookup *at, int i) {
    const uint32_t kind = v->field->scene->kinds[cr_field_kind(v->field, at, i)].kind;
    return kind == (uint32_t)CR_KIND_PLANAR || kind == (uint32_t)CR_KIND_CONVEX;
}

/* Creases beside a sample, of its cluster and of those next to it. With a place on the plane of its face: how far that is beyond those that end the face, inner edges
 * end nothing; without: how far they lead down from the sample along a normal. m, 0 at least; tool frame. */
static float look_at_creases(const cr_scene *s, const struct cr_img_cluster *c, int i, const cr_vec3 *place,
                             cr_vec3 normal) {
    const cr_vec3 sample = at_sample(c, i);
    const uint32_t *const start = &s->adj_start[c - s->clusters];
    const struct cr_img_cluster *b = c;
    uint32_t left = c->beside[i] & c->crease_mask;
    float most_m = 0.0f;
    for (uint32_t k = start[0]; left != 0u || k < start[1];) {
        if (left == 0u) {
            const struct cr_img_neighbour *n = &s->adj[k++];
            b = &s->clusters[n->cluster];
            left = has_lane(n->mine, i) ? n->theirs & b->crease_mask : 0u;
        } else {
            const int j = take_lane(&left);
            const cr_vec3 at = at_sample(b, j), out = place != NULL ? out_of(b, j) : normal;
            const float inside_m = v3_dot(out, v3_sub(sample, at));
            const float beyond_m = place == NULL ? inside_m : inside_m < 0.0f ? v3_dot(out, v3_sub(*place, at)) : 0.0f;
            most_m = higher_f(most_m, beyond_m);
        }
    }
    return most_m;
}

float cr_couple_yield(const cr_scene *s, const struct cr_img_cluster *c, int i, cr_vec3 normal) {
    return YIELD_SHARE * look_at_creases(s, c, i, NULL, normal);
}

/* Whether a place on a sample's line is on the tool: the piece of a face may reach beyond the creases beside it. */
static int is_on_tool(const cr_scene *s, const struct cr_img_cluster *c, int i, cr_vec3 place) {
    return look_at_creases(s, c, i, &place, place) <= LEAN_MIN_M;
}

uint32_t cr_couple_nearest(cr_couple_view *v, const struct cr_img_cluster *c, cr_lookup *at, cr_lanes3 *place,
                           uint32_t *nearer, cr_lanes3 *normal) {
    cr_lookup there;
    cr_lanes3 found;
    float share[CR_LANES];
    const uint32_t leaning = begin_lines(v, c, at);
    uint32_t asked = leaning;
    *nearer = 0u;
    for (int tries = 0; tries <= BETWEEN_MAX && asked != 0u; tries++) {
        uint32_t between = 0u;
        for (uint32_t left = asked; left != 0u;) {
            const int i = take_lane(&left);
            share[i] = tries == 0 ? 1.0f : find_least(&v->found->lines[i]);
        }
        look_up_at(v, c, asked, share, &found, &there);
        for (uint32_t left = asked; left != 0u;) {
            const int i = take_lane(&left), crease = has_lane(c->crease_mask, i);
            cr_couple_line *l = &v->found->lines[i];
            const cr_vec3 n = gradient_of(v, &there, i);
            const float slope = v3_dot(n, along_piece(l, share[i]));
            /* Where it falls to the end of a piece, what is nearest is a neighbour's: pieces of faces are no rectangles, creases go on. Only a crease that bends may have it
             * at the end itself: where it rises on the next piece, which turns on as this one does. */
            const int counts = tries > 0 || (crease && v3_dot(n, along_piece(l, 2.0f)) > 0.0f);
            /* That a curved piece bends away from a wall is no place between: a peg's does all along its hole, and the place would swing. */
            const int bent = slope > 0.0f && (v3_dot(n, along_piece(l, 0.0f)) > 0.0f || is_flat(v, at, i));
            const cr_couple_end end = {share[i], there.phi_m[i], slope, n};
            *(tries == 0 || slope > 0.0f ? &l->high : &l->low) = end;
            between |= (uint32_t)(tries > 0 || bent) << i;
            if (counts && there.phi_m[i] < at->phi_m[i] &&
                (crease || is_on_tool(v->field->scene, c, i, on_piece(c, l, i, share[i])))) {
                take_found(&there, &found, i, at, place);
                put_place(normal, i, xform_rotate(&v->pose, level_between(c, l, i, share[i], n)));
                *nearer |= 1u << i;
            }
        }
        asked = between;
    }
    return leaning;
}

static void add_wall(cr_couple_walls *w, cr_vec3 normal, float gap_m) {
    const uint32_t at = w->count++;
    const int first = at == 0u || gap_m < w->gap_m[0];
    w->normal[at] = first ? w->normal[0] : normal;
    w->gap_m[at] = first ? w->gap_m[0] : gap_m;
    if (first) {
        w->normal[0] = normal;
        w->gap_m[0] = gap_m;
    }
}

/* Whether an edge ends a wall before the foot of a place: one that it meets there convexly is higher. */
static int is_cut(const cr_scene *s, const struct cr_img_kind *kind, const float *height_m, uint32_t k) {
    const uint32_t own = s->facets[kind->facet[k]].patch;
    int cut = 0;
    for (uint32_t g = 0; g < kind->count && !cut; g++) {
        const uint32_t other = s->facets[kind->facet[g]].patch;
        cut = height_m[g] > height_m[k] && other != own && cr_pair_label(s, own, other) == (uint32_t)CR_PAIR_CONVEX;
    }
    return cut;
}

/* Whether a facet meets each of those that were taken concavely. */
static int meets_walls(const cr_scene *s, const uint32_t *taken, uint32_t count, uint32_t facet) {
    const uint32_t b = s->facets[facet].patch;
    int meets = 1;
    for (uint32_t k = 0; k < count && meets; k++) {
        const uint32_t a = s->facets[taken[k]].patch;
        meets = a != b && cr_pair_label(s, a, b) == (uint32_t)CR_PAIR_CONCAVE;
    }
    return meets;
}

void cr_couple_find_walls(cr_couple_view *v, const cr_lookup *at, int i, cr_vec3 place, cr_couple_walls *w) {
    const cr_scene *s = v->field->scene;
    const struct cr_img_kind *kind = &s->kinds[cr_field_kind(v->field, at, i)];
    const int exact = kind->kind == (uint32_t)CR_KIND_CONCAVE && has_lane(at->from_facet, i);
    w->count = 0u;
    if (!exact && kind->kind != (uint32_t)CR_KIND_MIXED) {
        return;
    }
    uint32_t taken[CR_KIND_FACETS_MAX] = {0u};
    float height_m[CR_KIND_FACETS_MAX];
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *f = &s->facets[kind->facet[k]];
        height_m[k] = v3_dot(v3_from(f->normal), place) - f->offset_m;
    }
    for (uint32_t k = 0; k < kind->count; k++) {
        const struct cr_img_facet *f = &s->facets[kind->facet[k]];
        if (exact || (!f->curved && height_m[k] >= -BEHIND_VOXELS * s->meta->voxel_m &&
                      meets_walls(s, taken, w->count, kind->facet[k]) && !is_cut(s, kind, height_m, k))) {
            taken[w->count] = kind->facet[k];
            add_wall(w, v3_from(f->normal), height_m[k]);
        }
    }
    if (!exact && (w->count < 2u || abs_f(w->gap_m[0] - at->phi_m[i]) > SAME_VOXELS * s->meta->voxel_m)) {
        w->count = 0u;
    }
}
