/* couple: the hand held by a spring to a tool that stays outside. Poses and contacts in, a wrench in six degrees of freedom out.
 *
 * Flow     cr_couple_init; then each period cr_couple_step with the hand's pose and the contacts of that moment.
 *          The held tool takes the pose that is nearest to the hand's, in the energy of the coupling, of those that keep every point of every
 *          contact on its side; what the spring between the two then pulls with is the wrench (couple/DESIGN.md).
 * Memory   the caller's: one cr_couple. No heap.
 * Threads  none inside: a coupling belongs to one thread at a time.
 * Time     an argument. No clock, no I/O, no globals: a step is a pure function of (coupling, pose, period, contacts).
 * Units    SI; frames and poses as in crease.h. */
#ifndef CREASE_COUPLE_H
#define CREASE_COUPLE_H

#include "crease.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Contacts of one step, and points of a contact: four carry the extremes of the moment of a face on a face. */
#define CR_COUPLE_CONTACTS_MAX 24u
#define CR_COUPLE_POINTS_MAX 4u

typedef struct {
    float stiffness_N_m;    /* k_t, 1..1e6 */
    float stiffness_Nm_rad; /* k_r, 1e-3..1e4 */
    float damping_Ns_m;     /* 0..1e4, of the velocity of the hand against the held tool, at the centre */
    float damping_Nms_rad;  /* 0..1e2, of the angular velocity */
    float friction;         /* 0..1, Coulomb's coefficient, static and sliding */
    cr_vec3 centre_tool_m;  /* where the two springs are tied, such as the middle of the grip; +-1e4 */
} cr_couple_config;

/* A half-space that the tool must stay in, as the search finds them, and the points of the tool that must: normal . x >= offset. */
typedef struct {
    uint32_t
        key; /* the same number from step to step is the same contact: friction remembers by it where its points hold */
    cr_vec3 normal_world; /* unit within 1e-3, out of the obstacle */
    float offset_m;       /* +-1e5 */
    uint32_t point_count; /* 0..CR_COUPLE_POINTS_MAX */
    cr_vec3 point_tool_m
        [CR_COUPLE_POINTS_MAX]; /* +-1e4; in one order while the key is the same; they may move on the tool */
} cr_couple_contact;

/* Faults latch: the wrench stays zero until cr_couple_reset. CR_FAULT_POSE, _PERIOD and _NUMBER are those of crease.h. */
enum {
    CR_COUPLE_FAULT_CONTACT = 8u /* a contact out of its ranges, or more than there may be */
};

typedef struct {
    cr_vec3 force_world_N;   /* on the hand's tool */
    cr_vec3 torque_world_Nm; /* about the origin of the hand's tool */
    cr_pose held;            /* world_from_tool of the held tool: what the eye should see */
    float inside_m;          /* of its deepest point behind a contact's plane; 0: none is */
    float
        unsettled_m; /* what the last step of the descent still moved; above 1e-7 its work ran out, the next period goes on */
    uint32_t faults;     /* latched */
    uint32_t pressing;   /* points that press; 0: the wrench is zero */
    uint32_t iterations; /* of the descent, at most CR_COUPLE_ITERATIONS_MAX */
} cr_couple_output;
#define CR_COUPLE_ITERATIONS_MAX 24u

/* A point of a contact in hand. Lengths m, but for arm: in lengths of the coupling. */
typedef struct {
    cr_vec3 normal; /* of its contact */
    cr_vec3 arm;    /* from the centre, world frame */
    cr_vec3 slip_m; /* along the plane, from where friction holds it */
    cr_vec3 anchor_world_m;
    float gap_m;  /* above the plane; below 0 it presses */
    float hold_m; /* what friction may carry there, over the coupling's stiffness */
} cr_couple_point;

/* Where friction holds the points of a contact, and where on the tool they were. */
typedef struct {
    uint32_t key, count;
    cr_vec3 tool_m[CR_COUPLE_POINTS_MAX], world_m[CR_COUPLE_POINTS_MAX];
} cr_couple_anchor;

/* State of one coupling: the caller's memory, the library's to write. Poses are of the centre. */
typedef struct {
    cr_couple_config config;
    cr_pose held, hand; /* after the last step */
    uint32_t begun, faults;
    float turning; /* how much the contacts resisted turning in the last step, over the coupling's stiffness */
    uint32_t anchor_count, point_count;
    cr_couple_anchor anchors[CR_COUPLE_CONTACTS_MAX];
    cr_couple_point points[CR_COUPLE_CONTACTS_MAX * CR_COUPLE_POINTS_MAX];
} cr_couple;

/* Purpose  1000 N/m, 5 N m/rad, no damping, no friction, tied at the tool's origin. */
cr_couple_config cr_couple_config_default(void);

/* Purpose  what is wrong with settings: the member and what it may hold.   Output  null when nothing is. */
const char *cr_couple_config_error(const cr_couple_config *config);

/* Purpose  begin: no tool is held yet.   Output  *couple.   Errors  NULL, CONFIG: nothing written. */
cr_err cr_couple_init(cr_couple *couple, const cr_couple_config *config);

/* Purpose  let go and clear faults: the next step begins at the hand's pose, and keeps the settings. */
void cr_couple_reset(cr_couple *couple);

/* Purpose  one period: the held tool follows the hand as far as the contacts let it, and pulls.
 * Units    period_s in (0, 1], from the last step to this one.
 * Shapes   contacts[count], count <= CR_COUPLE_CONTACTS_MAX; null when count is 0. The same half-space twice changes nothing.
 * Output   finite; zero with out->faults set on bad input, not-a-number included. The first step begins at the hand's pose and leads out of what is
 *          pressed there, by the shortest motion; where contacts contradict each other, to where they share what is left.
 * Errors   none: see faults.
 * Cost     iterations times the points that may press: couple/DESIGN.md "Cost". */
void cr_couple_step(cr_couple *couple, const cr_pose *world_from_tool, float period_s,
                    const cr_couple_contact *contacts, uint32_t count, cr_couple_output *out);

#ifdef __cplusplus
}
#endif

#endif
