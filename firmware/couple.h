/* couple: the hand held by a spring to a tool that stays outside. Poses and contacts in, a wrench in six degrees of freedom out.
 *
 * Flow     cr_coupled_init; then each period cr_couple_tick with the hand's pose: it looks for contacts round the held tool itself. Or, for contacts of
 *          another origin, cr_couple_init; then each period cr_couple_step with the hand's pose and the contacts of that moment.
 *          The held tool takes the pose that is nearest to the hand's, in the energy of the coupling, of those that keep every point of every
 *          contact on its side; what the spring between the two then pulls with is the wrench (couple/DESIGN.md).
 * Memory   the caller's: one cr_couple, 8 KB, for steps; one cr_coupled, 80 KB, for ticks. No heap.
 * Threads  none inside: a coupling belongs to one thread at a time.
 * Time     an argument. No clock, no I/O, no globals: a step is a pure function of (coupling, pose, period, contacts), a tick of (coupling, scene,
 *          pose, period).
 * Limit    none of the force: it is what the spring pulls with, however far the hand is; the handle's own limit is the caller's.
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
    float
        inside_m; /* of its deepest point behind a contact's plane, in a tick behind that of any near sample; 0: none is */
    float
        unsettled_m; /* what the last step of the descent still moved; above 1e-7 its work ran out, the next period goes on */
    uint32_t faults; /* latched */
    uint32_t
        pressing; /* points that press; 0: the wrench is zero. A tick that was cut short on the way tells those of the tick before */
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

/* Planes of samples of the tool that may be near the obstacle at one time: one for each, or as many as walls that meet there. 32 bytes each. */
#ifndef CR_COUPLE_NEAR_MAX
#define CR_COUPLE_NEAR_MAX 2048u
#endif
#if CR_COUPLE_NEAR_MAX < 64u || CR_COUPLE_NEAR_MAX % 16u != 0u
#error "CR_COUPLE_NEAR_MAX: a face on a face needs some tens of samples; a multiple of 16"
#endif

/* Groups of 16 spheres of the tool's tree of which is remembered how far off they were. Those beyond are looked at anew each time. 66 bytes each. */
#ifndef CR_COUPLE_GROUPS_MAX
#define CR_COUPLE_GROUPS_MAX 64u
#endif
#if CR_COUPLE_GROUPS_MAX < 1u
#error "CR_COUPLE_GROUPS_MAX: the root at least"
#endif

/* Steps of the held tool in one tick, at most. */
#define CR_COUPLE_STEPS_MAX 8u

/* Sixteen samples of the tool near the obstacle, a plane each: it must stay on the side that it is on. World frame, from the middle of the held tool. */
typedef struct {
    float normal_x[CR_LANES], normal_y[CR_LANES], normal_z[CR_LANES];
    float arm_x_m[CR_LANES], arm_y_m[CR_LANES], arm_z_m[CR_LANES];
    float gap_m[CR_LANES];
    uint32_t key[CR_LANES]; /* of the sample and the plane: they rise */
} cr_couple_near;

/* A place on the line of a piece of surface, and what was looked up there. */
typedef struct {
    float share, phi_m, slope;
    cr_vec3 gradient; /* tool frame */
} cr_couple_end;

/* Of a sample's piece of surface: the way from its middle to its end, the way the distance falls, in one line. Tool frame. */
typedef struct {
    cr_vec3 way, bend; /* bend: from the piece at the end of that way up to its plane; of a crease: how far it bulges */
    float reach_m;     /* how far the piece reaches down from its middle */
    cr_couple_end low, high; /* the distance falls at the low one */
} cr_couple_line;

/* What is round the held tool: what was near where it was looked at last, and how far the tool may go before the rest has to be looked at. */
typedef struct {
    const void *image; /* of the scene that was looked in; null: not yet */
    cr_pose centre;    /* of the held tool then */
    uint32_t ticks;    /* since then */
    float free_m;      /* no point of the tool that is not among the near ones was nearer */
    float pace_m;      /* how far its points were to go in the last tick, at most */
    uint32_t dropped;  /* samples that were near, and left out */
    uint32_t crowded;  /* 1: of these, some had no room */
    uint32_t near_count;
    cr_couple_near near[CR_COUPLE_NEAR_MAX / CR_LANES];
    cr_couple_line lines[CR_LANES]; /* of the samples that are looked at: nothing of them outlives that */

    /* How far the tool may have moved since a sphere was looked at: contact/DESIGN.md "Detect". */
    cr_pose tool;
    float slide_m, slide_lost_m, turn_rad, turn_lost_rad;
    float wake_m[CR_COUPLE_GROUPS_MAX * CR_LANES];
    uint16_t by_points[CR_COUPLE_GROUPS_MAX]; /* lanes whose samples were looked at, not their sphere */
} cr_couple_found;

/* Work done and trouble met in one tick. Plain counts, but for what is named otherwise. */
typedef struct {
    uint32_t steps;    /* of the held tool */
    uint32_t descents; /* looks for the least energy */
    uint32_t lookups;  /* of 16 points */
    uint32_t near;     /* planes of near samples, in the last step */
    uint32_t contacts; /* of these, those that were asked, in the last step */
    uint32_t
        dropped; /* samples left out, as more were near than CR_COUPLE_NEAR_MAX, or one had no direction out: the tool is held by the others */
    uint32_t refused; /* steps that were cut short, as there were more contacts than CR_COUPLE_CONTACTS_MAX */
    float left_m;     /* what a point of the tool was to move and did not: the next tick goes on */
} cr_couple_stats;

/* A coupling that looks for its contacts: the caller's memory, the library's to write. */
typedef struct {
    cr_couple couple;
    cr_couple_stats stats; /* of the last tick */
    uint32_t pressed;      /* points that pressed at its end, or when it last was not on its way */
    uint32_t contact_count;
    cr_couple_contact contacts[CR_COUPLE_CONTACTS_MAX];
    cr_couple_found found;
} cr_coupled;

/* Purpose  begin: no tool is held yet.   Output  *coupled.   Errors  as cr_couple_init. */
cr_err cr_coupled_init(cr_coupled *coupled, const cr_couple_config *config);

/* Purpose  let go and clear faults: the next tick begins at the hand's pose. Needed before a tick in another image that lies where the last one did. */
void cr_coupled_reset(cr_coupled *coupled);

/* Purpose  one tick: the held tool follows the hand as far as the scene lets it, in steps that pass through nothing, and pulls.
 * Shapes   world: its scene is looked up, nothing of it is written.
 * Output   as cr_couple_step, and coupled->stats. The first tick begins at the hand's pose: what is inside there is led out the way its distance grows, over as
 *          many ticks as that takes. Begun where that leads to no way out, as 14 mm deep in a V-groove's flank, it stays inside, and out->inside_m says so
 *          tick by tick: begin outside.
 * Late     a hand that is faster than CR_COUPLE_STEPS_MAX steps of half a voxel a tick is followed over several.
 * Errors   none: see faults; a null world is CR_COUPLE_FAULT_CONTACT.   Cost  couple/DESIGN.md "Cost"; inside, or among thousands of near samples, no bound is kept. */
void cr_couple_tick(cr_coupled *coupled, const cr_world *world, const cr_pose *world_from_tool, float period_s,
                    cr_couple_output *out);

/* ------------------------------------------------------------------------------------------- passivity of a loop
 *
 * A spring is passive; sampled, held over a period and felt late it is not. What the wrench gave to the hand is counted along and about all axes, and where it
 * is more than it took, damping takes the rest back [Hannaford, Ryu 2002]. As long as it took more, the wrench is the coupling's to the bit. */

/* Periods from the sample that a wrench was computed from to the one after which it acts, at most. */
#define CR_COUPLE_DELAY_MAX 7u
typedef struct {
    float reach_m;          /* a turn of 1 rad counts as so much, 1e-4..1e2: sqrt(k_r / k_t) makes both springs alike */
    float damping_max_Ns_m; /* of the controller, along the wrench, 0..1e4; 0: it counts only */
    float own_damping_Ns_m; /* 0..1e3: viscous friction of the device that burns an excess, less than any axis has */
    float own_damping_Nms_rad; /* 0..10, the same of its wrist */
    float force_max_N;         /* 1e-6..1e6, on |force|; force and torque keep their ratio */
    float torque_max_Nm;       /* 1e-6..1e6, on |torque| */
    uint32_t delay_ticks; /* 0..CR_COUPLE_DELAY_MAX; 0: a wrench acts from its own sample on, 1: from the next one on */
} cr_couple_passivity_config;

enum {
    CR_COUPLE_LIMIT_FORCE = 1u,
    CR_COUPLE_LIMIT_TORQUE = 2u,
    CR_COUPLE_LIMIT_PASSIVITY = 4u /* the controller changed the wrench */
};

typedef struct {
    cr_vec3 force_world_N;   /* on the hand's tool */
    cr_vec3 torque_world_Nm; /* about its origin */
    float energy_J;  /* given to the hand since the contact began, less what friction burnt of it; above 0: active */
    uint32_t limits; /* CR_COUPLE_LIMIT_*: what changed the wrench in this tick */
    uint32_t faults; /* latched: as of cr_couple_output */
} cr_couple_wrench;

/* The caller's memory, the library's to write. Six numbers are along X, Y, Z, then about them. */
typedef struct {
    cr_couple_passivity_config config;
    cr_pose before;                          /* the last sample */
    float rate[6];                           /* of the hand's tool, smoothed: m/s, rad/s */
    float sent[CR_COUPLE_DELAY_MAX + 1u][6]; /* wrenches, a ring: N, N m */
    float energy_J;
    uint32_t head, begun, free_ticks, faults;
} cr_couple_passivity;

/* Purpose  reach of the default coupling, 10 N s/m, no friction counted on, 20 N and 1 N m, one period late. */
cr_couple_passivity_config cr_couple_passivity_config_default(void);

/* Purpose  what is wrong with settings: the member and what it may hold.   Output  null when nothing is. */
const char *cr_couple_passivity_config_error(const cr_couple_passivity_config *config);

/* Purpose  begin: nothing was sent.   Errors  NULL, CONFIG: nothing written. */
cr_err cr_couple_passivity_init(cr_couple_passivity *passivity, const cr_couple_passivity_config *config);

/* Purpose  forget motion, energy and faults; the settings stay. */
void cr_couple_passivity_reset(cr_couple_passivity *passivity);

/* Purpose  one period: the wrench to send, from the pose that was sampled and what the coupling feels there.
 * Units    period_s in (0, 1], from the last sample to this one.
 * Output   finite, within the limits; felt to the bit while energy_J is not above 0 and no limit holds. Zero with faults, latched until a
 *          reset: those of felt, which has checked the pose; a period out of range; what is no number.
 * Errors   none: see faults.   Cost  a few hundred instructions. */
void cr_couple_passivity_step(cr_couple_passivity *passivity, const cr_pose *world_from_tool, float period_s,
                              const cr_couple_output *felt, cr_couple_wrench *out);

#ifdef __cplusplus
}
#endif

#endif
