/* Energy that a wrench gives to the hand, along and about all axes, and damping that takes an excess back: DESIGN.md "Passivity of a loop". */
#include "couple/couple_parts.h"

/* An excess is taken back over so many periods: all at once would multiply the noise of the velocity by the largest damping. */
#define DISSIPATE_TICKS 10.0f
/* Below this speed along the wrench the controller waits: dividing by it would give noise, and there is no work to undo. */
#define STILL_M_S 1e-3f
/* Share of a new period in the velocity. One step of an encoder in one period is no speed; 4 ms of lag are a quarter turn at 60 Hz. */
#define SMOOTH 0.2f
#define TINY_N 1e-6f
#define AXES 6u
#define ALONG 3u
#define RING (CR_COUPLE_DELAY_MAX + 1u)

_Static_assert((RING & CR_COUPLE_DELAY_MAX) == 0u, "the ring turns by a mask");

/* Of one period: the wrench, and sums over its axes; [0] along, [1] about. */
typedef struct {
    float wrench[AXES], moved[AXES];
    float wrench2[2], rate2[2];
    float power_W;                    /* of the wrench at the smoothed rate */
    float force_N, torque_Nm, size_N; /* size: a torque counts as a force at the reach */
} period;

cr_couple_passivity_config cr_couple_passivity_config_default(void) {
    const cr_couple_passivity_config c = {0.0707106781f, 10.0f, 0.0f, 0.0f, 20.0f, 1.0f, 1u};
    return c;
}

const char *cr_couple_passivity_config_error(const cr_couple_passivity_config *c) {
    const int in = cr_in_range(c->reach_m, 1e-4f, 1e2f) && cr_in_range(c->damping_max_Ns_m, 0.0f, 1e4f) &&
                   cr_in_range(c->own_damping_Ns_m, 0.0f, 1e3f) && cr_in_range(c->own_damping_Nms_rad, 0.0f, 10.0f) &&
                   cr_in_range(c->force_max_N, 1e-6f, 1e6f) && cr_in_range(c->torque_max_Nm, 1e-6f, 1e6f);
    return in && c->delay_ticks <= CR_COUPLE_DELAY_MAX ? NULL
                                                       : "reach_m: 1e-4..1e2; damping_max_Ns_m: 0..1e4; own damping: "
                                                         "0..1e3, 0..10; limits: 1e-6..1e6; delay_ticks: 0..7";
}

void cr_couple_passivity_reset(cr_couple_passivity *p) {
    for (uint32_t i = 0; i < RING; i++) {
        for (uint32_t k = 0; k < AXES; k++) {
            p->sent[i][k] = p->rate[k] = 0.0f;
        }
    }
    p->energy_J = 0.0f;
    p->head = p->begun = p->free_ticks = p->faults = 0u;
}

cr_err cr_couple_passivity_init(cr_couple_passivity *passivity, const cr_couple_passivity_config *config) {
    if (passivity == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if (cr_couple_passivity_config_error(config) != NULL) {
        return CR_ERR_CONFIG;
    }
    passivity->config = *config;
    cr_couple_passivity_reset(passivity);
    return CR_OK;
}

static void put_six(float *six, cr_vec3 along, cr_vec3 about) {
    six[0] = along.x;
    six[1] = along.y;
    six[2] = along.z;
    six[3] = about.x;
    six[4] = about.y;
    six[5] = about.z;
}

/* Work of the wrench that acted since the sample before. With poses, not with velocities: it telescopes, so that steps of an encoder add no energy. */
static void look_at(cr_couple_passivity *p, const cr_pose *now, float period_s, period *w) {
    const float *acted = p->sent[(p->head - p->config.delay_ticks) & CR_COUPLE_DELAY_MAX];
    const float fresh = SMOOTH / period_s;
    if (p->begun == 0u) {
        p->before = *now;
        p->begun = 1u;
    }
    put_six(w->moved, v3_sub(now->pos_m, p->before.pos_m), cr_couple_turn_between(p->before.rot, now->rot));
    p->before = *now;
    w->power_W = w->wrench2[0] = w->wrench2[1] = w->rate2[0] = w->rate2[1] = 0.0f;
    for (uint32_t k = 0; k < AXES; k++) {
        const uint32_t kind = k / ALONG;
        p->energy_J += acted[k] * w->moved[k];
        p->rate[k] += fresh * w->moved[k] - SMOOTH * p->rate[k];
        w->power_W += w->wrench[k] * p->rate[k];
        w->wrench2[kind] += w->wrench[k] * w->wrench[k];
        w->rate2[kind] += p->rate[k] * p->rate[k];
    }
    w->force_N = sqrtf(w->wrench2[0]);
    w->torque_Nm = sqrtf(w->wrench2[1]);
    w->size_N = sqrtf(w->wrench2[0] + w->wrench2[1] / (p->config.reach_m * p->config.reach_m));
}

/* The device's own friction burns an excess; with the contact over, and its last wrench acted, the account is closed. */
static void settle_account(cr_couple_passivity *p, const period *w, float period_s) {
    const float burnt_W = p->config.own_damping_Ns_m * w->rate2[0] + p->config.own_damping_Nms_rad * w->rate2[1];
    p->free_ticks = w->size_N <= TINY_N ? p->free_ticks + 1u : 0u;
    if (p->free_ticks > p->config.delay_ticks + 1u) {
        p->free_ticks--; /* it does not wrap */
        p->energy_J = 0.0f;
    } else if (p->energy_J > 0.0f) {
        p->energy_J = max_f(p->energy_J - burnt_W * period_s, 0.0f);
    }
}

/* The share of the wrench that damping along it leaves: all axes alike, so that it keeps its direction and never pulls. */
static float damped_share(const cr_couple_passivity *p, const period *w, float period_s) {
    const float speed = w->size_N > TINY_N ? w->power_W / w->size_N : 0.0f, most = p->config.damping_max_Ns_m;
    if (!(p->energy_J > 0.0f) || abs_f(speed) < STILL_M_S) {
        return 1.0f;
    }
    const float damping = min_f(p->energy_J / (DISSIPATE_TICKS * period_s * speed * speed), most);
    return max_f(1.0f - damping * speed / w->size_N, 0.0f);
}

/* What a limit leaves of a size. */
static float within(float size, float most) { return size > most ? most / size : 1.0f; }

/* The share of the wrench that damping and limits leave, the same of all axes.   Output  *limits: CR_COUPLE_LIMIT_*. */
static float share_to_send(const cr_couple_passivity *p, const period *w, float period_s, uint32_t *limits) {
    const float damped = damped_share(p, w, period_s);
    const float force = within(damped * w->force_N, p->config.force_max_N);
    const float torque = within(force * damped * w->torque_Nm, p->config.torque_max_Nm);
    *limits = force < 1.0f ? (uint32_t)CR_COUPLE_LIMIT_FORCE : 0u;
    *limits |= torque < 1.0f ? (uint32_t)CR_COUPLE_LIMIT_TORQUE : 0u;
    *limits |= damped < 1.0f || damped > 1.0f ? (uint32_t)CR_COUPLE_LIMIT_PASSIVITY : 0u;
    return damped * force * torque;
}

void cr_couple_passivity_step(cr_couple_passivity *p, const cr_pose *world_from_tool, float period_s,
                              const cr_couple_output *felt, cr_couple_wrench *out) {
    uint32_t faults = p->faults | felt->faults;
    period w;
    put_six(w.wrench, felt->force_world_N, felt->torque_world_Nm);
    look_at(p, world_from_tool, period_s, &w);
    settle_account(p, &w, period_s);
    float share = share_to_send(p, &w, period_s, &out->limits);
    faults |= period_s > 0.0f && period_s <= 1.0f ? 0u : (uint32_t)CR_FAULT_PERIOD;
    /* What is no number, or infinite, is so in these: a number times 0 is 0. */
    faults |=
        is_finite_f(p->energy_J + share + 0.0f * (w.size_N + w.rate2[0] + w.rate2[1])) ? 0u : (uint32_t)CR_FAULT_NUMBER;
    if (faults != 0u) {
        cr_couple_passivity_reset(p);
        p->faults = faults;
        out->limits = 0u;
    }
    p->head = (p->head + 1u) & CR_COUPLE_DELAY_MAX;
    float *sent = p->sent[p->head];
    for (uint32_t k = 0; k < AXES; k++) {
        sent[k] = faults != 0u ? 0.0f : share * w.wrench[k]; /* a share of 1 changes no bit */
    }
    out->force_world_N = v3_from(sent);
    out->torque_world_Nm = v3_from(sent + ALONG);
    out->energy_J = p->energy_J;
    out->faults = faults;
}
