#include "exact.h"

#include <math.h>

/* An expansion is a sum of doubles that do not overlap, smallest first: an exact number. */

/* Terms of a product of three differences of two terms each, and of the sum of three such products. */
#define TERMS_PRODUCT 64
#define TERMS_SUM (3 * TERMS_PRODUCT)

static const double EPSILON = 1.1102230246251565e-16; /* 2^-53 */

/* sum + *error = a + b exactly (Knuth). */
static double two_sum(double a, double b, double *error) {
    const double sum = a + b;
    const double of_b = sum - a;
    *error = (a - (sum - of_b)) + (b - of_b);
    return sum;
}

/* product + *error = a b exactly. */
static double two_product(double a, double b, double *error) {
    const double product = a * b;
    *error = fma(a, b, -product);
    return product;
}

/* e + x in place, without zeros; e has n terms and room for one more. */
static int add_term(double *e, int n, double x) {
    int kept = 0;
    double carry = x;
    for (int i = 0; i < n; i++) {
        double error;
        carry = two_sum(carry, e[i], &error);
        if (error != 0.0) {
            e[kept++] = error;
        }
    }
    if (carry != 0.0) {
        e[kept++] = carry;
    }
    return kept;
}

/* into += x y, for expansions x and y. */
static int add_product(double *into, int n, const double *x, int nx, const double *y, int ny) {
    for (int i = 0; i < nx; i++) {
        for (int j = 0; j < ny; j++) {
            double error;
            const double product = two_product(x[i], y[j], &error);
            n = add_term(into, n, error);
            n = add_term(into, n, product);
        }
    }
    return n;
}

/* a - b as at most two terms. */
static int difference(double a, double b, double *out) {
    double error;
    const double high = two_sum(a, -b, &error);
    int n = 0;
    if (error != 0.0) {
        out[n++] = error;
    }
    if (high != 0.0) {
        out[n++] = high;
    }
    return n;
}

typedef struct {
    double term[3][2];
    int count[3];
} exact_vector;

static exact_vector exact_difference(const double *p, const double *q) {
    exact_vector v = {{{0.0, 0.0}, {0.0, 0.0}, {0.0, 0.0}}, {0, 0, 0}};
    for (int k = 0; k < 3; k++) {
        v.count[k] = difference(p[k], q[k], v.term[k]);
    }
    return v;
}

static int exact_sign(const double *a, const double *b, const double *c, const double *d) {
    const exact_vector u = exact_difference(b, a), v = exact_difference(c, a), w = exact_difference(d, a);
    double total[TERMS_SUM + 1];
    int n = 0;
    for (int k = 0; k < 3; k++) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        double minor[TERMS_PRODUCT + 1], turned[2];
        int m = add_product(minor, 0, v.term[i], v.count[i], w.term[j], w.count[j]);
        for (int t = 0; t < v.count[j]; t++) {
            turned[t] = -v.term[j][t];
        }
        m = add_product(minor, m, turned, v.count[j], w.term[i], w.count[i]);
        n = add_product(total, n, u.term[k], u.count[k], minor, m);
    }
    return n == 0 ? 0 : total[n - 1] > 0.0 ? 1 : -1;
}

int cr_exact_side(const double *a, const double *b, const double *c, const double *d) {
    const double ux = b[0] - a[0], uy = b[1] - a[1], uz = b[2] - a[2];
    const double vx = c[0] - a[0], vy = c[1] - a[1], vz = c[2] - a[2];
    const double wx = d[0] - a[0], wy = d[1] - a[1], wz = d[2] - a[2];
    const double vywz = vy * wz, vzwy = vz * wy, vzwx = vz * wx, vxwz = vx * wz, vxwy = vx * wy, vywx = vy * wx;
    const double value = ux * (vywz - vzwy) + uy * (vzwx - vxwz) + uz * (vxwy - vywx);
    const double size = fabs(ux) * (fabs(vywz) + fabs(vzwy)) + fabs(uy) * (fabs(vzwx) + fabs(vxwz)) +
                        fabs(uz) * (fabs(vxwy) + fabs(vywx));
    const double doubt = (7.0 + 56.0 * EPSILON) * EPSILON * size;
    if (value > doubt || value < -doubt) {
        return value > 0.0 ? 1 : -1;
    }
    return exact_sign(a, b, c, d);
}

int cr_exact_turn(const double *a, const double *b, const double *c) {
    const double left = (b[0] - a[0]) * (c[1] - a[1]), right = (b[1] - a[1]) * (c[0] - a[0]);
    const double value = left - right, doubt = (3.0 + 16.0 * EPSILON) * EPSILON * (fabs(left) + fabs(right));
    if (value > doubt || value < -doubt) {
        return value > 0.0 ? 1 : -1;
    }
    double u[2][2], v[2][2], total[TERMS_PRODUCT + 1];
    int nu[2], nv[2];
    for (int k = 0; k < 2; k++) {
        nu[k] = difference(b[k], a[k], u[k]);
        nv[k] = difference(c[k], a[k], v[k]);
    }
    int n = add_product(total, 0, u[0], nu[0], v[1], nv[1]);
    for (int t = 0; t < nu[1]; t++) {
        u[1][t] = -u[1][t];
    }
    n = add_product(total, n, u[1], nu[1], v[0], nv[0]);
    return n == 0 ? 0 : total[n - 1] > 0.0 ? 1 : -1;
}
