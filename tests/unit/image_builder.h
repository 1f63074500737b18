/* Scene images put together by hand from analytic distances, so that what the firmware must answer is known in closed form.
 * Nothing here uses the bake. Units: m. */
#ifndef CRT_IMAGE_BUILDER_H
#define CRT_IMAGE_BUILDER_H

#include "contact/stages.h"

#define CRT_SIDES_MAX 4
#define CRT_BRICK_MOST (CR_FINE_BLOCKS + 512u * 128u)

/* A convex polygon in the x-z plane (counter-clockwise from x to z) swept along y from -half_y_m to half_y_m; hollow: all of
 * space but that, so that its creases are concave. With ball_m > 0 a ball about the origin instead. */
typedef struct {
    double corner_m[CRT_SIDES_MAX][2]; /* x, z */
    int sides;
    double half_y_m;
    int hollow;
    double ball_m;
    int fine; /* voxels that hold surface have samples of their own: those with an even index halves, the others quarters */
} crt_solid;

/* Purpose  a box between low and high (its y range is about zero).   Output  facets in the order -z, +x, +z, -x, -y, +y. */
crt_solid crt_box(double x_low_m, double x_high_m, double half_y_m, double z_low_m, double z_high_m);
/* Purpose  the empty room of the same size inside solid matter: normals point into the room. */
crt_solid crt_room(double x_low_m, double x_high_m, double half_y_m, double z_low_m, double z_high_m);
/* Purpose  a wedge with its edge along y through the origin and its bisector along -z. Facets: base, right, left, -y, +y. */
crt_solid crt_wedge(double angle_rad, double height_m, double half_y_m);
crt_solid crt_ball(double radius_m);

/* Purpose  signed distance in double, from segments and not from planes as the firmware has it; negative inside. */
double crt_distance(const crt_solid *solid, const double p_m[3]);
/* Purpose  the same for a prism that is not hollow, with the nearest point of its surface. */
double crt_nearest(const crt_solid *solid, const double p_m[3], double nearest_m[3]);
/* Purpose  the box round a solid (of a hollow one: round its room). */
void crt_bounds(const crt_solid *solid, double low_m[3], double high_m[3]);
/* Purpose  plane of facet: unit normal out of the matter, and offset. */
void crt_plane(const crt_solid *solid, int facet, double plane[4]);
int crt_facets(const crt_solid *solid);

/* One sample of a tool surface; width_m are the sides of its piece along two axes of the surface. */
typedef struct {
    double pos_m[3], normal[3], u[3], v[3], width_m[2];
    double area_m2, reach_m, bow_m;
    int vertex, crease;
} crt_sample;

/* Samples in clusters: cluster i is samples[start[i] .. start[i + 1]). */
typedef struct {
    crt_sample *samples;
    uint32_t *start;
    uint32_t sample_count, cluster_count;
    double spacing_m;
} crt_tool;

/* Purpose  an empty tool; free with crt_tool_free. */
crt_tool crt_tool_new(double spacing_m);
/* Purpose  samples of a box: tiles of 4 x 4 on each face, about spacing_m wide, its edges in pieces, and its vertices. */
void crt_add_box(crt_tool *tool, const double centre_m[3], const double half_m[3]);
/* Purpose  samples of a ball on rings about z. */
void crt_add_ball(crt_tool *tool, double radius_m);
/* Purpose  a tool of three clusters: the lower face of a plate of 6 mm about the origin, its four edges, its four corners. */
crt_tool crt_plate(void);
void crt_tool_free(crt_tool *tool);

/* Purpose  a complete image, 64-byte aligned, checksum included. The caller frees it.   Output  its size in *size_bytes. */
uint8_t *crt_image(const crt_solid *solid, const crt_tool *tool, double voxel_m, uint32_t *size_bytes);
/* Purpose  an image of crt_image whose tree is one group, as small as it gets: the bricks from low to below high alone, what
 *          repeats stored once, two leaf groups under a root. The caller frees it; image stays.   Output  size in *size_bytes. */
uint8_t *crt_shrink(uint8_t *image, const uint32_t low[3], const uint32_t high[3], uint32_t *size_bytes);
/* Purpose  samples of a near brick whose low corner is given, at most CRT_BRICK_MOST of them; fine ones when the solid says so and the
 *          brick holds surface.   Output  how many. */
uint32_t crt_fill_samples(const crt_solid *solid, const struct cr_img_meta *meta, const double low[3],
                          struct cr_img_brick *brick, int16_t *samples);
/* Purpose  how many samples a brick of an image has, its table and blocks included. */
uint32_t crt_samples_of(const struct cr_img_brick *brick, const int16_t *samples);
/* Purpose  write the checksum after a change. */
void crt_seal(uint8_t *image);
/* Purpose  a section of a well-formed image and its table row. */
void *crt_section(uint8_t *image, uint32_t id);
struct cr_img_section *crt_row(uint8_t *image, uint32_t id);

/* An opened image with a world over it. */
typedef struct {
    uint8_t *image;
    uint32_t size_bytes;
    cr_scene scene;
    cr_field field;
    void *memory;
    size_t memory_bytes;
    cr_world *world;
} crt_rig;

/* Purpose  build, open and initialise; asserts that all of it works. config null: the defaults. */
void crt_open(crt_rig *rig, const crt_solid *solid, const crt_tool *tool, double voxel_m, const cr_config *config);
/* Purpose  the same with a cube about the tool's origin and the default settings. */
void crt_open_cube(crt_rig *rig, const crt_solid *solid, double half_m, double spacing_m, double voxel_m);
/* Purpose  let every brick know that all planes of the solid, no ball, give its distances. */
void crt_mark_planes(crt_rig *rig);
void crt_close(crt_rig *rig);
/* Purpose  back to the state before the first tick, with these settings. */
void crt_restart(crt_rig *rig, const cr_config *config);
/* Purpose  cells of several facets become mixed, and no brick has planes that hold in all of it. Neither sealed nor opened anew. */
void crt_forget_planes(crt_rig *rig);

/* Purpose  a cube about the tool's origin, kept apart from a block with an edge along y by a plane through it: no force at all, whatever the attitude. */
void crt_check_free(const crt_rig *rig, double half_m, const cr_config *config);

#ifdef CR_RIVALS
/* Purpose  the areas at a pose, searched from scratch in one call.   Output  *set, *areas, *stats. */
void crt_find_areas(const crt_rig *rig, const cr_pose *pose, uint32_t skip, uint32_t coverage, cr_contact_set *set,
                    cr_area_set *areas, cr_stats *stats);
#endif
/* Random numbers: the same on every machine. */
double crt_uniform(uint64_t *seed, double low, double high);
cr_quat crt_random_rotation(uint64_t *seed);
cr_pose crt_pose(double x_m, double y_m, double z_m);
/* Purpose  rotation by angle about an axis. */
cr_quat crt_turn(double x, double y, double z, double angle_rad);

/* Purpose  whether every number of an output is finite and every count within its capacity. */
int crt_is_sound(const cr_output *out, const cr_config *config);
/* Purpose  whether two outputs are the same to the bit, except for the work they took. */
int crt_same(const cr_output *a, const cr_output *b);

#endif
