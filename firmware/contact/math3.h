/* Vectors, quaternions, poses. Value in, value out; float32; no libm but sqrtf. */
#ifndef CR_MATH3_H
#define CR_MATH3_H

#include "asserts.h"
#include "crease.h"

#include <math.h>
#include <string.h>

/* Not-a-number in, not-a-number out: a limit must not turn it into the limit. The second comparison is between numbers. */
static inline float min_f(float a, float b) { return a < b ? a : b <= a ? b : a + b; }
static inline float max_f(float a, float b) { return a > b ? a : b >= a ? b : a + b; }
/* In one comparison, for loops over lanes: what is no number comes out as b. For what is a number by its making, and for indices. */
static inline float lower_f(float a, float b) { return a < b ? a : b; }
static inline float higher_f(float a, float b) { return a > b ? a : b; }
/* low..high, low for what is no number: safe to index with. */
static inline float clamp_f(float v, float low, float high) { return lower_f(higher_f(v, low), high); }
static inline float abs_f(float a) { return fabsf(a); }
/* 1 below zero, as a bit; 1 for -0 too. */
static inline uint32_t sign_bit_f(float v) {
    uint32_t words[sizeof v / sizeof(uint32_t)]; /* one; two where the sources are built in double */
    memcpy(words, &v, sizeof v);
    return words[sizeof v / sizeof(uint32_t) - 1u] >> 31;
}
/* low <= v <= high; not for not-a-number. Not in line: many ask. */
int cr_in_range(float v, float low, float high);

/* False for infinities and not-a-number, without libm. */
static inline int is_finite_f(float a) { return a - a == 0.0f; }

/* For what is three instructions: also where a compiler is asked for small code, a call of it is more. */
#if defined(__GNUC__)
#define CR_IN_LINE static inline __attribute__((always_inline))
#else
#define CR_IN_LINE static inline
#endif

/* What loops over lanes call: with vectors it is made part of them, or they would be no vector code. */
#if CR_SCALAR
#define CR_IN_LANES static
#else
#define CR_IN_LANES CR_IN_LINE
#endif

/* And what is rare, in a function that must not save registers for it. */
#if defined(__GNUC__)
#define CR_OUT_OF_LINE static __attribute__((noinline))
#else
#define CR_OUT_OF_LINE static
#endif

/* Lowest set bit of a non-zero mask of lanes, taken out of the mask. */
CR_IN_LINE int take_lane(uint32_t *lanes) {
    CR_ASSERT(*lanes != 0u);
#if defined(__GNUC__)
    int lane = __builtin_ctz(*lanes);
#else
    int lane = 0;
    while (!((*lanes >> lane) & 1u)) {
        lane++;
    }
#endif
    *lanes &= *lanes - 1u;
    return lane;
}

static inline int has_lane(uint32_t lanes, int i) { return (int)((lanes >> i) & 1u); }

/* Loops over lanes leave out those not asked for where lanes cost one by one (CR_SCALAR): the next of them from i on, or CR_LANES. With vectors leaving out costs
 * more. */
static inline int lane_at(uint32_t lanes, int i) {
#if CR_SCALAR
    uint32_t rest = (lanes | 1u << CR_LANES) >> i;
    return i + take_lane(&rest);
#else
    (void)lanes;
    return i;
#endif
}

/* The first lanes of 16: those in use. */
static inline uint32_t first_lanes(uint32_t count) {
    CR_ASSERT(count <= CR_LANES);
    return (1u << count) - 1u;
}

/* How many are set. Not in line: many ask. */
uint32_t cr_count_lanes(uint32_t lanes);

static inline cr_vec3 v3(float x, float y, float z) {
    cr_vec3 r = {x, y, z};
    return r;
}
static inline cr_vec3 v3_from(const float a[3]) { return v3(a[0], a[1], a[2]); }
/* Of 16 bits: 32,767 is 1. */
static inline cr_vec3 v3_from_16(const int16_t a[3]) {
    const float one = 1.0f / 32767.0f;
    return v3((float)a[0] * one, (float)a[1] * one, (float)a[2] * one);
}
static inline cr_vec3 v3_add(cr_vec3 a, cr_vec3 b) { return v3(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline cr_vec3 v3_sub(cr_vec3 a, cr_vec3 b) { return v3(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline cr_vec3 v3_scale(cr_vec3 a, float s) { return v3(a.x * s, a.y * s, a.z * s); }
static inline cr_vec3 v3_mad(cr_vec3 a, cr_vec3 b, float s) { return v3(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s); }
static inline float v3_dot(cr_vec3 a, cr_vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline cr_vec3 v3_cross(cr_vec3 a, cr_vec3 b) {
    return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline float v3_norm(cr_vec3 a) { return sqrtf(v3_dot(a, a)); }
/* Unit vector, or zero when shorter than tiny. */
static inline cr_vec3 v3_unit(cr_vec3 a, float tiny) {
    float n = v3_norm(a);
    return n <= tiny ? v3(0.0f, 0.0f, 0.0f) : v3_scale(a, 1.0f / n); /* not a number stays none */
}
static inline int v3_is_finite(cr_vec3 a) { return is_finite_f(a.x) && is_finite_f(a.y) && is_finite_f(a.z); }
/* Of length 1 but for rounding, or zero: a direction that is not known. For CR_ASSERT: not-a-number passes, it is a fault of the answer. */
static inline int v3_is_unit(cr_vec3 a) { return !(abs_f(v3_dot(a, a) - 1.0f) > 1e-4f); }
static inline int v3_is_unit_or_zero(cr_vec3 a) { return v3_is_unit(a) || v3_dot(a, a) <= 0.0f; }

/* Rotation and translation, ready for use: world = r * tool + t. Rows of r. */
typedef struct {
    cr_vec3 r0, r1, r2, t;
} xform;

/* Not in line, as cr_xform_point. */
xform cr_xform_from_pose(const cr_pose *p);
static inline cr_vec3 xform_rotate(const xform *m, cr_vec3 v) {
    return v3(v3_dot(m->r0, v), v3_dot(m->r1, v), v3_dot(m->r2, v));
}
cr_vec3 cr_xform_point(const xform *m, cr_vec3 v);
/* Transposed rotation: world vector to tool frame. */
static inline cr_vec3 xform_unrotate(const xform *m, cr_vec3 v) {
    return v3_add(v3_add(v3_scale(m->r0, v.x), v3_scale(m->r1, v.y)), v3_scale(m->r2, v.z));
}

#endif
