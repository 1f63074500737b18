/* What passes between the parts of a step of the coupling. Internal: users include couple.h.
 *
 *     hand, contacts -> lay out -> (look -> descend -> move) a few times -> keep anchors -> wrench
 *
 * Unknown is a small motion of the held tool about its centre, in lengths of the coupling: a turn of w rad counts as w * reach, reach = sqrt(k_r / k_t),
 * so that the coupling's energy over k_t is |motion - goal|^2 / 2. */
#ifndef CR_COUPLE_PARTS_H
#define CR_COUPLE_PARTS_H

#include "contact/math3.h"
#include "couple.h"

/* A point behind its plane is pushed by so much of the coupling's stiffness: soft enough for float32, and so hard that a pull of 10 mm leaves it 0.6 um
 * inside. Contacts that contradict each other share what is left by it. */
#define CR_COUPLE_HARD 16384.0f

/* Along the plane friction holds a point by so much of the coupling's stiffness: what it carries bends it, 3 um for 3 mm of pull, and comes back. */
#define CR_COUPLE_GRIP 1024.0f

/* The springs with their dampers over this period, and what follows from them. */
typedef struct {
    float along_N_m, turn_Nm_rad;          /* spring and damper */
    float damper_N_m, damper_Nm_rad;       /* damper alone: damping over period */
    float reach_m;                         /* a turn of 1 rad counts as so much */
    cr_vec3 hand_moved_m, hand_turned_rad; /* since the last step */
    cr_pose hand, before;                  /* of the centre: the hand's now, the held tool's before this step */
} cr_couple_tie;

/* A motion of the held tool, or a force on it over the coupling's stiffness: along, and turning in lengths of the coupling. m. */
typedef struct {
    cr_vec3 along, turn;
} cr_motion6;

static inline float motion_dot(const cr_motion6 *a, const cr_motion6 *b) {
    return v3_dot(a->along, b->along) + v3_dot(a->turn, b->turn);
}

/* What is to be minimised in one round: |motion - goal|^2 / 2, turns weighed by `weight` more, and what the points add. */
typedef struct {
    cr_motion6 goal;
    float weight; /* >= 1 */
    float friction;
    uint32_t count;
} cr_couple_task;

/* Purpose  rotation vector that turns `from` into `to` the shorter way, world frame, rad.   Source  angle by tan of its eighth, Cephes atanf. */
cr_vec3 cr_couple_turn_between(cr_quat from, cr_quat to);

/* Purpose  an attitude turned by a rotation vector, world frame; of unit length again.   Cost  no libm but sqrtf. */
cr_quat cr_couple_turned(cr_quat q, cr_vec3 turn_rad);

/* Purpose  points of the contacts with their anchors: those of the last step, moved with the point on the tool, or where the held tool has them now.
 * Output   couple->points, point_count. */
void cr_couple_lay_out(cr_couple *couple, const cr_couple_contact *contacts, uint32_t count);

/* Purpose  gaps, arms and slips of the points at the held pose.   Output  the longest arm, m. */
float cr_couple_look(cr_couple *couple, const cr_couple_contact *contacts, uint32_t count, float reach_m);

/* Purpose  keep anchors for the next step; where friction did not hold, they follow.   Output  deepest point behind its plane, m. */
float cr_couple_keep(cr_couple *couple, const cr_couple_contact *contacts, uint32_t count);

/* Purpose  the motion of least energy.   Shapes  points[task->count]: their hold_m is set to what friction may carry in the end.
 * Output   *motion; left_m: what the last iteration moved.   Result  iterations made, at most most. */
uint32_t cr_couple_descend(const cr_couple_task *task, cr_couple_point *points, uint32_t most, cr_motion6 *motion,
                           float *left_m);

/* Purpose  what spring and damper pull the held tool with, where it is now, about its centre. */
void cr_couple_pull(const cr_couple *couple, const cr_couple_tie *k, cr_vec3 *force_N, cr_vec3 *torque_Nm);

/* Purpose  one round: the held tool moves as the contacts let it, its points taken to move on straight lines.
 * Output   how far a point may be off them, m; out->iterations, unsettled_m.   Cost  that of the descent. */
float cr_couple_round(cr_couple *couple, const cr_couple_tie *k, const cr_couple_contact *contacts, uint32_t count,
                      cr_couple_output *out);

/* Purpose  begin a period: check what came, with the faults that the caller found, and say how hand and held tool are tied.
 * Output   1; or 0 with a fault latched and *out without force. */
int cr_couple_accept(cr_couple *couple, const cr_pose *world_from_tool, float period_s, uint32_t faults,
                     cr_couple_tie *k, cr_couple_output *out);

/* Purpose  move the held tool, among these contacts, to where the energy is least.   Output  out->iterations, unsettled_m, pressing.   Cost  that of its rounds. */
void cr_couple_try(cr_couple *couple, const cr_couple_tie *k, const cr_couple_contact *contacts, uint32_t count,
                   cr_couple_output *out);

/* Purpose  points that press, as they were looked at last. */
uint32_t cr_couple_pressing(const cr_couple *couple);

/* Purpose  the held tool stays where it is: gaps, and anchors for the next period.   Output  out->inside_m. */
void cr_couple_settle(cr_couple *couple, const cr_couple_tie *k, const cr_couple_contact *contacts, uint32_t count,
                      cr_couple_output *out);

/* Purpose  end a period: the wrench where something presses, and the held pose; a fault, and back to `last`, where a number is none. */
void cr_couple_answer(cr_couple *couple, const cr_couple_tie *k, const cr_pose *last, cr_couple_output *out);

/* Motion of a point under a motion of the tool. */
static inline cr_vec3 point_motion(const cr_couple_point *p, const cr_motion6 *m) {
    return v3_add(m->along, v3_cross(m->turn, p->arm));
}

#endif
