/* tick: pose in, wrench out. The only file that knows all stages; reads as the list of them. */
#include "contact/stages.h"
#include "contact/way_out.h"

#include <string.h>

#define POSITION_MAX_M 1e4f
#define QUATERNION_TOLERANCE 0.01f
/* Most sweeps over the areas to move the tool out for the eye: it ends when none lacks 0.1 um. */
#define DISPLAY_SWEEPS 16

/* What later ticks need of an area that was answered. */
typedef struct {
    cr_vec3 normal_world, point_world_m;
    float depth_m, offset_m, area_m2;
} held_area;

struct cr_world {
    cr_scene scene;
    cr_field field;
    cr_config config;
    cr_motion motion;
    cr_pose previous;
    uint32_t has_previous;
    uint32_t faults;
    /* The search for contact, and how many ticks ago it began, at motion.last. */
    cr_search search;
    uint32_t searched_age;
    uint32_t found;     /* 1: at its end, and not answered yet */
    uint32_t answering; /* 1: the answer has begun */
    /* The last answer, at the pose it is true for. */
    cr_pose held_at;
    uint32_t held_age, held_count;
    held_area held[CR_AREAS_MAX];
    cr_contact_set set;
    cr_way_work way;
#ifdef CR_RIVALS
    cr_proxy proxy;
    uint16_t *hit_of_cluster;
    cr_area_set areas;
#endif
};

static size_t round_up(size_t n) { return (n + CR_IMG_ALIGN - 1u) / CR_IMG_ALIGN * CR_IMG_ALIGN; }

size_t cr_world_size(const cr_scene *scene, const cr_config *config) {
    if (scene == NULL || config == NULL || scene->meta == NULL || cr_config_error(config) != NULL) {
        return 0u;
    }
    size_t size = round_up(sizeof(cr_world)) + round_up((size_t)scene->group_count * CR_LANES * sizeof(float));
#ifdef CR_RIVALS
    size += round_up((size_t)scene->cluster_count * sizeof(uint16_t));
#endif
    return size;
}

cr_err cr_world_init(cr_world **world, void *memory, size_t size_bytes, const cr_scene *scene,
                     const cr_config *config) {
    if (world == NULL || memory == NULL || scene == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if ((uintptr_t)memory % CR_IMG_ALIGN != 0u) {
        return CR_ERR_ALIGN;
    }
    size_t need = cr_world_size(scene, config);
    if (need == 0u) {
        return CR_ERR_CONFIG;
    }
    if (size_bytes < need) {
        return CR_ERR_SIZE;
    }
    uint8_t *at = memory;
    memset(at, 0, need);
    cr_world *w = memory;
    at += round_up(sizeof *w);
    w->motion.wake_m = (float *)(void *)at;
    w->motion.wake_count = scene->group_count * CR_LANES;
#ifdef CR_RIVALS
    at += round_up((size_t)w->motion.wake_count * sizeof(float));
    w->hit_of_cluster = (uint16_t *)(void *)at;
    for (uint32_t i = 0; i < scene->cluster_count; i++) {
        w->hit_of_cluster[i] = CR_HIT_NONE;
    }
#endif
    w->scene = *scene;
    w->config = *config;
    cr_field_init(&w->field, &w->scene);
    *world = w;
    return CR_OK;
}

static void drop_search(cr_world *w) { w->search.open = w->found = w->answering = 0u; }

static void forget_contact(cr_world *w) {
    drop_search(w);
    w->held_count = w->held_age = 0u;
}

cr_err cr_world_configure(cr_world *world, const cr_config *config) {
    if (world == NULL || config == NULL) {
        return CR_ERR_NULL;
    }
    if (cr_config_error(config) != NULL) {
        return CR_ERR_CONFIG;
    }
    world->config = *config;
    drop_search(world);
#ifdef CR_RIVALS
    world->proxy.held = 0u;
#endif
    return CR_OK;
}

const cr_contact_set *cr_world_contacts(const cr_world *world) { return &world->set; }

void cr_world_clear_fault(cr_world *world) {
    world->faults = 0u;
    world->has_previous = 0u;
    world->motion.valid = 0u;
    forget_contact(world);
#ifdef CR_RIVALS
    world->proxy.held = 0u;
#endif
}

/* Normalised copy of the pose, or a fault. */
static uint32_t check_pose(const cr_pose *in, cr_pose *out) {
    cr_quat q = in->rot;
    float n2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    float reach = max_f(max_f(abs_f(in->pos_m.x), abs_f(in->pos_m.y)), abs_f(in->pos_m.z));
    if (!v3_is_finite(in->pos_m) || !(abs_f(n2 - 1.0f) < 2.0f * QUATERNION_TOLERANCE) || !(reach <= POSITION_MAX_M)) {
        return CR_FAULT_POSE;
    }
    float s = 1.0f / sqrtf(n2);
    out->pos_m = in->pos_m;
    out->rot.w = q.w * s;
    out->rot.x = q.x * s;
    out->rot.y = q.y * s;
    out->rot.z = q.z * s;
    return 0u;
}

static void clear_output(cr_output *out) {
    static const cr_stats no_stats = {0};
    out->force_world_N = out->torque_world_Nm = out->normal_world = v3(0.0f, 0.0f, 0.0f);
    out->depth_m = 0.0f;
    out->area_count = out->zone_count = 0u;
    out->stats = no_stats;
}

/* Shorter periods are no clock's: velocities stay finite for any two poses that are allowed. */
#define PERIOD_MIN_S 1e-9f

/* Velocity of the tool's material point at p, from the last pose to this one. */
static cr_vec3 velocity_at(const cr_world *w, const xform *now, cr_vec3 p_world, float period_s) {
    if (!w->has_previous) {
        return v3(0.0f, 0.0f, 0.0f);
    }
    xform before = xform_from_pose(&w->previous);
    cr_vec3 p_tool = xform_unrotate(now, v3_sub(p_world, now->t));
    return v3_scale(v3_sub(p_world, xform_point(&before, p_tool)), 1.0f / max_f(period_s, PERIOD_MIN_S));
}

/* Spring and damper along the area normal; it pushes or does nothing. */
static void push(const cr_world *w, const xform *now, float period_s, cr_area *area) {
    float force = w->config.stiffness_N_m * area->depth_m;
    if (w->config.damping_Ns_m > 0.0f) {
        cr_vec3 v = velocity_at(w, now, area->point_world_m, period_s);
        force -= w->config.damping_Ns_m * v3_dot(v, area->normal_world);
    }
    area->force_world_N = v3_scale(area->normal_world, max_f(0.0f, force));
}

/* Do areas that push one way share what is deep there? Those of rivals/ each know it whole. */
static int areas_share(const cr_config *config) {
#ifdef CR_RIVALS
    return config->response == CR_RESPONSE_WAY_OUT;
#else
    (void)config;
    return 1;
#endif
}

/* How deep each area is along its normal: by what it pushes, and by what those on its side push along it. */
static void find_depths(const cr_config *config, const cr_output *out, float *depth_m) {
    for (uint32_t i = 0; i < out->area_count; i++) {
        depth_m[i] = 0.0f;
        for (uint32_t j = 0; j < out->area_count; j++) {
            const cr_area *a = &out->areas[j];
            const float along = max_f(0.0f, v3_dot(out->areas[i].normal_world, a->normal_world));
            depth_m[i] += i == j || areas_share(config) ? a->depth_m * along : 0.0f;
        }
    }
}

static void sum_wrench(const cr_config *config, cr_vec3 origin, const float *depth_m, cr_output *out) {
    for (uint32_t i = 0; i < out->area_count; i++) {
        const cr_area *a = &out->areas[i];
        cr_vec3 arm = v3_sub(a->point_world_m, origin);
        out->force_world_N = v3_add(out->force_world_N, a->force_world_N);
        out->torque_world_Nm = v3_add(out->torque_world_Nm, v3_cross(arm, a->force_world_N));
        out->zone_count += a->zone_count;
        if (depth_m[i] > out->depth_m) {
            out->depth_m = depth_m[i];
            out->normal_world = a->normal_world;
        }
    }
    float norm = v3_norm(out->force_world_N);
    if (norm > config->force_max_N) {
        float scale = config->force_max_N / norm;
        out->force_world_N = v3_scale(out->force_world_N, scale);
        out->torque_world_Nm = v3_scale(out->torque_world_Nm, scale);
        out->stats.force_limited = 1u;
    }
}

/* Smallest shift that satisfies every contact plane, by relaxation over the areas. */
static cr_vec3 display_shift(const cr_output *out, const float *depth_m) {
    cr_vec3 u = v3(0.0f, 0.0f, 0.0f);
    for (int sweep = 0; sweep < DISPLAY_SWEEPS; sweep++) {
        float worst = 0.0f;
        for (uint32_t i = 0; i < out->area_count; i++) {
            const cr_area *a = &out->areas[i];
            float lack = depth_m[i] - v3_dot(u, a->normal_world);
            if (lack > 0.0f) {
                u = v3_mad(u, a->normal_world, lack);
                worst = max_f(worst, lack);
            }
        }
        if (worst <= 1e-7f) {
            break;
        }
    }
    return u;
}

/* Not a number anywhere in the answer: nothing is felt, nothing is moved for the eye, and it stays so. */
static void fault_when_not_finite(cr_world *w, cr_vec3 pos_m, cr_output *out) {
    if (v3_is_finite(out->force_world_N) && v3_is_finite(out->torque_world_Nm) && is_finite_f(out->depth_m) &&
        v3_is_finite(out->display_pose.pos_m)) {
        return;
    }
    out->force_world_N = out->torque_world_Nm = out->normal_world = v3(0.0f, 0.0f, 0.0f);
    out->depth_m = 0.0f;
    out->display_pose.pos_m = pos_m;
    out->area_count = out->zone_count = 0u;
    w->faults |= CR_FAULT_NUMBER;
    out->faults = w->faults;
}

/* Areas, without force yet, of the contact that was found at a pose: the response of the settings. Returns 0 when the work of this tick was not enough;
 * then it goes on in the next one. */
static int respond(cr_world *w, const xform *at, cr_output *out) {
    cr_respond_input in = {.field = &w->field, .world_from_tool = at, .set = &w->set, .config = &w->config};
#ifdef CR_RIVALS
    if (w->config.response != CR_RESPONSE_WAY_OUT) {
        w->proxy.device_m = w->has_previous ? w->previous.pos_m : at->t;
        in.proxy = &w->proxy;
        out->area_count = cr_respond_as_rival(&in, w->hit_of_cluster, &w->areas, out->areas, CR_AREAS_MAX, &out->stats);
        return 1;
    }
#endif
    if (!w->answering) {
        cr_way_begin(&in, &w->way);
        w->answering = 1u;
    }
    w->way.spent += w->search.spent;
    const int whole = cr_way_measure(&in, &w->way, w->config.lookups_max);
    if (whole) {
        out->area_count = cr_way_answer(&in, &w->way, out->areas, CR_AREAS_MAX, &out->stats);
    }
    out->stats.work = w->way.spent;
    w->way.spent = 0u;
    return whole;
}

/* Answer the contact that was found, at the pose it was searched at; kept for ticks that come before the next answer. Returns whether it is answered. */
static int answer_found(cr_world *w, const xform *at, cr_output *out) {
    if (w->set.hit_count > 0u && !respond(w, at, out)) {
        return 0;
    }
    w->found = w->answering = 0u;
    w->held_count = out->area_count;
    w->held_at = w->motion.last;
    for (uint32_t i = 0; i < out->area_count; i++) {
        const cr_area *a = &out->areas[i];
        w->held[i] = (held_area){a->normal_world, a->point_world_m, a->depth_m, a->offset_m, a->area_m2};
    }
    out->stats.contacts = w->set.contacts;
    out->stats.clusters = w->set.hit_count;
    return 1;
}

static void answer_held(const cr_world *w, cr_output *out) {
    out->area_count = w->held_count;
    for (uint32_t i = 0; i < out->area_count; i++) {
        const held_area *h = &w->held[i];
        cr_area *a = &out->areas[i];
        a->normal_world = h->normal_world;
        a->point_world_m = h->point_world_m;
        a->depth_m = h->depth_m;
        a->offset_m = h->offset_m;
        a->area_m2 = h->area_m2;
        a->zone_count = 0u;
    }
}

/* Areas of an earlier pose as they are felt at this one: the plane stays where it is, the point moves with the tool. What has come out of its plane is
 * no area of this tick; the next one may be in it again. */
static void carry(const cr_pose *from, const xform *now, cr_output *out) {
    const xform then = xform_from_pose(from);
    uint32_t kept = 0u;
    for (uint32_t i = 0; i < out->area_count; i++) {
        cr_area *a = &out->areas[i];
        cr_vec3 p_tool = xform_unrotate(&then, v3_sub(a->point_world_m, then.t));
        cr_vec3 p = xform_point(now, p_tool);
        const float depth_m = a->depth_m - v3_dot(a->normal_world, v3_sub(p, a->point_world_m));
        if (depth_m <= 0.0f) {
            continue;
        }
        a->depth_m = depth_m; /* not a number too: a fault */
        a->point_world_m = p;
        if (kept != i) {
            out->areas[kept] = *a;
        }
        kept++;
    }
    out->area_count = kept;
}

static void drop_proxy_in_free_space(cr_world *w) {
#ifdef CR_RIVALS
    w->proxy.held = w->set.hit_count > 0u ? w->proxy.held : 0u;
#else
    (void)w;
#endif
}

/* Search on at the pose the search began with; w->found when it is at its end. */
static void search_on(cr_world *w, const xform *at, cr_stats *stats) {
    const cr_detect_options options = {
        .skip = w->config.skip,
        .coverage = w->config.coverage,
        .lookups_max = w->config.lookups_max,
#ifdef CR_RIVALS
        .touches = w->config.response != CR_RESPONSE_WAY_OUT,
#endif
    };
    w->found = (uint32_t)cr_detect(&w->field, at, &options, &w->motion, &w->search, &w->set, stats);
}

/* The areas that are felt at this pose: found now, or carried along from an earlier one. */
static void find_areas(cr_world *w, const cr_pose *pose, const xform *now, cr_output *out) {
    w->searched_age++;
    w->held_age++;
    if (!w->search.open && !w->found) {
        w->searched_age = 0u;
        cr_motion_advance(&w->motion, pose);
    }
    const xform *at = now;
    xform then;
    if (w->searched_age > 0u) {
        then = xform_from_pose(&w->motion.last);
        at = &then;
    }
    w->search.spent = 0u;
    if (!w->found) {
        search_on(w, at, &out->stats);
    }
    out->stats.work = w->search.spent;
    if (w->found && answer_found(w, at, out)) {
        drop_proxy_in_free_space(w);
        w->held_age = w->searched_age;
    } else {
        answer_held(w, out);
    }
    out->stats.late_ticks = w->held_age;
    if (w->held_age > 0u) {
        carry(&w->held_at, now, out);
    }
}

static void feel(cr_world *w, const xform *now, float period_s, cr_output *out) {
    float depth_m[CR_AREAS_MAX];
    for (uint32_t i = 0; i < out->area_count; i++) {
        push(w, now, period_s, &out->areas[i]);
    }
    find_depths(&w->config, out, depth_m);
    sum_wrench(&w->config, now->t, depth_m, out);
    cr_vec3 pos_m = out->display_pose.pos_m;
    out->display_pose.pos_m = v3_add(pos_m, display_shift(out, depth_m));
    fault_when_not_finite(w, pos_m, out);
}

void cr_tick(cr_world *w, const cr_pose *world_from_tool, float period_s, cr_output *out) {
    cr_pose pose;
    clear_output(out);
    w->faults |= check_pose(world_from_tool, &pose);
    w->faults |= period_s > 0.0f && period_s <= 1.0f ? 0u : (uint32_t)CR_FAULT_PERIOD;
    out->faults = w->faults;
    if (w->faults != 0u) {
        static const cr_pose origin = {{0.0f, 0.0f, 0.0f}, {1.0f, 0.0f, 0.0f, 0.0f}};
        out->display_pose = w->has_previous ? w->previous : origin;
        w->motion.valid = 0u;
        forget_contact(w);
        return;
    }
    xform now = xform_from_pose(&pose);
    out->display_pose = pose;
    find_areas(w, &pose, &now, out);
    if (out->area_count > 0u) {
        feel(w, &now, period_s, out);
    }
    w->previous = pose;
    w->has_previous = 1u;
}
