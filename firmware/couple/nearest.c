/* Where a piece of the tool's surface comes nearest to the obstacle: an edge or a corner of that may reach between two samples. */
#include "couple/follow_parts.h"

/* A piece is looked at where its end is nearer than its middle by more, m. */
#define LEAN_MIN_M 1e-6f
/* Times that a least between two ends is looked for. */
#define BETWEEN_MAX 2

/* The way from the middle of each piece to its end, the way the distance falls, in one line. */
typedef struct {
    cr_vec3 way[CR_LANES]; /* tool frame */
    cr_vec3 turned[CR_LANES];
    float low[CR_LANES], low_phi[CR_LANES], low_slope[CR_LANES]; /* falls there */
    float high[CR_LANES], high_phi[CR_LANES], high_slope[CR_LANES];
} piece_lines;

static cr_vec3 gradient_of(const cr_lookup *at, int i) { return v3_unit(v3(at->gx[i], at->gy[i], at->gz[i]), 0.1f); }

/* On a piece at a share of its line: a face that bends falls away behind its plane. Tool frame. */
static cr_vec3 on_piece(const struct cr_img_cluster *c, const piece_lines *l, int i, float share) {
    const cr_vec3 p = v3_mad(v3(c->x[i], c->y[i], c->z[i]), l->way[i], share);
    const cr_vec3 out = v3_unit(v3(c->ax[i], c->ay[i], c->az[i]), 0.0f);
    return v3_mad(p, out, -c->bow[i] * share * share);
}

static uint32_t begin_lines(const cr_couple_view *v, const struct cr_img_cluster *c, const cr_lookup *at,
                            uint32_t asked, piece_lines *l) {
    uint32_t leaning = 0u;
    while (asked != 0u) {
        const int i = take_lane(&asked);
        const cr_vec3 g = xform_unrotate(&v->pose, gradient_of(at, i));
        const float reach = piece_reach(c, i, g);
        if (reach > LEAN_MIN_M && at->phi_m[i] - reach < v->margin_m + v->slack_m) {
            l->way[i] = v3_scale(spread_times(c, i, g), -0.25f / reach);
            l->turned[i] = xform_rotate(&v->pose, l->way[i]);
            l->low[i] = 0.0f;
            l->low_phi[i] = at->phi_m[i];
            l->low_slope[i] = -reach;
            leaning |= 1u << i;
        }
    }
    return leaning;
}

static void look_up_at(cr_couple_view *v, const struct cr_img_cluster *c, const piece_lines *l, uint32_t lanes,
                       const float *share, cr_lanes3 *place, cr_lookup *at) {
    float x[CR_LANES], y[CR_LANES], z[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        const cr_vec3 p = has_lane(lanes, i) ? on_piece(c, l, i, share[i]) : v3(c->x[0], c->y[0], c->z[0]);
        x[i] = p.x;
        y[i] = p.y;
        z[i] = p.z;
    }
    cr_lanes_to_world(&v->pose, x, y, z, place);
    cr_field_look_up_lanes(v->field, place, lanes, at);
    v->lookups++;
}

/* Where two tangents of a line's distances meet: exact where a face comes to lie over an edge. */
static float meet_tangents(const piece_lines *l, int i) {
    const float steps = l->high[i] - l->low[i], less = l->low_slope[i] - l->high_slope[i];
    const float t = (l->high_phi[i] - l->low_phi[i] - l->high_slope[i] * steps) / less;
    return t > 0.0f && t < steps ? l->low[i] + t : l->low[i] + 0.5f * steps;
}

/* What was found at a share of the line; a normal along the line is none of a least between its ends. */
static void take_found(const piece_lines *l, const cr_lookup *at, int i, int between, float *phi_m, cr_lanes3 *normal) {
    cr_vec3 n = gradient_of(at, i);
    if (between) {
        const cr_vec3 along = l->turned[i];
        const cr_vec3 across = v3_mad(n, along, -v3_dot(n, along) / v3_dot(along, along));
        n = v3_norm(across) > 0.1f ? v3_unit(across, 0.0f) : n;
    }
    phi_m[i] = at->phi_m[i];
    normal->x[i] = n.x;
    normal->y[i] = n.y;
    normal->z[i] = n.z;
}

uint32_t cr_couple_nearest(cr_couple_view *v, const struct cr_img_cluster *c, const cr_lookup *at, uint32_t asked,
                           cr_lanes3 *place, float *phi_m, cr_lanes3 *normal) {
    piece_lines l;
    cr_lookup there;
    float share[CR_LANES];
    const uint32_t leaning = begin_lines(v, c, at, asked, &l);
    uint32_t between = 0u;
    if (leaning == 0u) {
        return 0u;
    }
    for (int i = 0; i < CR_LANES; i++) {
        share[i] = 1.0f;
    }
    look_up_at(v, c, &l, leaning, share, place, &there);
    for (uint32_t left = leaning; left != 0u;) {
        const int i = take_lane(&left);
        const float slope = v3_dot(gradient_of(&there, i), l.turned[i]);
        phi_m[i] = at->phi_m[i];
        /* Where it falls to the end of a face's piece, what is nearest is another sample's: the pieces are no rectangles. */
        if (has_lane(c->crease_mask, i)) {
            take_found(&l, &there, i, 0, phi_m, normal);
        }
        l.high[i] = 1.0f;
        l.high_phi[i] = there.phi_m[i];
        l.high_slope[i] = slope;
        between |= (uint32_t)(slope > 0.0f) << i;
    }
    for (int tries = 0; tries < BETWEEN_MAX && between != 0u; tries++) {
        cr_lanes3 found;
        for (uint32_t left = between; left != 0u;) {
            const int i = take_lane(&left);
            share[i] = meet_tangents(&l, i);
        }
        look_up_at(v, c, &l, between, share, &found, &there);
        for (uint32_t left = between; left != 0u;) {
            const int i = take_lane(&left);
            const float slope = v3_dot(gradient_of(&there, i), l.turned[i]);
            float *end = slope > 0.0f ? l.high : l.low;
            float *end_phi = slope > 0.0f ? l.high_phi : l.low_phi;
            float *end_slope = slope > 0.0f ? l.high_slope : l.low_slope;
            end[i] = share[i];
            end_phi[i] = there.phi_m[i];
            end_slope[i] = slope;
            if (there.phi_m[i] < phi_m[i]) {
                take_found(&l, &there, i, 1, phi_m, normal);
                place->x[i] = found.x[i];
                place->y[i] = found.y[i];
                place->z[i] = found.z[i];
            }
        }
    }
    return leaning;
}
