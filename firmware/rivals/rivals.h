/* Rival responses: what other authors' methods answer to the same contact, for comparison only. Not part of the device library:
 * compiled with CR_RIVALS into an extension of their own, on the host. README.md has the table of what was implemented and what was left out.
 *
 * Each response gets the contact that detect and zones found and looks up distances at the shell's samples. All of them
 *   Units    m; a force divided by the stiffness is a length, so an area's depth is |force| / stiffness.
 *   Output   out[0..return), return <= room; every number finite, normals unit, depths > 0; nothing when no sample is inside.
 *   Errors   none.   Cost  O(samples of the clusters in contact) unless said otherwise. */
#ifndef CR_RIVALS_H
#define CR_RIVALS_H

#include "contact/stages.h"

/* Purpose  voxmap and point shell: every point in a surface voxel is pushed along its own inward normal as far as it lies below
 *          the tangent plane through the voxel's centre; beyond ten points the mean of ten.
 * Source   McNeely, Puterbaugh, Troy 1999. */
uint32_t cr_rival_voxmap(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* Purpose  points against a distance field: every point is pushed along its own inward normal by its depth in the field; plain
 *          sum, so that the stiffness grows with the surface in contact.
 * Source   Barbic, James 2008. */
uint32_t cr_rival_distance_field(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* Purpose  one force for each group of neighbouring contacts: direction the depth-weighted mean of the surface normals, depth
 *          and point those of the deepest contact.
 * Source   Kim, Otaduy, Lin, Manocha 2003. */
uint32_t cr_rival_deepest_group(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* Purpose  springs spread over the contact section, integrated over the overlap: mean depth, acting at the centre of pressure.
 * Source   Hasegawa, Sato 2004. */
uint32_t cr_rival_overlap(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* Purpose  distance-field penalty with the stiffness of each point divided by how many points push the same way, so that every
 *          direction feels the set stiffness once.
 * Source   Xu, Barbic 2017. */
uint32_t cr_rival_normal_groups(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* Purpose  god-object: the point of the tool origin follows the device but stays on the surface; a spring pulls them together.
 * Cost     at most 16 lookups.   Source  Zilles, Salisbury 1995. */
uint32_t cr_rival_god_object(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* Purpose  virtual proxy of finite size: a copy of a round tool follows the device without turning of its own and stays outside.
 * Cost     at most 16 sweeps over the clusters near the proxy.   Source  Ruspini, Kolarov, Khatib 1997. */
uint32_t cr_rival_sphere_proxy(const cr_respond_input *in, const cr_area_set *areas, cr_area *out, uint32_t room);

/* ---- shared by the penalty responses (contacts.c) ------------------------------------------------------------------ */

/* The samples of one cluster, those inside marked. */
typedef struct {
    const struct cr_img_cluster *cluster;
    uint32_t inside;
    cr_lanes3 world_m;
    cr_lookup at;
} cr_rival_samples;

/* Purpose  world positions and distances of the samples of a cluster in contact. */
void cr_rival_look(const cr_respond_input *in, const cr_hit *hit, cr_rival_samples *samples);
/* Purpose  how many samples of the nominal spacing this one stands for: its area over the spacing squared. */
float cr_rival_count(const cr_respond_input *in, const cr_rival_samples *samples, int lane);
/* Purpose  the sample's normal into the tool, world frame; zero when it has none. */
cr_vec3 cr_rival_inward(const cr_respond_input *in, const cr_rival_samples *samples, int lane);
/* Purpose  place of a sample, world frame. */
cr_vec3 cr_rival_place(const cr_rival_samples *samples, int lane);

/* A sum of forces over stiffness, with their centre of pressure. */
typedef struct {
    cr_vec3 push_m;
    cr_vec3 moment_m2; /* sum of |push| times place */
    float total_m;     /* sum of |push| */
} cr_rival_sum;

void cr_rival_add(cr_rival_sum *sum, cr_vec3 push_m, cr_vec3 place_m);
/* Purpose  the sum as one contact area.   Output  1, or 0 when it pushes nowhere. */
uint32_t cr_rival_finish(const cr_rival_sum *sum, float area_m2, cr_area *out);

/* Purpose  a sum for each contact area: empty ones before, the answers of all that push after.   Shapes  sums[areas->count]. */
void cr_rival_clear(cr_rival_sum *sums, uint32_t count);
uint32_t cr_rival_answers(const cr_rival_sum *sums, const cr_area_set *areas, cr_area *out, uint32_t room);

/* ---- shared by the proxies (planes.c) -------------------------------------------------------------------------------- */

#define CR_RIVAL_PLANES_MAX 16

/* Half-spaces that a displacement d must stay in: normal . d >= least. */
typedef struct {
    uint32_t count;
    cr_vec3 normal[CR_RIVAL_PLANES_MAX];
    float least_m[CR_RIVAL_PLANES_MAX];
} cr_rival_planes;

/* Purpose  add the plane of a point phi_m above the surface with this gradient; the highest gives way when all are taken. */
void cr_rival_add_plane(cr_rival_planes *planes, cr_vec3 gradient, float phi_m);
/* Purpose  the displacement nearest to goal_m in all half-spaces (nearest compromise when there is none). */
cr_vec3 cr_rival_project(const cr_rival_planes *planes, cr_vec3 goal_m);
/* Purpose  begin a tick: after a jump of the device that it cannot follow, a proxy starts again at the device. */
void cr_rival_start(const cr_respond_input *in);
/* Purpose  one step of the proxy towards the device within the planes, no longer than step_m; the planes stay where they are.
 * Output   1 while it moves. */
int cr_rival_step(cr_proxy *proxy, cr_vec3 device_m, cr_rival_planes *planes, float step_m);
/* Purpose  the spring from device to proxy as one contact area acting at the device. */
uint32_t cr_rival_pull(const cr_proxy *proxy, cr_vec3 device_m, cr_area *out);
/* How far a proxy moves between two looks at the distances, and how often a tick. */
float cr_rival_reach(const cr_respond_input *in);
#define CR_RIVAL_STEPS 16

#endif
