#include "probe.h"

#include "contact/stages.h"

void crp_look_up(const cr_scene *scene, const float *points_m, int64_t n, float *phi_m, float *gradient, uint32_t *kind,
                 uint32_t *facet) {
    cr_field field;
    cr_field_init(&field, scene);
    for (int64_t first = 0; first < n; first += CR_LANES) {
        int64_t count = n - first < CR_LANES ? n - first : CR_LANES;
        cr_lanes3 p;
        cr_lookup at;
        for (int64_t i = 0; i < CR_LANES; i++) {
            const float *q = points_m + 3 * (first + (i < count ? i : 0));
            p.x[i] = q[0];
            p.y[i] = q[1];
            p.z[i] = q[2];
        }
        cr_field_look_up(&field, &p, &at);
        for (int64_t i = 0; i < count; i++) {
            phi_m[first + i] = at.phi_m[i];
            gradient[3 * (first + i)] = at.gx[i];
            gradient[3 * (first + i) + 1] = at.gy[i];
            gradient[3 * (first + i) + 2] = at.gz[i];
            kind[first + i] = cr_field_kind(&field, &at, (int)i);
            facet[first + i] = (at.from_facet >> i) & 1u ? at.facet[i] : CR_FACET_NONE;
        }
    }
}

void crp_sum_cluster(const struct cr_img_cluster *cluster, struct cr_img_sum *sum) {
    float full[CR_LANES];
    for (int i = 0; i < CR_LANES; i++) {
        full[i] = 1.0f;
    }
    cr_sum_cluster(cluster, full, sum);
}

uint32_t crp_image_crc(const uint8_t *image, uint32_t size_bytes) { return cr_image_crc(image, size_bytes); }
