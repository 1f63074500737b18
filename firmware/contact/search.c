/* search: the contact at a pose, in slices. */
#include "contact/world.h"

/* Where a search looks, of the way since the last answer's began, if it takes as long: the middle of the feels in which it will be the newest answer. With 0 the
 * force of edge90_cube is 0.079 mm off with 40 units instead of 0.022, and that of bar_u 0.047 instead of 0.034. */
#define AHEAD 1.5f
/* Cosine of a half-space and the facet that weighs most in it from which on it is no deeper than below that: it then changes by twice the motion at most. */
#define HELD_LEAVES_MIN 0.5f
/* How much deeper or less deep a contact in hand may be there, of what it is now: past the middle of a plate it pushes out at the other side, and a wall that the
 * tool is expected to leave would be felt no more. */
#define DEEPER 0.5f

void cr_drop_search(cr_world *w) { w->search.open = w->found = w->answering = w->again = 0u; }

/* Areas, without force yet, of the contact that was found at a pose: the response of the settings. Returns 0 when the work of this slice was not enough;
 * then it goes on in the next one. */
static int respond(cr_world *w, const xform *at, const cr_slice *slice, cr_hand *hand, cr_area *areas,
                   cr_stats *stats) {
    cr_respond_input in = {.field = &w->field, .world_from_tool = at, .set = &w->set, .config = &w->config};
#ifdef CR_RIVALS
    if (w->config.response != CR_RESPONSE_WAY_OUT) {
        in.proxy = &w->proxy;
        hand->count = cr_respond_as_rival(&in, w->hit_of_cluster, &w->areas, areas, CR_AREAS_MAX, stats);
        return 1;
    }
#endif
    if (!w->answering) {
        cr_way_begin(&in, &w->way);
        w->answering = 1u;
    }
    w->way.spent += w->search.spent;
    const int whole = cr_way_measure(&in, &w->way, slice->work) && cr_way_push(&w->way, slice->work);
    if (whole) {
        hand->count = cr_way_answer(&in, &w->way, areas, CR_AREAS_MAX, stats);
    }
    stats->work = w->way.spent / CR_WORK_PARTS;
    w->way.spent = 0u;
    return whole;
}

/* What later ticks need of an area that was answered, and is so deep. */
static void hold(const xform *at, const cr_area *a, float depth_m, cr_held *to) {
    to->normal_world = a->normal_world;
    to->point_tool_m = xform_unrotate(at, v3_sub(a->point_world_m, at->t));
    to->offset_m = a->offset_m - a->depth_m + depth_m;
    to->area_m2 = a->area_m2;
    to->share = a->depth_m / depth_m;
    to->facet = CR_FACET_NONE;
}

/* The facet that weighs most in a half-space. It is left, at the earliest, by half the size of what is inside of it after its point; where that is beyond the end
 * already, by as much after where it is now. */
static void end_at_facet(const cr_world *w, const cr_way_half *half, const cr_area *a, float depth_m, cr_held *to) {
    const cr_way_zone *most = NULL;
    for (uint32_t left = half->zones; left != 0u;) {
        const cr_way_zone *z = &w->set.way.zones[take_lane(&left)];
        if (z->flat != 0u && (most == NULL || z->weight_m3 > most->weight_m3)) {
            most = z;
        }
    }
    if (most != NULL) {
        to->facet = most->key.surface;
        const struct cr_img_facet *f = &w->scene.facets[to->facet];
        const cr_vec3 normal = v3_from(f->normal);
        const float reach_m = depth_m + 0.5f * sqrtf(most->area_m2);
        to->beyond_m = reach_m - lower_f(0.0f, cr_way_margin(f, a->point_world_m));
        const float leaves = v3_dot(normal, to->normal_world);
        to->leaves = leaves > HELD_LEAVES_MIN ? leaves : 1.0f;
        to->below_m = reach_m * leaves + v3_dot(normal, a->point_world_m);
    }
}

/* Each half-space that pushes is an area. */
static void keep(const cr_world *w, const xform *at, const cr_area *areas, cr_hand *hand) {
    CR_ASSERT(hand->count <= CR_AREAS_MAX);
#ifdef CR_RIVALS
    if (w->config.response != CR_RESPONSE_WAY_OUT) {
        for (uint32_t i = 0; i < hand->count; i++) {
            hold(at, &areas[i], areas[i].depth_m, &hand->held[i]);
            hand->held[i].share = 1.0f; /* each knows the whole depth, which may be none */
        }
        return;
    }
#endif
    for (uint32_t h = 0; h < w->way.relations.half_count; h++) {
        const uint32_t i = w->way.area[h];
        if (i != CR_HIT_NONE) {
            CR_ASSERT(i < hand->count);
            hold(at, &areas[i], w->way.depth_m[h], &hand->held[i]);
            end_at_facet(w, &w->way.half[h], &areas[i], w->way.depth_m[h], &hand->held[i]);
        }
    }
}

/* Whether a search looks where the tool is, or ahead of it, and whether it was in a contact in hand then. */
enum { CR_AT, CR_AHEAD, CR_AHEAD_OF_CONTACT };

/* Where the tool is when the answer of a search that begins now is felt, if it goes on as it did since the last answer's began and takes as long: that comes after
 * as many feels as it is old, and is the newest for as many. No point of the tool goes farther than samples are apart, and none of a contact in hand gets much deeper:
 * what is thin is not passed, and a hand that presses is stopped. Returns CR_AT where that is not known: after an answer that took one feel, found nothing, or is
 * too old to be felt. */
CR_OUT_OF_LINE uint32_t look_ahead(cr_world *w, const cr_felt *newest, cr_pose *ahead) {
    const uint32_t age = newest->stamp - w->answered.stamp;
#ifdef CR_RIVALS
    if (w->config.response != CR_RESPONSE_WAY_OUT) {
        return CR_AT;
    }
#endif
    if (age <= 1u || age > w->late_max || newest->memory != w->answered.memory) {
        return CR_AT;
    }
    const struct cr_img_meta *m = w->scene.meta;
    const cr_vec3 way_m = v3_sub(newest->pose.pos_m, w->answered.pose.pos_m);
    const cr_quat q = newest->pose.rot, last = w->answered.pose.rot;
    const cr_quat by = {q.w - last.w, q.x - last.x, q.y - last.y, q.z - last.z};
    const float turn_rad = 2.0f * sqrtf(by.w * by.w + by.x * by.x + by.y * by.y + by.z * by.z);
    const float far_m = v3_norm(way_m) + turn_rad * m->tool_radius_m;
    const float lead = lower_f(AHEAD * (float)(age - 1u) / (float)age, m->spacing_m / far_m);
    const cr_pose straight = {v3_mad(newest->pose.pos_m, way_m, lead),
                              {q.w + lead * by.w, q.x + lead * by.x, q.y + lead * by.y, q.z + lead * by.z}};
    if (cr_check_pose(&straight, ahead) != 0u) {
        return CR_AT;
    }
    const xform now = cr_xform_from_pose(&newest->pose);
    xform then = cr_xform_from_pose(ahead);
    float pushed_m = 0.0f;
    for (uint32_t i = 0; i < w->made.count; i++) {
        const cr_held *h = &w->made.held[i];
        const float deep_m = cr_held_depth(h, cr_xform_point(&now, h->point_tool_m));
        pushed_m += higher_f(0.0f, h->share * deep_m);
        const float then_m = cr_held_depth(h, cr_xform_point(&then, h->point_tool_m));
        const float low_m = deep_m > 0.0f ? deep_m * (1.0f - DEEPER) : then_m;
        const float high_m = max_f(0.0f, deep_m * (1.0f + DEEPER));
        then.t = v3_mad(then.t, h->normal_world, then_m - clamp_f(then_m, low_m, high_m));
    }
    ahead->pos_m = then.t;
    w->expected_m = (1.0f - DEEPER) * pushed_m;
    const uint32_t where = pushed_m > 0.0f ? CR_AHEAD_OF_CONTACT : CR_AHEAD;
    return v3_is_finite(then.t) ? where : (uint32_t)CR_AT;
}

/* Is what was found much less than was expected, since a face has ended? */
static int is_left(const cr_world *w, const cr_area *areas, uint32_t count) {
    float pushed_m = 0.0f;
    for (uint32_t i = 0; i < count; i++) {
        pushed_m += areas[i].depth_m;
    }
    return w->looks_ahead == CR_AHEAD_OF_CONTACT && !(pushed_m >= 0.9f * w->expected_m);
}

/* Answer the contact that was found, at the pose it was searched at. Returns whether it is answered: that nothing touches there, or much less, is no answer where the tool, when
 * it was felt, was in a contact that is in hand. */
static int answer(cr_world *w, const xform *at, const cr_slice *slice, cr_hand *hand, cr_area *areas, cr_stats *stats) {
    const uint32_t in_hand = hand->count;
    if (w->set.hit_count > 0u) {
        if (!respond(w, at, slice, hand, areas, stats)) {
            return 0;
        }
        stats->contacts = w->set.contacts;
        stats->clusters = w->set.hit_count;
        w->answering = 0u;
        hand->ahead = (uint32_t)(w->looks_ahead != CR_AT);
    } else {
        hand->count = hand->ahead = 0u;
    }
    w->found = 0u;
#ifdef CR_RIVALS
    w->proxy.held = w->set.hit_count > 0u ? w->proxy.held : 0u;
#endif
    if (is_left(w, areas, hand->count)) {
        hand->count = in_hand;
        hand->ahead = 0u;
        w->again = 1u;
    } else if (hand->count > 0u) {
        keep(w, at, areas, hand);
        w->answered = w->searched;
    }
    return !w->again;
}

/* The pose to search at: that which is expected when the answer is felt, or the newest; or again the last, where it was expected elsewhere. */
static void begin(cr_world *w, const cr_felt *newest) {
    cr_pose ahead;
    if (w->again) {
        w->again = 0u;
        w->looks_ahead = CR_AT;
        cr_motion_advance(&w->motion, &w->searched.pose);
        return;
    }
    w->searched = *newest;
    w->looks_ahead = w->made.count > 0u ? look_ahead(w, newest, &ahead) : (uint32_t)CR_AT;
    cr_motion_advance(&w->motion, w->looks_ahead != CR_AT ? &ahead : &newest->pose);
}

int cr_search_slice(cr_world *w, const cr_felt *newest, const cr_slice *slice, cr_hand *hand, cr_area *areas,
                    cr_stats *stats) {
    CR_ASSERT(!(w->search.open && w->found) && (w->found || !w->answering));
    if (newest->memory != w->searched.memory) {
        cr_drop_search(w);
        w->motion.valid = 0u;
#ifdef CR_RIVALS
        w->proxy.held = 0u;
#endif
    }
    if (!w->search.open && !w->found) {
#ifdef CR_RIVALS
        w->proxy.device_m = w->motion.valid ? w->motion.last.pos_m : newest->pose.pos_m;
#endif
        begin(w, newest);
    }
    const xform at = cr_xform_from_pose(&w->motion.last);
    const cr_detect_options options = {
        .skip = w->config.skip,
        .coverage = w->config.coverage,
        .lookups_max = slice->work,
        .slices_max = slice->slices_max,
#ifdef CR_RIVALS
        .touches = w->config.response != CR_RESPONSE_WAY_OUT,
#endif
    };
    if (w->found) {
        w->search.spent = 0u;
    } else {
        w->found = (uint32_t)cr_detect(&w->field, &at, &options, &w->motion, &w->search, &w->set, stats);
    }
    stats->work = w->search.spent / CR_WORK_PARTS;
    return w->found && answer(w, &at, slice, hand, areas, stats);
}
