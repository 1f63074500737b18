/* The motion of least energy, by Newton's method: DESIGN.md "The descent". */
#include "couple/couple_parts.h"

/* Where the energy to be had is less than that of so short a pull, squared, it is down: above it stand 1e-4 N at 2,000 N/m. m. */
#define STILL_M 5e-8f
/* A slope beyond is none, m^2. */
#define SLOPE_MOST 1e30f
/* Nor is more looked for where it is so small a part of the motion since the round began. */
#define FINE 1e-3f
/* Iterations while the limits of friction stand, and how often they are set anew. */
#define ITERATIONS_A_HOLD 7u
#define HOLDS_MAX 3u
/* A slip shorter than this, squared, has no direction, m2. */
#define SLIP2_MIN_M2 1e-24f
/* Trials of one search along a way, and how much of the slope at its start may be left at its end. */
/* What is told of it at most: arms of kilometres are more than a square of single precision holds. */
#define LEFT_MAX_M 1e5f
#define TRIALS_MAX 16
#define SLOPE_LEFT 0.25f

#define UNKNOWNS 6
/* Lower triangle, row by row. */
typedef struct {
    float at[UNKNOWNS * (UNKNOWNS + 1) / 2];
} triangle;

/* What a point does at a motion. */
typedef struct {
    cr_vec3 push_m, slip_m; /* force on the tool over the coupling's stiffness; slip with the motion */
    float normal_stiff;     /* stiffness along the normal, */
    float slip_stiff;       /* in the plane, */
    float slide_less;       /* and how much less along the slip, over its length squared */
} point_answer;

static void answer_point(const cr_couple_point *p, cr_vec3 moved, point_answer *a) {
    const float rise = v3_dot(p->normal, moved), gap = p->gap_m + rise;
    a->normal_stiff = gap < 0.0f ? CR_COUPLE_HARD : 0.0f;
    a->push_m = v3_scale(p->normal, -a->normal_stiff * gap);
    a->slip_stiff = a->slide_less = 0.0f;
    if (p->hold_m > 0.0f) {
        a->slip_m = v3_add(p->slip_m, v3_mad(moved, p->normal, -rise));
        const float slip2 = v3_dot(a->slip_m, a->slip_m), slip = sqrtf(slip2);
        const int slides = CR_COUPLE_GRIP * slip > p->hold_m && slip2 > SLIP2_MIN_M2;
        a->slip_stiff = slides ? p->hold_m / slip : CR_COUPLE_GRIP;
        a->slide_less = slides ? a->slip_stiff / slip2 : 0.0f;
        a->push_m = v3_mad(a->push_m, a->slip_m, -a->slip_stiff);
    }
}

/* Gradient of the energy of the coupling: the points' forces are taken off it. */
static cr_motion6 pull_of(const cr_couple_task *task, const cr_motion6 *motion) {
    cr_motion6 g;
    g.along = v3_sub(motion->along, task->goal.along);
    g.turn = v3_sub(v3_scale(motion->turn, task->weight), task->goal.turn);
    return g;
}

static void add_square(triangle *h, float stiff, cr_vec3 along, cr_vec3 turn) {
    const float v[UNKNOWNS] = {along.x, along.y, along.z, turn.x, turn.y, turn.z};
    float *at = h->at;
    for (int r = 0; r < UNKNOWNS; r++) {
        const float s = stiff * v[r];
        for (int c = 0; c <= r; c++) {
            *at += s * v[c];
            at++;
        }
    }
}

/* The same stiffness whichever way the point goes. */
static void add_all_ways(triangle *h, float stiff, cr_vec3 a) {
    const float far = v3_dot(a, a);
    h->at[0] += stiff;
    h->at[2] += stiff;
    h->at[5] += stiff;
    h->at[7] -= stiff * a.z;
    h->at[8] += stiff * a.y;
    h->at[10] += stiff * a.z;
    h->at[12] -= stiff * a.x;
    h->at[15] -= stiff * a.y;
    h->at[16] += stiff * a.x;
    h->at[9] += stiff * (far - a.x * a.x);
    h->at[13] -= stiff * a.x * a.y;
    h->at[14] += stiff * (far - a.y * a.y);
    h->at[18] -= stiff * a.x * a.z;
    h->at[19] -= stiff * a.y * a.z;
    h->at[20] += stiff * (far - a.z * a.z);
}

static void add_point(const cr_couple_point *p, const point_answer *a, triangle *h) {
    add_square(h, a->normal_stiff - a->slip_stiff, p->normal, v3_cross(p->arm, p->normal));
    if (a->slip_stiff > 0.0f) {
        add_all_ways(h, a->slip_stiff, p->arm);
    }
    if (a->slide_less > 0.0f) {
        add_square(h, -a->slide_less, a->slip_m, v3_cross(p->arm, a->slip_m));
    }
}

/* Gradient and stiffness at a motion. */
static cr_motion6 look_around(const cr_couple_task *task, const cr_couple_point *points, const cr_motion6 *motion,
                              triangle *h) {
    static const triangle none = {{0.0f}};
    *h = none;
    h->at[0] = h->at[2] = h->at[5] = 1.0f;
    h->at[9] = h->at[14] = h->at[20] = task->weight;
    cr_motion6 g = pull_of(task, motion);
    for (uint32_t i = 0; i < task->count; i++) {
        const cr_couple_point *p = &points[i];
        point_answer a;
        answer_point(p, point_motion(p, motion), &a);
        if (a.normal_stiff > 0.0f || a.slip_stiff > 0.0f) {
            g.along = v3_sub(g.along, a.push_m);
            g.turn = v3_sub(g.turn, v3_cross(p->arm, a.push_m));
            add_point(p, &a, h);
        }
    }
    return g;
}

/* In place. The energy of the coupling alone has pivots of 1: what rounding leaves below is 1. */
static void factorise(triangle *h) {
    float *row = h->at;
    for (int r = 0; r < UNKNOWNS; r++) {
        const float *other = h->at;
        for (int c = 0; c < r; c++) {
            float v = row[c];
            for (int k = 0; k < c; k++) {
                v -= row[k] * other[k];
            }
            row[c] = v / other[c];
            other += c + 1;
        }
        float pivot = row[r];
        for (int k = 0; k < r; k++) {
            pivot -= row[k] * row[k];
        }
        row[r] = pivot > 1.0f ? sqrtf(pivot) : 1.0f;
        row += r + 1;
    }
}

/* The motion that would bring the gradient to zero, were the stiffness the same all the way. */
static cr_motion6 newton_motion(triangle *h, const cr_motion6 *g) {
    float v[UNKNOWNS] = {-g->along.x, -g->along.y, -g->along.z, -g->turn.x, -g->turn.y, -g->turn.z};
    factorise(h);
    const float *row = h->at;
    for (int r = 0; r < UNKNOWNS; r++) {
        for (int k = 0; k < r; k++) {
            v[r] -= row[k] * v[k];
        }
        v[r] /= row[r];
        row += r + 1;
    }
    for (int r = UNKNOWNS - 1; r >= 0; r--) {
        row -= r + 1;
        v[r] /= row[r];
        for (int k = 0; k < r; k++) {
            v[k] -= row[k] * v[r];
        }
    }
    const cr_motion6 d = {v3(v[0], v[1], v[2]), v3(v[3], v[4], v[5])};
    return d;
}

static cr_motion6 motion_at(const cr_motion6 *from, const cr_motion6 *way, float t) {
    const cr_motion6 m = {v3_mad(from->along, way->along, t), v3_mad(from->turn, way->turn, t)};
    return m;
}

/* Slope of the energy along a way, at t of it, and how fast it rises there: at least as fast as the coupling's own. */
static float slope_at(const cr_couple_task *task, const cr_couple_point *points, const cr_motion6 *from,
                      const cr_motion6 *way, float t, float *rise) {
    const cr_motion6 m = motion_at(from, way, t);
    const cr_motion6 g = pull_of(task, &m);
    float slope = motion_dot(&g, way);
    *rise = v3_dot(way->along, way->along) + task->weight * v3_dot(way->turn, way->turn);
    for (uint32_t i = 0; i < task->count; i++) {
        const cr_vec3 moved = point_motion(&points[i], way);
        const float out = v3_dot(points[i].normal, moved);
        point_answer a;
        answer_point(&points[i], point_motion(&points[i], &m), &a);
        slope -= v3_dot(a.push_m, moved);
        *rise += a.normal_stiff * out * out;
        if (a.slip_stiff > 0.0f) {
            const float slipped = v3_dot(a.slip_m, moved);
            *rise += a.slip_stiff * (v3_dot(moved, moved) - out * out) - a.slide_less * slipped * slipped;
        }
    }
    return slope;
}

/* How far along a way: all of it, or, where the energy rises again before its end, near its least. The slope only rises along the way: Newton's method
 * between two ends, or the middle of them where it leads out. */
static float find_share(const cr_couple_task *task, const cr_couple_point *points, const cr_motion6 *from,
                        const cr_motion6 *way, float slope) {
    const float enough = -SLOPE_LEFT * slope;
    float low = 0.0f, high = 1.0f, t = 1.0f, rise;
    float s = slope_at(task, points, from, way, t, &rise);
    if (s <= enough) {
        return t;
    }
    for (int i = 0; i < TRIALS_MAX && abs_f(s) > enough; i++) {
        low = s < 0.0f ? t : low;
        high = s < 0.0f ? high : t;
        t -= s / rise;
        t = t > low && t < high ? t : 0.5f * (low + high);
        s = slope_at(task, points, from, way, t, &rise);
    }
    return t;
}

/* Friction may carry so much of what presses at this motion. */
static void set_holds(const cr_couple_task *task, cr_couple_point *points, const cr_motion6 *motion) {
    for (uint32_t i = 0; i < task->count; i++) {
        cr_couple_point *p = &points[i];
        const float gap = p->gap_m + v3_dot(p->normal, point_motion(p, motion));
        p->hold_m = gap < 0.0f ? -task->friction * CR_COUPLE_HARD * gap : 0.0f;
    }
}

/* One step down.   Output  how far it went, m; 0: it is down. */
static float step_down(const cr_couple_task *task, const cr_couple_point *points, cr_motion6 *motion) {
    triangle h;
    const cr_motion6 g = look_around(task, points, motion, &h);
    const cr_motion6 way = newton_motion(&h, &g);
    const float slope = motion_dot(&g, &way);
    /* Nor where the way is beyond all numbers: of pivots that rounding has lost. */
    if (!(-slope > STILL_M * STILL_M && -slope < SLOPE_MOST)) {
        return 0.0f;
    }
    const float t = find_share(task, points, motion, &way, slope);
    *motion = motion_at(motion, &way, t);
    return -slope > FINE * FINE * motion_dot(motion, motion) ? t * sqrtf(motion_dot(&way, &way)) : 0.0f;
}

uint32_t cr_couple_descend(const cr_couple_task *task, cr_couple_point *points, uint32_t most, cr_motion6 *motion,
                           float *left_m) {
    const int rough = task->friction > 0.0f;
    const uint32_t holds = rough ? HOLDS_MAX : 1u, each = rough ? ITERATIONS_A_HOLD : most;
    uint32_t made = 0u;
    int down = 0;
    for (uint32_t i = 0; i < holds && made < most && !down; i++) {
        const uint32_t before = made;
        set_holds(task, points, motion);
        *left_m = 1.0f;
        while (*left_m > 0.0f && made < most && made - before < each) {
            *left_m = min_f(step_down(task, points, motion), LEFT_MAX_M);
            made++;
        }
        down = made - before == 1u; /* what friction may carry did not change what is least */
    }
    set_holds(task, points, motion);
    return made;
}
