/* The motored wrist: three axes, each a mass with viscous and dry friction, and the hand on a spring. */
#include "sim.h"

#include <math.h>
#include <string.h>

#define PI 3.14159265358979323846

cr_sim_wrist_params cr_sim_wrist_params_default(void) {
    return (cr_sim_wrist_params){.inertia_kgm2 = {8e-4, 8e-4, 4e-4},
                                 .viscous_Nms_rad = {5e-3, 5e-3, 5e-3},
                                 .coulomb_Nm = {0.01, 0.01, 0.01},
                                 .torque_max_Nm = {1.0, 1.0, 1.0},
                                 .step_rad = 0.01 * PI / 180.0,
                                 .hand_inertia_kgm2 = 1.5e-3,
                                 .hand_damping_Nms_rad = 0.03,
                                 .hand_stiffness_Nm_rad = 2.0,
                                 .path_Hz = 10.0,
                                 .period_s = 1e-3,
                                 .substeps = 10};
}

static int inside(double value, double low, double high) { return isfinite(value) && value >= low && value <= high; }

static int is_wrist(const cr_sim_wrist_params *p) {
    for (int i = 0; i < 3; i++) {
        if (!inside(p->inertia_kgm2[i], 1e-6, 10.0) || !inside(p->viscous_Nms_rad[i], 0.0, 10.0) ||
            !inside(p->coulomb_Nm[i], 0.0, 10.0) || !inside(p->torque_max_Nm[i], 0.0, 100.0)) {
            return 0;
        }
    }
    return inside(p->step_rad, 0.0, 0.1) && inside(p->hand_inertia_kgm2, 0.0, 10.0) &&
           inside(p->hand_damping_Nms_rad, 0.0, 10.0) && inside(p->hand_stiffness_Nm_rad, 0.0, 1e3) &&
           inside(p->path_Hz, 0.1, 1e3) && inside(p->period_s, 1e-4, 0.1) && p->substeps >= 1u && p->substeps <= 1000u;
}

static void read_encoders(cr_sim_wrist *w) {
    for (int i = 0; i < 3; i++) {
        const double step = w->p.step_rad > 0.0 ? w->p.step_rad : 1e-6;
        const double counts = floor(w->angle_rad[i] / step + 0.5);
        w->counts[i] = (int32_t)fmax(fmin(counts, 2147483647.0), -2147483648.0);
    }
}

int cr_sim_wrist_init(cr_sim_wrist *wrist, const cr_sim_wrist_params *params, const double angle_rad[3]) {
    if (!is_wrist(params) || !isfinite(angle_rad[0] + angle_rad[1] + angle_rad[2])) {
        return -1;
    }
    memset(wrist, 0, sizeof *wrist);
    wrist->p = *params;
    memcpy(wrist->angle_rad, angle_rad, sizeof wrist->angle_rad);
    memcpy(wrist->path_rad, angle_rad, sizeof wrist->path_rad);
    read_encoders(wrist);
    return 0;
}

/* Rate after a step under a torque: viscous friction and the hand's damper implicitly, dry friction up to what stops it. */
static double next_rate(const cr_sim_wrist *w, int i, double torque_Nm, double step_s) {
    const double inertia = w->p.inertia_kgm2[i] + w->p.hand_inertia_kgm2;
    const double damping = w->p.viscous_Nms_rad[i] + w->p.hand_damping_Nms_rad;
    const double free = (inertia * w->rate_rad_s[i] + step_s * torque_Nm) / (inertia + step_s * damping);
    const double stops = step_s * w->p.coulomb_Nm[i] / (inertia + step_s * damping);
    return fabs(free) <= stops ? 0.0 : free - copysign(stops, free);
}

static void advance_axis(cr_sim_wrist *w, int i, double target_rad, double step_s) {
    const double omega = 2.0 * PI * w->p.path_Hz;
    const double acc = omega * (omega * (target_rad - w->path_rad[i]) - sqrt(2.0) * w->path_rad_s[i]);
    w->path_rad_s[i] += step_s * acc;
    w->path_rad[i] += step_s * w->path_rad_s[i];
    const double spring = w->p.hand_stiffness_Nm_rad * (w->path_rad[i] - w->angle_rad[i]);
    const double damper = w->p.hand_damping_Nms_rad * w->path_rad_s[i], before = w->rate_rad_s[i];
    w->rate_rad_s[i] = next_rate(w, i, w->motor_Nm[i] + spring + damper, step_s);
    w->angle_rad[i] += step_s * w->rate_rad_s[i];
    const double hand = spring + damper - w->p.hand_damping_Nms_rad * w->rate_rad_s[i];
    const double own = w->p.hand_inertia_kgm2 * (w->rate_rad_s[i] - before) / step_s;
    w->hand_torque_Nm[i] += (own - hand) / w->p.substeps;
}

void cr_sim_wrist_advance(cr_sim_wrist *wrist, const double target_rad[3], const double torque_Nm[3]) {
    const double step_s = wrist->p.period_s / wrist->p.substeps;
    for (int i = 0; i < 3; i++) {
        const double most = wrist->p.torque_max_Nm[i], wanted = isfinite(torque_Nm[i]) ? torque_Nm[i] : 0.0;
        const double target = isfinite(target_rad[i]) ? target_rad[i] : wrist->path_rad[i];
        wrist->motor_Nm[i] = fmax(-most, fmin(most, wanted));
        wrist->hand_torque_Nm[i] = 0.0;
        for (uint32_t n = 0; n < wrist->p.substeps; n++) {
            advance_axis(wrist, i, target, step_s);
        }
    }
    read_encoders(wrist);
}

void cr_sim_wrist_bump(cr_sim_wrist *wrist, const double impulse_Nms[3]) {
    if (isfinite(impulse_Nms[0] + impulse_Nms[1] + impulse_Nms[2])) {
        for (int i = 0; i < 3; i++) {
            wrist->rate_rad_s[i] += impulse_Nms[i] / (wrist->p.inertia_kgm2[i] + wrist->p.hand_inertia_kgm2);
        }
    }
}
