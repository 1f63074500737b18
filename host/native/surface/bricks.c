/* Which bricks of a grid a surface comes near. */
#include "mesh.h"

/* Separating-axis test of a triangle (relative to the box centre) with a box of half side h. Source Akenine-Moeller 2001. */
static int axis_separates(const vec *c, vec axis, double h) {
    double a = dot(c[0], axis), b = dot(c[1], axis), d = dot(c[2], axis);
    double r = h * (fabs(axis.x) + fabs(axis.y) + fabs(axis.z));
    return fmin(fmin(a, b), d) > r || fmax(fmax(a, b), d) < -r;
}

static int triangle_meets_box(const vec *corners, vec centre, double h) {
    vec c[3] = {sub(corners[0], centre), sub(corners[1], centre), sub(corners[2], centre)};
    static const vec axes[3] = {{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}};
    for (int i = 0; i < 3; i++) {
        if (axis_separates(c, axes[i], h)) {
            return 0;
        }
    }
    vec e[3] = {sub(c[1], c[0]), sub(c[2], c[1]), sub(c[0], c[2])};
    if (axis_separates(c, cross(e[0], e[1]), h)) {
        return 0;
    }
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            if (axis_separates(c, cross(axes[i], e[j]), h)) {
                return 0;
            }
        }
    }
    return 1;
}

static int64_t cell_of(double x, double origin, double side, int32_t count) {
    double c = floor((x - origin) / side);
    return c < 0.0 ? 0 : c > (double)(count - 1) ? count - 1 : (int64_t)c;
}

void crb_mark_bricks(const crb_mesh *m, const double *origin_m, double brick_m, const int32_t *dims, double reach_m,
                     uint8_t *near) {
    double h = 0.5 * brick_m + reach_m;
    for (int64_t t = 0; t < m->triangle_count; t++) {
        const vec *c = m->corners + 3 * t;
        vec low = c[0], high = c[0];
        grow(&low, &high, c[1]);
        grow(&low, &high, c[2]);
        int64_t lo[3] = {0}, hi[3] = {0};
        for (int a = 0; a < 3; a++) {
            lo[a] = cell_of(axis_of(low, a) - reach_m, origin_m[a], brick_m, dims[a]);
            hi[a] = cell_of(axis_of(high, a) + reach_m, origin_m[a], brick_m, dims[a]);
        }
        for (int64_t z = lo[2]; z <= hi[2]; z++) {
            for (int64_t y = lo[1]; y <= hi[1]; y++) {
                for (int64_t x = lo[0]; x <= hi[0]; x++) {
                    uint8_t *flag = &near[(z * dims[1] + y) * dims[0] + x];
                    vec centre = {origin_m[0] + ((double)x + 0.5) * brick_m, origin_m[1] + ((double)y + 0.5) * brick_m,
                                  origin_m[2] + ((double)z + 0.5) * brick_m};
                    if (!*flag && triangle_meets_box(c, centre, h)) {
                        *flag = 1;
                    }
                }
            }
        }
    }
}
