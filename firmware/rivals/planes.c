/* planes: what the proxies share: contact planes, the nearest allowed displacement, and the spring. */
#include "rivals/rivals.h"

/* Sweeps over the planes; two at 30 degrees converge by 0.75 a sweep. */
#define SWEEPS 32
/* Planes nearer to each other than this cosine are one. */
#define SAME_COS 0.99999f
#define STILL_M 1e-8f

void cr_rival_add_plane(cr_rival_planes *p, cr_vec3 gradient, float phi_m) {
    float length = v3_norm(gradient);
    if (!(length > 0.1f)) {
        return;
    }
    cr_vec3 n = v3_scale(gradient, 1.0f / length);
    float least = -phi_m / length;
    uint32_t at = p->count, lowest = 0u;
    for (uint32_t i = 0; i < p->count; i++) {
        at = v3_dot(p->normal[i], n) > SAME_COS ? i : at;
        lowest = p->least_m[i] < p->least_m[lowest] ? i : lowest;
    }
    if (at < p->count || p->count == CR_RIVAL_PLANES_MAX) {
        at = at < p->count ? at : lowest;
        if (p->least_m[at] >= least) {
            return;
        }
    } else {
        p->count++;
    }
    p->normal[at] = n;
    p->least_m[at] = least;
}

/* Hildreth's method: the multiplier of each plane in turn. */
cr_vec3 cr_rival_project(const cr_rival_planes *p, cr_vec3 goal_m) {
    float pressed[CR_RIVAL_PLANES_MAX] = {0.0f};
    cr_vec3 d = goal_m;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        for (uint32_t i = 0; i < p->count; i++) {
            float next = max_f(0.0f, pressed[i] + p->least_m[i] - v3_dot(p->normal[i], d));
            d = v3_mad(d, p->normal[i], next - pressed[i]);
            pressed[i] = next;
        }
    }
    return d;
}

void cr_rival_start(const cr_respond_input *in) {
    const float most_m = (float)CR_RIVAL_STEPS * cr_rival_reach(in);
    const cr_vec3 device_m = in->world_from_tool->t;
    cr_proxy *proxy = in->proxy;
    proxy->pos_m = proxy->held ? proxy->pos_m : proxy->device_m;
    if (!(v3_norm(v3_sub(device_m, proxy->device_m)) <= most_m)) {
        proxy->pos_m = device_m;
    }
    proxy->held = 1u;
}

int cr_rival_step(cr_proxy *proxy, cr_vec3 device_m, cr_rival_planes *planes, float step_m) {
    cr_vec3 d = cr_rival_project(planes, v3_sub(device_m, proxy->pos_m));
    float length = v3_norm(d);
    if (!(length > STILL_M)) {
        return 0;
    }
    d = v3_scale(d, min_f(1.0f, step_m / length));
    proxy->pos_m = v3_add(proxy->pos_m, d);
    for (uint32_t i = 0; i < planes->count; i++) {
        planes->least_m[i] -= v3_dot(planes->normal[i], d);
    }
    return 1;
}

uint32_t cr_rival_pull(const cr_proxy *proxy, cr_vec3 device_m, cr_area *out) {
    cr_rival_sum sum = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, 0.0f};
    cr_vec3 pull = v3_sub(proxy->pos_m, device_m);
    /* Less than the rounding of the two places is no contact. */
    float far = abs_f(device_m.x) + abs_f(device_m.y) + abs_f(device_m.z);
    if (!(v3_norm(pull) > STILL_M + 1e-6f * far)) {
        return 0u;
    }
    cr_rival_add(&sum, pull, device_m);
    return cr_rival_finish(&sum, 0.0f, out);
}

float cr_rival_reach(const cr_respond_input *in) { return in->field->scene->meta->voxel_m; }
