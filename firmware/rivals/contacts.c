/* contacts: what the penalty responses share: samples inside, and sums of pushes. */
#include "rivals/rivals.h"

/* A push over stiffness below this is rounding. */
#define PUSH_MIN_M 1e-9f

void cr_rival_look(const cr_respond_input *in, const cr_hit *hit, cr_rival_samples *s) {
    s->cluster = &in->field->scene->clusters[hit->cluster];
    cr_lanes_to_world(in->world_from_tool, s->cluster->x, s->cluster->y, s->cluster->z, &s->world_m);
    cr_field_look_up(in->field, &s->world_m, &s->at);
    s->inside = 0u;
    for (uint32_t i = 0; i < s->cluster->count; i++) {
        s->inside |= (uint32_t)(s->at.phi_m[i] < 0.0f) << i;
    }
    s->inside &= hit->inside; /* the rest of the cluster may be another contact */
}

float cr_rival_count(const cr_respond_input *in, const cr_rival_samples *s, int lane) {
    float spacing = in->field->scene->meta->spacing_m;
    return s->cluster->area[lane] / (spacing * spacing);
}

cr_vec3 cr_rival_inward(const cr_respond_input *in, const cr_rival_samples *s, int lane) {
    const struct cr_img_cluster *c = s->cluster;
    cr_vec3 out = v3_unit(v3(c->ax[lane], c->ay[lane], c->az[lane]), 0.0f);
    return xform_rotate(in->world_from_tool, v3_scale(out, -1.0f));
}

cr_vec3 cr_rival_place(const cr_rival_samples *s, int lane) {
    return v3(s->world_m.x[lane], s->world_m.y[lane], s->world_m.z[lane]);
}

void cr_rival_add(cr_rival_sum *sum, cr_vec3 push_m, cr_vec3 place_m) {
    float size = v3_norm(push_m);
    sum->push_m = v3_add(sum->push_m, push_m);
    sum->moment_m2 = v3_mad(sum->moment_m2, place_m, size);
    sum->total_m += size;
}

uint32_t cr_rival_finish(const cr_rival_sum *sum, float area_m2, cr_area *out) {
    float size = v3_norm(sum->push_m);
    if (!(size > PUSH_MIN_M) || !(sum->total_m > PUSH_MIN_M)) {
        return 0u;
    }
    out->normal_world = v3_scale(sum->push_m, 1.0f / size);
    out->point_world_m = v3_scale(sum->moment_m2, 1.0f / sum->total_m);
    out->force_world_N = v3(0.0f, 0.0f, 0.0f);
    out->depth_m = size;
    out->offset_m = v3_dot(out->normal_world, out->point_world_m) + size;
    out->area_m2 = area_m2;
    out->zone_count = 0u;
    return 1u;
}

void cr_rival_clear(cr_rival_sum *sums, uint32_t count) {
    static const cr_rival_sum empty = {0};
    for (uint32_t a = 0; a < count; a++) {
        sums[a] = empty;
    }
}

uint32_t cr_rival_answers(const cr_rival_sum *sums, const cr_area_set *areas, cr_area *out, uint32_t room) {
    uint32_t made = 0u;
    for (uint32_t a = 0; a < areas->count && made < room; a++) {
        made += cr_rival_finish(&sums[a], areas->areas[a].sum.area, &out[made]);
    }
    return made;
}
