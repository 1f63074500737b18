/* god_object: a point on the surface that follows the device. Zilles, Salisbury 1995.
 *
 * A point sees one plane at a time, the nearest; those seen on the way in one tick are kept, so that it rests in a corner of several.
 * Steps of half a voxel keep it from passing a thin wall before it has seen it. */
#include "rivals/rivals.h"

static void look(const cr_respond_input *in, cr_vec3 p, cr_rival_planes *planes) {
    const cr_lanes3 world = {{p.x}, {p.y}, {p.z}};
    cr_lookup at;
    cr_field_look_up_lanes(in->field, &world, 1u, &at);
    if (at.phi_m[0] < cr_rival_reach(in)) {
        cr_rival_add_plane(planes, v3(at.gx[0], at.gy[0], at.gz[0]), at.phi_m[0]);
    }
}

uint32_t cr_rival_god_object(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room) {
    const cr_vec3 device_m = in->world_from_tool->t;
    const float step_m = 0.5f * in->field->scene->meta->voxel_m;
    cr_rival_planes planes;
    planes.count = 0u;
    (void)areas;
    cr_rival_start(in);
    for (int step = 0; step < CR_RIVAL_STEPS; step++) {
        look(in, in->proxy->pos_m, &planes);
        if (!cr_rival_step(in->proxy, device_m, &planes, step_m)) {
            break;
        }
    }
    return room > 0u ? cr_rival_pull(in->proxy, device_m, out) : 0u;
}
