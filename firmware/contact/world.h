/* The state of a world, for the files that share it: world.c makes it, search.c finds contact, feel.c renders it, tick.c does both. */
#ifndef CR_WORLD_H
#define CR_WORLD_H

#include "contact/mailbox.h"
#include "contact/stages.h"
#include "contact/way_out.h"

/* A pose as it was felt. */
typedef struct {
    uint32_t stamp;  /* count of feels */
    uint32_t memory; /* contact found for another memory is forgotten */
    uint32_t hand;   /* stamp of the contact that it was felt with, for a search beside */
    cr_pose pose;
} cr_felt;

/* A half-space that pushes, as it is kept until the next answer: its plane stays in the world, its point on the tool. It pushes a share of how deep it is: others do the
 * rest. It is no deeper than the way from its point to the end of the facet that weighs most in it, and beyond_m more; nor than along its normal out of that facet's plane, which
 * lies at below_m: over an edge its own plane is no surface. */
typedef struct {
    cr_vec3 normal_world, point_tool_m;
    float offset_m, area_m2, share, beyond_m, below_m, leaves;
    uint32_t facet; /* or CR_FACET_NONE */
} cr_held;

/* The contact at the pose with these two numbers. */
typedef struct {
    uint32_t stamp, memory;
    uint32_t ahead; /* 1: where the tool was expected to be by now */
    uint32_t count;
    cr_held held[CR_AREAS_MAX];
} cr_hand;

/* How deep it is with its point at p, were its plane endless. */
static inline float cr_held_depth(const cr_held *h, cr_vec3 p_world) {
    return h->offset_m - v3_dot(h->normal_world, p_world);
}

/* What was felt before the newest contact was taken up, each with the share of it that was felt then. */
typedef struct {
    uint32_t count;
    float share[CR_AREAS_MAX];
    cr_held held[CR_AREAS_MAX];
} cr_behind;

#define CR_WORDS_OF(type) ((uint32_t)(sizeof(type) / sizeof(uint32_t)))

#define CR_LATE_MOST 255u

struct cr_world {
    cr_scene scene;
    cr_field field;
    cr_config config;

    /* of who feels */
    cr_felt felt;     /* the last */
    cr_pose previous; /* the last good one */
    uint32_t has_previous, faults;
    cr_hand hand;      /* the newest contact, */
    uint32_t taken;    /* taken up at the feel with this stamp, */
    uint32_t rises;    /* over so many it rises, */
    cr_behind behind;  /* while this falls; */
    uint32_t in_hand;  /* half-spaces of both */
    uint32_t late_max; /* who feels lets go of an answer that is older, in feels */

    /* between them */
    _Atomic uint32_t poses, hands;
    _Atomic uint32_t pose_words[2u * CR_WORDS_OF(cr_felt)], hand_words[2u * CR_WORDS_OF(cr_hand)];
    uint32_t poses_seen, hands_seen;

    /* of who searches */
    cr_motion motion;
    cr_descent search;
    cr_felt searched;     /* the one that is searched for, at motion.last: */
    uint32_t looks_ahead; /* not 0: where it is expected when it is answered, */
    float expected_m;     /* and how far the contacts in hand push there together, at least */
    cr_felt answered;     /* the last that was, and touched */
    uint32_t again;       /* 1: where it was expected nothing touched, or much less: once more, where it was */
    uint32_t found;       /* 1: at its end, and not answered yet */
    uint32_t answering;   /* 1: the answer has begun */
    cr_felt wanted;       /* the newest pose */
    cr_hand made;         /* the last answer */
    cr_contact_set set;
    cr_way_work way;
#ifdef CR_RIVALS
    cr_proxy proxy;
    uint16_t *hit_of_cluster;
    cr_area_set areas;
#endif
};

/* Work of one slice, and how many an answer may take. */
typedef struct {
    uint32_t work, slices_max;
} cr_slice;

/* Purpose  forget what was searched for. */
void cr_drop_search(cr_world *w);

/* Purpose  one slice of the search for contact at a pose, which is taken up when no search is open.
 * Output   1: it ended; hand holds the contact but for its stamp and memory, out of it areas[0..hand->count) with their zones, no force yet. 0: call again.
 * Shapes   areas[CR_AREAS_MAX].   Cost  stats->work, at most one step more than slice.work. */
int cr_search_slice(cr_world *w, const cr_felt *newest, const cr_slice *slice, cr_hand *hand, cr_area *areas,
                    cr_stats *stats);

/* Purpose  search to the end at a pose that was felt: the next cr_feel takes the answer. For running a recording again.   Cost  as an answer takes. */
void cr_answer(cr_world *w, const cr_felt *at);

/* Purpose  normalised copy of a pose.   Output  0, or CR_FAULT_POSE: not finite, too far out, or no unit quaternion. */
uint32_t cr_check_pose(const cr_pose *in, cr_pose *out);

/* Purpose  check a pose and take it for the next to be felt.   Output  1, or 0 with a fault latched and out of no force. */
int cr_accept(cr_world *w, const cr_pose *world_from_tool, float period_s, cr_output *out);

/* Purpose  take up an answer at the pose that was accepted: one that is n > 1 feels old rises over n feels, and what was felt before falls. */
void cr_take_hand(cr_world *w, const cr_hand *answer);

/* Purpose  let go of the contact in hand: the next answer rises from nothing. */
void cr_drop_hand(cr_world *w);

/* Purpose  the wrench of the contact in hand at the pose that was accepted.
 * Shapes   out->areas hold it already, zones with it, when it was found at this pose. */
void cr_render(cr_world *w, float period_s, cr_output *out);

#endif
