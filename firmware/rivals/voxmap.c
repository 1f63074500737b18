/* voxmap: tangent-plane forces of a point shell in a voxel map. McNeely, Puterbaugh, Troy 1999. */
#include "rivals/rivals.h"

/* Each point has a tenth of the stiffness; more than this many are scaled down to as many. */
#define POINTS_FULL 10.0f

/* Centre of the voxel along one axis. */
static float centre_of(float x, float origin, float voxel) {
    float cells = (x - origin) / voxel;
    int32_t cell = (int32_t)cells;
    cell -= cells < (float)cell ? 1 : 0;
    return origin + ((float)cell + 0.5f) * voxel;
}

/* Centre of the surface voxel that holds the point, or for a deeper point the one on its way out. */
static cr_vec3 surface_voxel(const struct cr_img_meta *m, cr_vec3 p, cr_vec3 gradient, float phi_m) {
    cr_vec3 q = -phi_m < m->voxel_m ? p : v3_mad(p, gradient, -phi_m);
    return v3(centre_of(q.x, m->origin_m[0], m->voxel_m), centre_of(q.y, m->origin_m[1], m->voxel_m),
              centre_of(q.z, m->origin_m[2], m->voxel_m));
}

static float add_hit(const cr_respond_input *in, const cr_hit *hit, cr_rival_sum *sum) {
    cr_rival_samples s;
    float points = 0.0f;
    cr_rival_look(in, hit, &s);
    while (s.inside != 0u) {
        int i = take_lane(&s.inside);
        cr_vec3 p = cr_rival_place(&s, i), n = cr_rival_inward(in, &s, i);
        cr_vec3 g = v3(s.at.gx[i], s.at.gy[i], s.at.gz[i]);
        cr_vec3 centre = surface_voxel(in->field->scene->meta, p, g, s.at.phi_m[i]);
        float below = v3_dot(v3_sub(centre, p), n), count = cr_rival_count(in, &s, i);
        /* A point before its plane has no force, but counts: the mean is over all points in surface voxels. */
        points += count;
        if (below > 0.0f) {
            cr_rival_add(sum, v3_scale(n, below * count / POINTS_FULL), p);
        }
    }
    return points;
}

uint32_t cr_rival_voxmap(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    cr_rival_sum sums[CR_AREAS_MAX];
    float points = 0.0f;
    cr_rival_clear(sums, areas->count);
    for (uint32_t h = 0; h < in->set->hit_count; h++) {
        const cr_hit *hit = &in->set->hits[h];
        points += add_hit(in, hit, &sums[hit->area]);
    }
    float part = min_f(1.0f, POINTS_FULL / max_f(points, 1e-9f));
    for (uint32_t a = 0; a < areas->count; a++) {
        sums[a].push_m = v3_scale(sums[a].push_m, part);
    }
    return cr_rival_answers(sums, areas, out, room);
}
