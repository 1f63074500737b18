/* tick: pose in, wrench out, by search and feel: in one call, or each in its own time. */
#include "contact/world.h"

/* More than any answer takes. */
#define ANSWER_WORK 0x40000000u

/* What was made at the pose that was searched at. In free space it must cost nothing. */
static void take_made(cr_world *w) {
    if (w->made.count + w->in_hand > 0u) {
        w->made.stamp = w->searched.stamp - (uint32_t)(w->made.ahead > 0u && w->searched.stamp == w->felt.stamp);
        cr_take_hand(w, &w->made);
    } else {
        w->hand.stamp = w->searched.stamp;
    }
}

void cr_tick(cr_world *w, const cr_pose *world_from_tool, float period_s, cr_output *out) {
    const cr_slice slice = {.work = w->config.lookups_max, .slices_max = CR_SEARCH_TICKS_MAX};
    if (cr_accept(w, world_from_tool, period_s, out)) {
        if (cr_search_slice(w, &w->felt, &slice, &w->made, out->areas, &out->stats)) {
            take_made(w);
        }
        cr_render(w, period_s, out);
    }
}

uint32_t cr_search(cr_world *w, uint32_t work) {
    const cr_slice slice = {.work = work > 0u ? work : 1u, .slices_max = UINT32_MAX};
    cr_stats stats = {0};
    cr_felt newest;
    if (cr_mailbox_take(&w->poses, w->pose_words, &newest, CR_WORDS_OF(cr_felt), &w->poses_seen)) {
        w->wanted = newest;
    }
    /* One answer after another, each of which is felt: where the next one looks hangs on it. */
    const int waits = w->wanted.stamp == w->made.stamp || w->wanted.hand != w->made.stamp;
    if (waits && w->wanted.memory == w->made.memory && !w->search.open && !w->found && !w->again) {
        return 0u;
    }
    if (cr_search_slice(w, &w->wanted, &slice, &w->made, w->way.areas, &stats)) {
        w->made.stamp = w->searched.stamp;
        w->made.memory = w->searched.memory;
        cr_mailbox_put(&w->hands, w->hand_words, &w->made, CR_WORDS_OF(cr_hand));
    }
    return stats.work > 0u ? stats.work : 1u;
}

void cr_answer(cr_world *w, const cr_felt *at) {
    cr_mailbox_put(&w->poses, w->pose_words, at, CR_WORDS_OF(cr_felt));
    while (cr_search(w, ANSWER_WORK) > 0u) {
        /* to its end */
    }
}

void cr_feel(cr_world *w, const cr_pose *world_from_tool, float period_s, cr_output *out) {
    cr_hand newest;
    if (cr_accept(w, world_from_tool, period_s, out)) {
        /* Taken first: an answer is of an earlier feel, never of this one, however fast the search. So a recording can put it between two ticks. */
        if (cr_mailbox_take(&w->hands, w->hand_words, &newest, CR_WORDS_OF(cr_hand), &w->hands_seen) &&
            newest.memory == w->felt.memory) {
            cr_take_hand(w, &newest);
        }
        w->felt.hand = w->hand.stamp;
        cr_mailbox_put(&w->poses, w->pose_words, &w->felt, CR_WORDS_OF(cr_felt));
        cr_render(w, period_s, out);
    }
}
