/* table: which function answers for which response. */
#include "rivals/extent.h"
#include "rivals/rivals.h"

typedef uint32_t (*answer_fn)(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

static const answer_fn answers[CR_RESPONSE_COUNT] = {
    [CR_RESPONSE_VOXMAP] = cr_rival_voxmap,
    [CR_RESPONSE_DISTANCE_FIELD] = cr_rival_distance_field,
    [CR_RESPONSE_DEEPEST_GROUP] = cr_rival_deepest_group,
    [CR_RESPONSE_OVERLAP] = cr_rival_overlap,
    [CR_RESPONSE_NORMAL_GROUPS] = cr_rival_normal_groups,
    [CR_RESPONSE_GOD_OBJECT] = cr_rival_god_object,
    [CR_RESPONSE_SPHERE_PROXY] = cr_rival_sphere_proxy,
};

uint32_t cr_respond_as_rival(const cr_respond_input *in, uint16_t *hit_of_cluster, cr_area_set *areas, cr_area *out,
                             uint32_t room, cr_stats *stats) {
    const answer_fn answer = answers[in->config->response];
    cr_zones(in->field->scene, hit_of_cluster, in->set, areas, stats);
    return answer == NULL ? cr_respond(in, areas, out, room, stats) : answer(in, areas, out, room);
}
