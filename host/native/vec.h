/* Three numbers in double precision. Not for Python: functions with bodies, which the binding does not read. */
#ifndef CR_VEC_H
#define CR_VEC_H

#include <math.h>

typedef struct {
    double x, y, z;
} vec;

static inline vec sub(vec a, vec b) { return (vec){a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline vec add(vec a, vec b) { return (vec){a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline vec mul(vec a, double s) { return (vec){a.x * s, a.y * s, a.z * s}; }
static inline double dot(vec a, vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline vec cross(vec a, vec b) {
    return (vec){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline double norm(vec a) { return sqrt(dot(a, a)); }

/* Length 1; zero stays zero. */
static inline vec unit(vec a) {
    const double n = norm(a);
    return n > 0.0 ? mul(a, 1.0 / n) : (vec){0.0, 0.0, 0.0};
}

static inline double axis_of(vec v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

/* A box from low to high, with p in it. */
static inline void grow(vec *low, vec *high, vec p) {
    low->x = fmin(low->x, p.x);
    low->y = fmin(low->y, p.y);
    low->z = fmin(low->z, p.z);
    high->x = fmax(high->x, p.x);
    high->y = fmax(high->y, p.y);
    high->z = fmax(high->z, p.z);
}

#endif
