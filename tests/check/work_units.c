/* What a unit of work costs: each part of a search is done in a program that valgrind counts instructions of, and says how many units it was counted for.
 *
 *     valgrind --tool=callgrind --callgrind-out-file=FILE work_units     one dump a part, named by it; on stdout: PART UNITS
 *
 * Parts that share what is not meant are told apart by their difference: tests/check/test_work_units.py. */
#include "contact/way_out.h"
#include "image_builder.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <valgrind/callgrind.h>

#define VOXEL_M 2e-3
#define HALF_M 8e-3
#define FLOOR 2u
#define WALL 1u
#define MANY 16u
/* The tool is a plate. Above the floor, every sample near enough to be looked at; and with all of it in contact. */
#define THICK_M 2e-3
#define NEAR_M 0.1e-3
#define IN_M (-0.5e-3 - THICK_M)

static cr_contact_set set;
static cr_way_work work;
static cr_stats stats;

/* Instructions since the last one are this part's. */
static void begin_part(void) { CALLGRIND_ZERO_STATS; }
static void end_part(const char *name, uint32_t spent) {
    CALLGRIND_DUMP_STATS_AT(name);
    printf("%s %.3f\n", name, (double)spent / CR_WORK_PARTS);
}

/* A block under the plate. */
static void open_floor(crt_rig *rig) {
    const crt_solid block = crt_box(-20e-3, 20e-3, 20e-3, -20e-3, 0.0);
    const double centre[3] = {0.0, 0.0, 0.5 * THICK_M}, half[3] = {HALF_M, HALF_M, 0.5 * THICK_M};
    crt_tool plate = crt_tool_new(1e-3);
    crt_add_box(&plate, centre, half);
    crt_open(rig, &block, &plate, VOXEL_M, NULL);
    crt_tool_free(&plate);
}

/* From now on each brick sees these facets and no other; planes: and their planes are its distances. */
static void mark(crt_rig *rig, uint32_t kind, uint32_t planes) {
    struct cr_img_brick *bricks = crt_section(rig->image, CR_SEC_BRICKS);
    for (uint32_t i = 0; i < rig->scene.brick_count; i++) {
        bricks[i].kind = (uint16_t)kind;
        bricks[i].planes = (uint16_t)planes;
        bricks[i].cells = CR_CELLS_NONE;
        bricks[i].creased = (kind & (kind - 1u)) != 0u;
    }
    crt_seal(rig->image);
    if (cr_scene_open(&rig->scene, rig->image, rig->size_bytes) != CR_OK) {
        abort();
    }
}

/* Nothing is skipped: the same clusters are looked at, and the same spheres looked up, at every pose. */
static void detect(const crt_rig *rig, double above_m, const char *name) {
    const cr_pose pose = crt_pose(0.0, 0.0, above_m);
    const xform at = cr_xform_from_pose(&pose);
    const cr_detect_options options = {.skip = 0u, .lookups_max = UINT32_MAX, .slices_max = 1u};
    cr_motion motion = {.wake_count = rig->scene.group_count * CR_LANES};
    static cr_descent search;
    memset(&search, 0, sizeof search);
    motion.wake_m = calloc(motion.wake_count, sizeof(float));
    cr_motion_advance(&motion, &pose);
    begin_part();
    (void)cr_detect(&rig->field, &at, &options, &motion, &search, &set, &stats);
    if (name != NULL) {
        end_part(name, search.spent);
    }
    free(motion.wake_m);
}

static void look_up(const crt_rig *rig) {
    cr_lanes3 world;
    cr_lookup found;
    for (int i = 0; i < CR_LANES; i++) {
        world.x[i] = 0.5e-3f * (float)i;
        world.y[i] = 0.0f;
        world.z[i] = -0.3e-3f;
    }
    begin_part();
    cr_field_look_up(&rig->field, &world, &found);
    end_part("lookup", CR_WORK_PARTS);
}

static void measure_hits(const crt_rig *rig, const char *all, const char *none) {
    const cr_pose pose = crt_pose(0.0, 0.0, IN_M);
    const xform at = cr_xform_from_pose(&pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &rig->field, .world_from_tool = &at, .set = &set, .config = &config};
    for (int deep = 0; deep < 2; deep++) {
        detect(rig, IN_M, NULL);
        for (uint32_t h = 0; h < set.hit_count; h++) {
            set.way.reach[h].bound_m = deep ? 1.0f : 0.0f;
            set.hits[h].facet = CR_FACET_NONE; /* looked up again, where they were */
        }
        cr_way_begin(&in, &work);
        for (uint32_t z = 0; z < set.way.count; z++) {
            set.way.zones[z].key.piece = CR_PIECE_NONE - 1u; /* what is measured counts for none */
        }
        work.spent = 0u;
        begin_part();
        (void)cr_way_measure(&in, &work, UINT32_MAX);
        end_part(deep ? all : none, work.spent);
    }
}

/* Zones of one piece over as many surfaces, whose normals are all about upwards; each is in contact. */
static void make_zones(float lean) {
    uint64_t seed = 3u;
    memset(&set, 0, sizeof set);
    memset(&work, 0, sizeof work);
    set.way.count = MANY;
    for (uint32_t i = 0; i < MANY; i++) {
        cr_way_zone *z = &set.way.zones[i];
        const cr_vec3 n = v3_unit(
            v3((float)crt_uniform(&seed, -1.0, 1.0) * lean, (float)crt_uniform(&seed, -1.0, 1.0) * lean, 1.0f), 0.0f);
        z->key = (cr_way_key){CR_WAY_CURVED | i, 4u, 0u};
        z->patch = i;
        z->weight_m3 = 1e-9f;
        z->area_m2 = 1e-5f;
        z->deep_m = 1e-3f;
        z->push_m3 = v3_scale(n, z->weight_m3);
        z->normal_m3 = v3_scale(n, z->weight_m3);
        z->centre_m4 = v3_scale(v3(1e-3f * (float)i, 0.0f, 0.0f), z->weight_m3);
    }
}

/* All zones, or half-spaces, of one pass. */
static void pass(const cr_respond_input *in, const char *name) {
    uint32_t spent = 0u;
    begin_part();
    for (const uint32_t end = work.next + MANY; work.next < end;) {
        work.spent = CR_WORK_PARTS - 1u; /* so that one step ends it */
        (void)cr_way_measure(in, &work, 1u);
        spent += work.spent - (CR_WORK_PARTS - 1u);
    }
    end_part(name, spent);
}

static void join_zones(const crt_rig *rig) {
    const cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    const xform at = cr_xform_from_pose(&pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &rig->field, .world_from_tool = &at, .set = &set, .config = &config};
    uint64_t seed = 5u;
    make_zones(0.5f);
    cr_way_begin(&in, &work);
    pass(&in, "relate");
    pass(&in, "lead");
    for (uint32_t a = 0; a < MANY; a++) {
        for (uint32_t b = 0; b < a; b++) {
            work.relations.part[a][b] = work.relations.part[b][a] = (float)crt_uniform(&seed, 0.5, 1.0);
        }
    }
    pass(&in, "join");
    work.relations.half_count = MANY;
    for (uint32_t h = 0; h < MANY; h++) {
        work.half[h].weight_m3 = 1e-9f * MANY;
        work.half[h].led_m3 = 0.0f;
        work.relations.first[h] = h;
    }
    pass(&in, "agree");
    pass(&in, "share");
}

/* They lean on each other. */
static void resolve(float depth_m, const char *name) {
    make_zones(0.5f);
    work.relations.half_count = MANY;
    for (uint32_t h = 0; h < MANY; h++) {
        work.half[h].normal = v3_unit(set.way.zones[h].normal_m3, 0.0f);
        work.half[h].depth_m = depth_m;
        work.half[h].open = 1.0f;
    }
    begin_part();
    (void)cr_way_push(&work, UINT32_MAX);
    end_part(name, work.spent);
}

/* Lanes that count for half-spaces: for as many, as deep as this already, by one plane or by two that meet in each piece. */
static void count(const crt_rig *rig, uint32_t halves, float known_m, uint32_t planes, const char *name) {
    static const float whole[CR_LANES] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f,
                                          1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f};
    const cr_pose pose = crt_pose(0.0, 0.0, -1e-3);
    const xform from_tool = cr_xform_from_pose(&pose);
    const cr_config config = cr_config_default();
    const cr_respond_input in = {.field = &rig->field, .world_from_tool = &from_tool, .set = &set, .config = &config};
    const cr_way_survey survey = {&in, &set.way, &work.relations, work.half, &work.scratch, &work, UINT32_MAX};
    static cr_way_spots at;
    float first_m[CR_LANES], second_m[CR_LANES];
    make_zones(0.5f);
    set.way.count = halves;
    memset(&at, 0, sizeof at);
    at.c = &rig->scene.clusters[0];
    set.way.zones[0].key = (cr_way_key){FLOOR, 0u, at.c->piece[0]};
    at.lanes = first_lanes(at.c->count);
    at.count = planes;
    for (int i = 0; i < CR_LANES; i++) {
        first_m[i] = -1e-3f;
        second_m[i] = -1.01e-3f;
    }
    const float tilt = planes > 1u ? 0.29f : 0.0f; /* 17 degrees: trusted beside a curve */
    const float up = sqrtf(1.0f - tilt * tilt);
    at.planes[0] = (cr_way_known){FLOOR, 0, {tilt, 0.0f, up}, first_m};
    at.planes[1] = (cr_way_known){WALL, 0, {-tilt, 0.0f, up}, second_m};
    for (uint32_t h = 0; h < halves; h++) {
        work.relations.part[0][h] = work.relations.lead[h] = 1.0f;
        work.relations.half_of[h] = h;
        work.half[h].normal = v3(0.0f, 0.0f, 1.0f);
        work.half[h].weight_m3 = 1e-9f;
        work.half[h].curved_m3 = planes > 1u ? 1e-9f : 0.0f;
        work.half[h].deep_m = 1e-3f;
        work.half[h].depth_m = known_m;
    }
    work.relations.lead[0] = halves > 1u ? 0.5f : 1.0f;
    (void)cr_way_tell_counts(halves, 0u, &work.relations);
    begin_part();
    cr_way_count(&survey, &at, FLOOR, 0u, whole);
    end_part(name, work.spent);
}

int main(void) {
    static crt_rig rig;
    open_floor(&rig);
    CALLGRIND_START_INSTRUMENTATION;
    mark(&rig, 1u << FLOOR, 0u);
    look_up(&rig);
    detect(&rig, NEAR_M, "cells_near");
    detect(&rig, IN_M, "cells_in");
    measure_hits(&rig, "hits_in_cells", "no_hits_in_cells");
    join_zones(&rig);
    resolve(0.0f, "answer_of_none");
    resolve(1e-3f, "answer_resolved");
    count(&rig, 1u, 1.0f, 1u, "count_known");
    count(&rig, 1u, 0.0f, 1u, "count_lanes");
    count(&rig, MANY, 1.0f, 1u, "count_halves");
    count(&rig, 1u, 0.0f, 2u, "count_full");
    mark(&rig, 1u << FLOOR, 1u << FLOOR);
    detect(&rig, NEAR_M, "planes_near");
    detect(&rig, IN_M, "planes_in");
    measure_hits(&rig, "hits_on_planes", "no_hits_on_planes");
    mark(&rig, 1u << FLOOR | 1u << WALL, 0u);
    detect(&rig, IN_M, "meeting_in");
    crt_close(&rig);
    return 0;
}
