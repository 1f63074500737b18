/* Solids for hand-made images, with their exact distances: see image_builder.h. */
#include "image_builder.h"

#include <math.h>
#include <string.h>

crt_solid crt_box(double x_low, double x_high, double half_y, double z_low, double z_high) {
    crt_solid s = {{{x_low, z_low}, {x_high, z_low}, {x_high, z_high}, {x_low, z_high}}, 4, half_y, 0, 0.0, 0};
    return s;
}

crt_solid crt_room(double x_low, double x_high, double half_y, double z_low, double z_high) {
    crt_solid s = crt_box(x_low, x_high, half_y, z_low, z_high);
    s.hollow = 1;
    return s;
}

crt_solid crt_wedge(double angle_rad, double height, double half_y) {
    double x = height * tan(0.5 * angle_rad);
    crt_solid s = {{{-x, -height}, {x, -height}, {0.0, 0.0}}, 3, half_y, 0, 0.0, 0};
    return s;
}

crt_solid crt_ball(double radius) {
    crt_solid s = {{{0.0}}, 0, 0.0, 0, radius, 0};
    return s;
}

int crt_facets(const crt_solid *s) { return s->ball_m > 0.0 ? 1 : s->sides + 2; }

/* Nearest point of the polygon's boundary; the distance to it, negative inside. */
static double polygon_distance(const crt_solid *s, double x, double z, double nearest[2]) {
    double best = INFINITY;
    int inside = 1;
    for (int i = 0; i < s->sides; i++) {
        const double *a = s->corner_m[i], *b = s->corner_m[(i + 1) % s->sides];
        double ex = b[0] - a[0], ez = b[1] - a[1], px = x - a[0], pz = z - a[1];
        double t = fmax(0.0, fmin(1.0, (px * ex + pz * ez) / (ex * ex + ez * ez)));
        double d = hypot(px - t * ex, pz - t * ez);
        if (d < best) {
            best = d;
            nearest[0] = a[0] + t * ex;
            nearest[1] = a[1] + t * ez;
        }
        inside = inside && ex * pz - ez * px > 0.0;
    }
    return inside ? -best : best;
}

/* Signed distance to the prism and its nearest surface point. */
double crt_nearest(const crt_solid *s, const double p[3], double q[3]) {
    double on[2] = {0.0, 0.0}, across = polygon_distance(s, p[0], p[2], on), along = fabs(p[1]) - s->half_y_m;
    int use_across = across > 0.0 || across >= along, use_along = along > 0.0 || !use_across;
    q[0] = use_across ? on[0] : p[0];
    q[1] = use_along ? copysign(s->half_y_m, p[1]) : p[1];
    q[2] = use_across ? on[1] : p[2];
    if (across > 0.0 && along > 0.0) {
        return hypot(across, along);
    }
    if (across <= 0.0 && along > 0.0) {
        q[0] = p[0];
        q[2] = p[2];
    }
    return fmax(across, along);
}

double crt_distance(const crt_solid *s, const double p[3]) {
    if (s->ball_m > 0.0) {
        return sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - s->ball_m;
    }
    double q[3], d = crt_nearest(s, p, q);
    return s->hollow ? -d : d;
}

void crt_plane(const crt_solid *s, int facet, double plane[4]) {
    double sign = s->hollow ? -1.0 : 1.0;
    memset(plane, 0, 4 * sizeof *plane);
    if (s->ball_m > 0.0) {
        plane[2] = 1.0;
    } else if (facet < s->sides) {
        const double *a = s->corner_m[facet], *b = s->corner_m[(facet + 1) % s->sides];
        double ex = b[0] - a[0], ez = b[1] - a[1], length = hypot(ex, ez);
        plane[0] = sign * ez / length;
        plane[2] = -sign * ex / length;
        plane[3] = plane[0] * a[0] + plane[2] * a[1];
    } else {
        plane[1] = facet == s->sides ? -sign : sign;
        plane[3] = sign * s->half_y_m;
    }
}

void crt_bounds(const crt_solid *s, double low[3], double high[3]) {
    for (int a = 0; a < 3; a++) {
        low[a] = -s->ball_m;
        high[a] = s->ball_m;
    }
    if (s->ball_m > 0.0) {
        return;
    }
    low[1] = -s->half_y_m;
    high[1] = s->half_y_m;
    low[0] = low[2] = INFINITY;
    high[0] = high[2] = -INFINITY;
    for (int i = 0; i < s->sides; i++) {
        low[0] = fmin(low[0], s->corner_m[i][0]);
        high[0] = fmax(high[0], s->corner_m[i][0]);
        low[2] = fmin(low[2], s->corner_m[i][1]);
        high[2] = fmax(high[2], s->corner_m[i][1]);
    }
}
