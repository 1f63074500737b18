/* search: the contact at a pose, in slices. */
#include "contact/world.h"

void cr_drop_search(cr_world *w) { w->search.open = w->found = w->answering = 0u; }

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

/* What later ticks need of the areas that were answered. */
static void keep(const xform *at, const cr_area *areas, cr_hand *hand) {
    CR_ASSERT(hand->count <= CR_AREAS_MAX);
    for (uint32_t i = 0; i < hand->count; i++) {
        const cr_area *a = &areas[i];
        const cr_vec3 point_tool_m = xform_unrotate(at, v3_sub(a->point_world_m, at->t));
        hand->held[i] = (cr_held){a->normal_world, point_tool_m, a->offset_m, a->area_m2};
    }
}

/* Answer the contact that was found, at the pose it was searched at. Returns whether it is answered. */
static int answer(cr_world *w, const xform *at, const cr_slice *slice, cr_hand *hand, cr_area *areas, cr_stats *stats) {
    hand->count = 0u;
    if (w->set.hit_count > 0u) {
        if (!respond(w, at, slice, hand, areas, stats)) {
            return 0;
        }
        keep(at, areas, hand);
        stats->contacts = w->set.contacts;
        stats->clusters = w->set.hit_count;
        w->answering = 0u;
    }
    w->found = 0u;
#ifdef CR_RIVALS
    w->proxy.held = w->set.hit_count > 0u ? w->proxy.held : 0u;
#endif
    return 1;
}

int cr_search_slice(cr_world *w, const cr_felt *newest, const cr_slice *slice, cr_hand *hand, cr_area *areas,
                    cr_stats *stats) {
    CR_ASSERT(!(w->search.open && w->found) && (w->found || !w->answering));
    if (newest->memory != w->searched_memory) {
        cr_drop_search(w);
        w->motion.valid = 0u;
#ifdef CR_RIVALS
        w->proxy.held = 0u;
#endif
    }
    if (!w->search.open && !w->found) {
        w->searched_stamp = newest->stamp;
        w->searched_memory = newest->memory;
#ifdef CR_RIVALS
        w->proxy.device_m = w->motion.valid ? w->motion.last.pos_m : newest->pose.pos_m;
#endif
        cr_motion_advance(&w->motion, &newest->pose);
    }
    const xform at = xform_from_pose(&w->motion.last);
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
