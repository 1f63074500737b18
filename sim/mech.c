/* The mechanism: guide, arm, motors on springs, and the hand that holds the tool, in ODE.
 *
 * ODE's step is v += h a(x), x += h v: leapfrog, of second order when v is read as the velocity half a sub-step earlier and a
 * force as acting from half a sub-step before its instant to half after. So each sub-step gets the mean of the motor force over that
 * interval: without this the torque acts half a sub-step too early and the stable stiffness comes out 5 % high with ten sub-steps. */
#include "sim.h"

#include <math.h>
#include <ode/ode.h>
#include <stdlib.h>
#include <string.h>

#define COMMANDS_MAX 64
/* Part of the arm's link mass that sits in the forearm, its centre of mass at the elbow: the inertia of the two motors then
 * does not couple, which is how a counterweighted parallelogram is built. */
#define FOREARM_SHARE 0.25
#define UPPER_MASS_KG 0.3
#define ROTOR_MASS_KG 0.05
#define PI 3.14159265358979323846

enum { X = 0, Y = 1, Z = 2 };

typedef struct {
    uint64_t at; /* sub-step from which it holds, declared delay included */
    double torque[CR_SIM_AXES];
} command;

struct cr_mech {
    cr_sim_params p;
    dWorldID world;
    dBodyID carriage, upper, fore, hand;
    dBodyID motor[CR_SIM_AXES]; /* rigid: null */
    dJointID slider, shoulder, elbow;
    dJointID friction[CR_SIM_AXES]; /* joints whose motor is the Coulomb friction */
    double inertia[CR_SIM_AXES];    /* motor and load together: kg, kg m^2 */
    double spring[CR_SIM_AXES], damper[CR_SIM_AXES];
    double viscous[CR_SIM_AXES], coulomb[CR_SIM_AXES]; /* of the joint */
    double step_s;
    uint64_t substep, delay;
    command commands[COMMANDS_MAX];
    uint32_t command_count;
    double amplifier[CR_SIM_AXES], held[CR_SIM_AXES]; /* output; demand before the present instant */
    double start_tip[3], target[3], path_pos[3], path_vel[3], wrist[3];
    double tip_before[3], acc[3], hand_force[3];
    uint32_t limits;
};

static double arm_m(const cr_mech *mech, int axis) { return axis == X ? 1.0 : mech->p.link_m[axis - 1]; }

cr_sim_params cr_sim_params_default(void) {
    const cr_sim_axis guide = {5.4, 3.5, 1.0, 50.0, 0.02, 0.3, 60e-6};
    const cr_sim_axis arm = {1.2, 1.5, 0.4, 60.0, 0.03, 0.3, 40e-6};
    return (cr_sim_params){.axes = {guide, arm, arm},
                           .stroke_m = 1.5,
                           .link_m = {0.45, 0.45},
                           .elbow_min_rad = 40.0 * PI / 180.0,
                           .elbow_max_rad = 140.0 * PI / 180.0,
                           .start_rad = {PI / 4.0, -PI / 4.0},
                           .amplifier_Hz = 500.0,
                           .gravity_N = 0.2,
                           .wrist_step_rad = 0.05 * PI / 180.0,
                           .hand_mass_kg = 0.8,
                           .hand_damping_Ns_m = 5.5,
                           .hand_stiffness_N_m = 300.0,
                           .path_Hz = 10.0,
                           .period_s = 1e-3,
                           .substeps = 10};
}

cr_sim_params cr_sim_params_linear(void) {
    cr_sim_params p = cr_sim_params_default();
    for (int i = 0; i < CR_SIM_AXES; i++) {
        p.axes[i].coulomb_N = 0.0;
        p.axes[i].step_m = 0.0;
    }
    p.amplifier_Hz = 0.0;
    p.gravity_N = 0.0;
    p.wrist_step_rad = 0.0;
    p.hand_mass_kg = 0.0;
    p.rigid = 1;
    return p;
}

static int within(double value, double low, double high) { return isfinite(value) && value >= low && value <= high; }

static int valid_axis(const cr_sim_axis *a) {
    return within(a->mass_kg, 0.1, 1e3) && within(a->viscous_Ns_m, 0.0, 1e4) && within(a->coulomb_N, 0.0, 1e3) &&
           within(a->mode_Hz, 1.0, 1e3) && within(a->mode_damping, 0.0, 1.0) && within(a->motor_share, 0.01, 0.99) &&
           within(a->step_m, 0.0, 0.1);
}

static int valid(const cr_sim_params *p) {
    const double elbow = PI - (p->start_rad[0] - p->start_rad[1]);
    int ok = within(p->stroke_m, 1e-3, 100.0) && within(p->link_m[0], 0.01, 10.0) && within(p->link_m[1], 0.01, 10.0) &&
             within(p->elbow_min_rad, 0.0, PI) && within(p->elbow_max_rad, p->elbow_min_rad, PI) &&
             within(elbow, p->elbow_min_rad, p->elbow_max_rad) && within(p->start_rad[0], -PI, PI) &&
             within(p->amplifier_Hz, 0.0, 1e5) && within(p->gravity_N, -100.0, 100.0) &&
             within(p->wrist_step_rad, 0.0, 1.0) && within(p->hand_mass_kg, 0.0, 100.0) &&
             within(p->hand_damping_Ns_m, 0.0, 1e4) && within(p->hand_stiffness_N_m, 0.0, 1e6) &&
             within(p->path_Hz, 0.1, 100.0) && within(p->torque_delay_s, 0.0, 1e-3 * CR_SIM_DELAY_MAX_MS) &&
             within(p->period_s, 1e-5, 0.1) && p->substeps >= 1u && p->substeps <= 1000u && p->rigid <= 1u;
    for (int i = 0; i < CR_SIM_AXES; i++) {
        ok = ok && valid_axis(&p->axes[i]);
    }
    return ok;
}

static dBodyID body(cr_mech *mech, double mass_kg, double inertia_x, const double pos[3]) {
    dMass mass;
    dBodyID id = dBodyCreate(mech->world);
    dMassSetParameters(&mass, mass_kg, 0, 0, 0, inertia_x, 0.01, 0.01, 0, 0, 0);
    dBodySetMass(id, &mass);
    dBodySetPosition(id, pos[X], pos[Y], pos[Z]);
    dBodySetGyroscopicMode(id, 0); /* all turn about X only */
    return id;
}

static dJointID slider(cr_mech *mech, dBodyID id) {
    dJointID joint = dJointCreateSlider(mech->world, NULL);
    dJointAttach(joint, id, NULL);
    dJointSetSliderAxis(joint, 1, 0, 0);
    return joint;
}

static dJointID hinge(cr_mech *mech, dBodyID id, dBodyID parent, const double pos[3]) {
    dJointID joint = dJointCreateHinge(mech->world, NULL);
    dJointAttach(joint, id, parent);
    dJointSetHingeAnchor(joint, pos[X], pos[Y], pos[Z]);
    dJointSetHingeAxis(joint, 1, 0, 0);
    return joint;
}

/* Friction of a rigid forearm, which turns against the carriage without a joint between the two. */
static dJointID forearm_friction(cr_mech *mech) {
    dJointID joint = dJointCreateAMotor(mech->world, NULL);
    dJointAttach(joint, mech->fore, mech->carriage);
    dJointSetAMotorNumAxes(joint, 1);
    dJointSetAMotorAxis(joint, 0, 0, 1, 0, 0);
    return joint;
}

static void set_inertia(cr_mech *mech) {
    const cr_sim_params *p = &mech->p;
    for (int i = 0; i < CR_SIM_AXES; i++) {
        const double arm = arm_m(mech, i), square = arm * arm;
        mech->inertia[i] = p->axes[i].mass_kg * square;
        mech->viscous[i] = p->axes[i].viscous_Ns_m * square;
        mech->coulomb[i] = p->axes[i].coulomb_N * arm;
        const double share = p->axes[i].motor_share, omega = 2.0 * PI * p->axes[i].mode_Hz;
        const double reduced = share * (1.0 - share) * mech->inertia[i];
        mech->spring[i] = reduced * omega * omega;
        mech->damper[i] = 2.0 * p->axes[i].mode_damping * reduced * omega;
    }
}

/* Where the elbow and the tip are, from the bodies. */
static void forearm_end(const cr_mech *mech, double pos[3]) {
    dVector3 world;
    dBodyGetRelPointPos(mech->fore, 0, mech->p.link_m[1] * cos(mech->p.start_rad[1]),
                        mech->p.link_m[1] * sin(mech->p.start_rad[1]), world);
    memcpy(pos, world, 3 * sizeof *pos);
}

static int build_links(cr_mech *mech) {
    const cr_sim_params *p = &mech->p;
    const double load[CR_SIM_AXES] = {p->rigid ? 1.0 : 1.0 - p->axes[X].motor_share,
                                      p->rigid ? 1.0 : 1.0 - p->axes[Y].motor_share,
                                      p->rigid ? 1.0 : 1.0 - p->axes[Z].motor_share};
    const double base[3] = {0, 0, 0}, l0 = p->link_m[0];
    const double at_elbow[3] = {0, l0 * cos(p->start_rad[0]), l0 * sin(p->start_rad[0])};
    const double fore_kg = FOREARM_SHARE * load[Y] * p->axes[Y].mass_kg;
    const double rotors_kg = p->rigid ? 0.0 : 2.0 * ROTOR_MASS_KG;
    const double carriage_kg = load[X] * mech->inertia[X] - UPPER_MASS_KG - fore_kg - rotors_kg;
    if (carriage_kg <= 0.0) {
        return -1;
    }
    mech->carriage = body(mech, carriage_kg, 1.0, base);
    /* The upper link carries the forearm at its end: that part of its inertia is the forearm's. */
    mech->upper = body(mech, UPPER_MASS_KG, load[Y] * mech->inertia[Y] - fore_kg * l0 * l0, base);
    mech->fore = body(mech, fore_kg, load[Z] * mech->inertia[Z], at_elbow);
    mech->slider = slider(mech, mech->carriage);
    dJointSetSliderParam(mech->slider, dParamLoStop, -0.5 * p->stroke_m);
    dJointSetSliderParam(mech->slider, dParamHiStop, 0.5 * p->stroke_m);
    mech->shoulder = hinge(mech, mech->upper, mech->carriage, base);
    mech->elbow = hinge(mech, mech->fore, mech->upper, at_elbow);
    /* ODE counts from the start; elbow = pi - (q1 - q2), so that q2 - q1 grows with it. */
    const double elbow = PI - (p->start_rad[0] - p->start_rad[1]);
    dJointSetHingeParam(mech->elbow, dParamLoStop, p->elbow_min_rad - elbow);
    dJointSetHingeParam(mech->elbow, dParamHiStop, p->elbow_max_rad - elbow);
    return 0;
}

static void build_motors(cr_mech *mech) {
    const double base[3] = {0, 0, 0};
    const cr_sim_params *p = &mech->p;
    if (p->rigid) {
        mech->friction[X] = mech->slider;
        mech->friction[Y] = mech->shoulder;
        mech->friction[Z] = forearm_friction(mech);
        return;
    }
    mech->motor[X] = body(mech, p->axes[X].motor_share * mech->inertia[X], 1.0, base);
    mech->friction[X] = slider(mech, mech->motor[X]);
    for (int i = Y; i <= Z; i++) {
        mech->motor[i] = body(mech, ROTOR_MASS_KG, p->axes[i].motor_share * mech->inertia[i], base);
        mech->friction[i] = hinge(mech, mech->motor[i], mech->carriage, base);
    }
}

static void build_hand(cr_mech *mech) {
    forearm_end(mech, mech->start_tip);
    memcpy(mech->target, mech->start_tip, sizeof mech->target);
    memcpy(mech->path_pos, mech->start_tip, sizeof mech->path_pos);
    if (mech->p.hand_mass_kg > 0.0) {
        mech->hand = body(mech, mech->p.hand_mass_kg, 0.01, mech->start_tip);
        dJointID grip = dJointCreateBall(mech->world, NULL);
        dJointAttach(grip, mech->hand, mech->fore);
        dJointSetBallAnchor(grip, mech->start_tip[X], mech->start_tip[Y], mech->start_tip[Z]);
    }
}

cr_mech *cr_mech_create(const cr_sim_params *params) {
    if (params == NULL || !valid(params)) {
        return NULL;
    }
    cr_mech *mech = calloc(1, sizeof *mech);
    if (mech == NULL) {
        return NULL;
    }
    dInitODE2(0);
    mech->p = *params;
    mech->world = dWorldCreate();
    mech->step_s = params->period_s / params->substeps;
    mech->delay = (uint64_t)llround(params->torque_delay_s / mech->step_s);
    set_inertia(mech);
    if (build_links(mech) != 0) {
        cr_mech_destroy(mech);
        return NULL;
    }
    build_motors(mech);
    build_hand(mech);
    return mech;
}

void cr_mech_destroy(cr_mech *mech) {
    if (mech != NULL) {
        dWorldDestroy(mech->world);
        dCloseODE();
        free(mech);
    }
}

void cr_mech_command(cr_mech *mech, const double torque[CR_SIM_AXES]) {
    const uint64_t at = mech->substep + mech->delay;
    if (mech->command_count > 0u && mech->commands[mech->command_count - 1u].at == at) {
        mech->command_count--; /* overtaken before it acted */
    }
    if (mech->command_count == COMMANDS_MAX) { /* the oldest has acted long ago: a delay holds at most 50 periods */
        mech->command_count--;
        memmove(mech->commands, mech->commands + 1, mech->command_count * sizeof *mech->commands);
    }
    command *next = &mech->commands[mech->command_count++];
    next->at = at;
    for (int i = 0; i < CR_SIM_AXES; i++) {
        next->torque[i] = isfinite(torque[i]) ? torque[i] : 0.0;
    }
}

void cr_mech_target(cr_mech *mech, const double target_m[3], const double wrist_rad[3]) {
    for (int i = 0; i < 3; i++) {
        if (isfinite(target_m[i])) {
            mech->target[i] = target_m[i];
        }
        if (isfinite(wrist_rad[i])) {
            mech->wrist[i] = wrist_rad[i];
        }
    }
}

static dBodyID driven(const cr_mech *mech, int axis) {
    const dBodyID links[CR_SIM_AXES] = {mech->carriage, mech->upper, mech->fore};
    return mech->p.rigid ? links[axis] : mech->motor[axis];
}

/* Position of a body in the coordinate of an axis: m, or rad against its own start. */
static double place(dBodyID id, int axis) {
    if (axis == X) {
        return dBodyGetPosition(id)[X];
    }
    const dReal *q = dBodyGetQuaternion(id);
    return 2.0 * atan2(q[1], q[0]);
}

static double rate_of(dBodyID id, int axis) { return axis == X ? dBodyGetLinearVel(id)[X] : dBodyGetAngularVel(id)[X]; }

static double joint(const cr_mech *mech, int axis) {
    const double turn = place(driven(mech, axis), axis);
    return axis == X ? turn : remainder(turn, 2.0 * PI) + mech->p.start_rad[axis - 1];
}

/* A force or torque on a body, and its reaction where that is not the ground. */
static void push(const cr_mech *mech, dBodyID id, int axis, double effort) {
    if (axis == X) {
        dBodyAddForce(id, effort, 0, 0);
    } else {
        dBodyAddTorque(id, effort, 0, 0);
        dBodyAddTorque(mech->carriage, -effort, 0, 0);
    }
}

static void couple(const cr_mech *mech, int axis) {
    const dBodyID links[CR_SIM_AXES] = {mech->carriage, mech->upper, mech->fore};
    const dBodyID link = links[axis], motor = mech->motor[axis];
    const double stretch = axis == X ? place(motor, axis) - place(link, axis)
                                     : remainder(place(motor, axis) - place(link, axis), 2.0 * PI);
    const double effort =
        mech->spring[axis] * stretch + mech->damper[axis] * (rate_of(motor, axis) - rate_of(link, axis));
    push(mech, link, axis, effort);
    push(mech, motor, axis, -effort);
}

static void set_friction(const cr_mech *mech, int axis) {
    const dJointID joint_id = mech->friction[axis];
    const double most = mech->coulomb[axis];
    switch (dJointGetType(joint_id)) {
    case dJointTypeSlider:
        dJointSetSliderParam(joint_id, dParamVel, 0);
        dJointSetSliderParam(joint_id, dParamFMax, most);
        break;
    case dJointTypeHinge:
        dJointSetHingeParam(joint_id, dParamVel, 0);
        dJointSetHingeParam(joint_id, dParamFMax, most);
        break;
    default:
        dJointSetAMotorParam(joint_id, dParamVel, 0);
        dJointSetAMotorParam(joint_id, dParamFMax, most);
        break;
    }
}

/* Mean over `time_s` of a first-order lag with constant input; moves its output on. Exact. */
static double lag_mean(double *output, double input, double time_s, double cutoff_Hz) {
    if (cutoff_Hz <= 0.0) {
        *output = input;
        return input;
    }
    const double ratio = 2.0 * PI * cutoff_Hz * time_s, gone = -expm1(-ratio), away = *output - input;
    *output = input + away * (1.0 - gone);
    return input + away * gone / ratio;
}

/* Demand from this instant on; commands that have been overtaken are forgotten. */
static const double *demand_now(cr_mech *mech) {
    static const double none[CR_SIM_AXES] = {0};
    uint32_t latest = 0;
    while (latest + 1u < mech->command_count && mech->commands[latest + 1u].at <= mech->substep) {
        latest++;
    }
    mech->command_count -= latest;
    memmove(mech->commands, mech->commands + latest, mech->command_count * sizeof *mech->commands);
    return mech->command_count > 0u && mech->commands[0].at <= mech->substep ? mech->commands[0].torque : none;
}

static void drive_motors(cr_mech *mech) {
    const double *demand = demand_now(mech), half_s = 0.5 * mech->step_s;
    for (int i = 0; i < CR_SIM_AXES; i++) {
        const double before = lag_mean(&mech->amplifier[i], mech->held[i], half_s, mech->p.amplifier_Hz);
        const double after = lag_mean(&mech->amplifier[i], demand[i], half_s, mech->p.amplifier_Hz);
        mech->held[i] = demand[i];
        const dBodyID id = driven(mech, i);
        push(mech, id, i, 0.5 * (before + after) - mech->viscous[i] * rate_of(id, i));
        if (!mech->p.rigid) {
            couple(mech, i);
        }
    }
}

static void follow_path(cr_mech *mech) {
    const double omega = 2.0 * PI * mech->p.path_Hz;
    for (int i = 0; i < 3; i++) {
        const double acc = omega * (omega * (mech->target[i] - mech->path_pos[i]) - sqrt(2.0) * mech->path_vel[i]);
        mech->path_vel[i] += mech->step_s * acc;
        mech->path_pos[i] += mech->step_s * mech->path_vel[i];
    }
}

static void pull_hand(cr_mech *mech, double force[3]) {
    const dReal *pos = dBodyGetPosition(mech->hand), *vel = dBodyGetLinearVel(mech->hand);
    for (int i = 0; i < 3; i++) {
        force[i] = mech->p.hand_stiffness_N_m * (mech->path_pos[i] - pos[i]) +
                   mech->p.hand_damping_Ns_m * (mech->path_vel[i] - vel[i]);
    }
    dBodyAddForce(mech->hand, force[X], force[Y], force[Z]);
}

static void tip_velocity(const cr_mech *mech, double vel[3]) {
    dVector3 world;
    dBodyGetRelPointVel(mech->fore, 0, mech->p.link_m[1] * cos(mech->p.start_rad[1]),
                        mech->p.link_m[1] * sin(mech->p.start_rad[1]), world);
    memcpy(vel, world, 3 * sizeof *vel);
}

static void note_limits(cr_mech *mech) {
    const double x = dJointGetSliderPosition(mech->slider), elbow = dJointGetHingeAngle(mech->elbow);
    if (fabs(x) >= 0.5 * mech->p.stroke_m) {
        mech->limits |= 1u;
    }
    if (elbow <= dJointGetHingeParam(mech->elbow, dParamLoStop) ||
        elbow >= dJointGetHingeParam(mech->elbow, dParamHiStop)) {
        mech->limits |= 6u;
    }
}

void cr_mech_advance(cr_mech *mech, uint32_t substeps) {
    double pulled[3] = {0}, tip_after[3];
    for (uint32_t n = 0; n < substeps; n++) {
        double tip[3], force[3];
        for (int i = 0; i < CR_SIM_AXES; i++) {
            set_friction(mech, i);
        }
        drive_motors(mech);
        forearm_end(mech, tip);
        dBodyAddForceAtPos(mech->fore, 0, 0, -mech->p.gravity_N, tip[X], tip[Y], tip[Z]);
        follow_path(mech);
        if (mech->hand != NULL) {
            pull_hand(mech, force);
            for (int i = 0; i < 3; i++) {
                pulled[i] += force[i] / substeps;
            }
        }
        dWorldStep(mech->world, mech->step_s);
        mech->substep++;
    }
    tip_velocity(mech, tip_after);
    for (int i = 0; i < 3 && substeps > 0u; i++) {
        mech->acc[i] = (tip_after[i] - mech->tip_before[i]) / (mech->step_s * substeps);
        mech->hand_force[i] = mech->hand != NULL ? mech->p.hand_mass_kg * mech->acc[i] - pulled[i] : 0.0;
        mech->tip_before[i] = tip_after[i];
    }
    note_limits(mech);
}

static int32_t quantised(double value, double step) {
    const double counts = floor(value / (step > 0.0 ? step : 1e-6) + 0.5);
    return (int32_t)fmax(fmin(counts, 2147483647.0), -2147483648.0);
}

void cr_mech_read(const cr_mech *mech, cr_sim_state *state) {
    *state = (cr_sim_state){.limits = mech->limits};
    for (int i = 0; i < CR_SIM_AXES; i++) {
        state->joint[i] = joint(mech, i);
        state->joint_rate[i] = rate_of(driven(mech, i), i);
        state->joint_torque[i] = mech->amplifier[i];
        state->counts[i] = quantised(state->joint[i], mech->p.axes[i].step_m / arm_m(mech, i));
        state->wrist_counts[i] = quantised(mech->wrist[i], mech->p.wrist_step_rad);
    }
    forearm_end(mech, state->tip_pos_m);
    tip_velocity(mech, state->tip_vel_m_s);
    memcpy(state->tip_acc_m_s2, mech->acc, sizeof mech->acc);
    memcpy(state->hand_force_N, mech->hand_force, sizeof mech->hand_force);
    memcpy(state->hand_target_m, mech->path_pos, sizeof mech->path_pos);
    state->time_us = (uint64_t)llround(1e6 * mech->step_s * (double)mech->substep);
}

void cr_mech_kick(cr_mech *mech, uint32_t axis, double rate) {
    enum { BODIES = 7 };
    const dBodyID bodies[BODIES] = {mech->carriage, mech->upper,    mech->fore,    mech->hand,
                                    mech->motor[X], mech->motor[Y], mech->motor[Z]};
    if (axis == (uint32_t)X) {
        for (size_t i = 0; i < BODIES; i++) {
            if (bodies[i] != NULL) {
                dBodySetLinearVel(bodies[i], rate, 0, 0);
            }
        }
    } else if (axis < CR_SIM_AXES) {
        dBodySetAngularVel(driven(mech, (int)axis), rate, 0, 0);
    }
    tip_velocity(mech, mech->tip_before);
}

void cr_mech_bump(cr_mech *mech, const double impulse_Ns[3]) {
    double tip[3];
    if (isfinite(impulse_Ns[X]) && isfinite(impulse_Ns[Y]) && isfinite(impulse_Ns[Z])) {
        forearm_end(mech, tip);
        dBodyAddForceAtPos(mech->fore, impulse_Ns[X] / mech->step_s, impulse_Ns[Y] / mech->step_s,
                           impulse_Ns[Z] / mech->step_s, tip[X], tip[Y], tip[Z]);
    }
}

void cr_mech_wall(cr_mech *mech, uint32_t axis, double stiffness, double *samples, size_t count) {
    const int at = (int)axis;
    const double zero = axis == (uint32_t)X ? 0.0 : mech->p.start_rad[axis - 1u];
    const double step = mech->p.axes[axis].step_m / arm_m(mech, at);
    double most = 0.0;
    memset(samples, 0, count * sizeof *samples);
    for (size_t k = 0; k < count; k++) {
        const double exact = joint(mech, at), pos = step > 0.0 ? step * quantised(exact, step) : exact;
        double torque[CR_SIM_AXES] = {0};
        samples[k] = exact - zero;
        if (k < count / 10u) {
            most = fmax(most, fabs(samples[k]));
        } else if (fabs(samples[k]) > 10.0 * most) {
            return;
        }
        torque[axis] = -stiffness * (pos - zero);
        cr_mech_command(mech, torque);
        cr_mech_advance(mech, mech->p.substeps);
    }
}
