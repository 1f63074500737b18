/* What must hold inside is checked where CR_ASSERTS is 1: each state that is spoiled here stops at the hook, at the place that says so. Where it is 0
 * nothing stops. */
#include "contact/way_out.h"
#include "image_builder.h"
#include "servo/bus_parts.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

static jmp_buf stop;
static const char *stopped_in;

void cr_assert_failed(const char *file, int line);

/* In the place of the port's. */
void cr_assert_failed(const char *file, int line) {
    assert_true(line > 0);
    stopped_in = file;
    longjmp(stop, 1);
}

/* Runs a statement that is to stop in a file of these sources. */
#define STOPS_IN(file, statement)                                                                                      \
    do {                                                                                                               \
        stopped_in = "";                                                                                               \
        if (setjmp(stop) == 0) {                                                                                       \
            statement;                                                                                                 \
        }                                                                                                              \
        const size_t said = strlen(stopped_in), wanted = strlen(file);                                                 \
        assert_true(said >= wanted && strcmp(stopped_in + said - wanted, file) == 0);                                  \
    } while (0)

static cr_bus make_bus(void) {
    cr_bus bus;
    cr_bus_reset(&bus, cr_servo_config_default().axis);
    return bus;
}

#if CR_ASSERTS

static void open_cube_in_block(crt_rig *rig) {
    const crt_solid block = crt_box(-30e-3, 30e-3, 30e-3, -30e-3, 0.0);
    crt_open_cube(rig, &block, 5e-3, 1e-3, 2e-3);
}

static void a_lane_is_taken_only_where_there_is_one(void **state) {
    (void)state;
    volatile uint32_t none = 0u;
    uint32_t lanes = none;
    STOPS_IN("math3.h", (void)take_lane(&lanes));
}

/* The rest of a search is what no tick could have left. */
static void a_search_that_no_tick_leaves_stops(void **state) {
    (void)state;
    static cr_descent search;
    static cr_contact_set set;
    static float wake[64 * CR_LANES];
    crt_rig rig;
    open_cube_in_block(&rig);
    const cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    const xform at = cr_xform_from_pose(&pose);
    const cr_detect_options options = {
        .skip = 0u, .coverage = CR_COVERAGE_SOFT, .lookups_max = 1000u, .slices_max = 32u};
    cr_motion motion = {.wake_m = wake, .wake_count = rig.scene.group_count * CR_LANES};
    cr_stats stats = {0};
    assert_true(motion.wake_count <= sizeof wake / sizeof *wake && rig.scene.groups[0].leaf == 0u);
    search = (cr_descent){.open = 1u, .depth = CR_TREE_DEPTH_MAX}; /* all levels in use, and a group more to enter */
    search.stack[CR_TREE_DEPTH_MAX - 1u].lanes = 1u;
    STOPS_IN("detect.c", (void)cr_detect(&rig.field, &at, &options, &motion, &search, &set, &stats));
    search =
        (cr_descent){.open = 1u, .waiting = 2u, .looked_up = 1u}; /* one waits that was not looked up with the other */
    STOPS_IN("detect.c", (void)cr_detect(&rig.field, &at, &options, &motion, &search, &set, &stats));
    search = (cr_descent){.open = 0u};
    assert_int_equal(cr_detect(&rig.field, &at, &options, &motion, &search, &set, &stats), 1);
    assert_true(set.hit_count > 1u && set.way.count > 0u);
    crt_close(&rig);
}

static void a_hit_that_is_not_there_is_not_added_to_zones(void **state) {
    (void)state;
    static cr_contact_set set;
    crt_rig rig;
    open_cube_in_block(&rig);
    const cr_looked looked = {.cluster = 0u, .c = &rig.scene.clusters[0]};
    STOPS_IN("gather.c", cr_way_add(&set, 0u, &looked));
    set.hit_count = 1u; /* of cluster 0, but neither looked up nor measured */
    STOPS_IN("gather.c", cr_way_add(&set, 0u, &looked));
    crt_close(&rig);
}

static void planes_are_turned_of_kinds_that_have_them(void **state) {
    (void)state;
    crt_rig rig;
    open_cube_in_block(&rig);
    const cr_pose pose = crt_pose(0.0, 0.0, 0.0);
    xform at = cr_xform_from_pose(&pose);
    cr_planes planes;
    STOPS_IN("planes.c", cr_planes_turn(&rig.scene, &at, 0u, &planes));
    STOPS_IN("planes.c", cr_planes_turn(&rig.scene, &at, rig.scene.kind_count, &planes));
    at.r0 = v3_scale(at.r0, 2.0f); /* no rotation: normals are not of length 1 any more */
    at.r1 = v3_scale(at.r1, 2.0f);
    at.r2 = v3_scale(at.r2, 2.0f);
    STOPS_IN("planes.c", cr_planes_turn(&rig.scene, &at, rig.scene.kind_count - 1u, &planes));
    STOPS_IN("field.c", (void)cr_pair_label(&rig.scene, 1u, 1u));
    crt_close(&rig);
}

static void half_spaces_push_along_normals_of_length_one(void **state) {
    (void)state;
    static cr_way_along along;
    const cr_vec3 twice = {0.0f, 0.0f, 2.0f};
    const float depth_m = 1e-3f;
    float push_m;
    STOPS_IN("resolve.c", cr_way_resolve_begin(&twice, &depth_m, 1u, &along, &push_m));
}

static void a_zone_joins_once(void **state) {
    (void)state;
    static cr_way_zones zones;
    static cr_way_relations relations;
    static cr_way_cone cone;
    static cr_way_half halves[CR_WAY_ZONES_MAX];
    static const xform at_home = {{1.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f}, {0.0f, 0.0f, 1.0f}, {0.0f, 0.0f, 0.0f}};
    crt_rig rig;
    open_cube_in_block(&rig);
    zones.count = 1u;
    STOPS_IN("relate.c",
             (void)cr_way_relate(&rig.scene, &at_home, &zones, 0u, &relations)); /* nothing is inside of it */
    zones.zones[0] =
        (cr_way_zone){.weight_m3 = 1e-9f, .area_m2 = 1e-5f, .flat = 1u, .plane_normal = {0.0f, 0.0f, 1.0f}};
    (void)cr_way_relate(&rig.scene, &at_home, &zones, 0u, &relations);
    (void)cr_way_join(&rig.scene, &zones, 0u, &relations, halves, &cone);
    STOPS_IN("relate.c", (void)cr_way_join(&rig.scene, &zones, 0u, &relations, halves, &cone));
    crt_close(&rig);
}

/* A torque that no drive is ready for, a phase that comes back, an axis that is none. */
static void the_bus_sends_no_torque_before_its_time(void **state) {
    (void)state;
    const cr_bus_config config = cr_servo_config_default().bus;
    const int16_t some[CR_AXES] = {0, 1, 0};
    cr_servo_counters counters = {0};
    cr_bus bus = make_bus();
    cr_tx tx = {0};
    bus.phase = CR_PHASE_ENABLE;
    STOPS_IN("bus.c", cr_bus_transmit(&config, &bus, some, 0, 0u, &counters, &tx));
    STOPS_IN("bus.c", cr_bus_raise(&bus, CR_FAULT_DRIVE, CR_AXES));
    bus.phase = CR_PHASE_RUN + 1u;
    STOPS_IN("bus.c", cr_bus_check(&config, &bus, 0u, &counters));
}

static void speeds_are_of_samples_that_came(void **state) {
    (void)state;
    cr_velocity v;
    cr_velocity_reset(&v);
    (void)cr_velocity_step(&v, 0, 1u, 16u);
    STOPS_IN("velocity.c", (void)cr_velocity_step(&v, 0, 0u, 16u));
    v.head = CR_WINDOW_MAX + 1u;
    STOPS_IN("velocity.c", (void)cr_velocity_step(&v, 0, 1u, 16u));
}

#endif

/* The schedule has room for all that is sent; in a build without checks the last frame gives way. */
static void a_frame_too_many_stops_where_it_is_checked(void **state) {
    (void)state;
    cr_tx tx = {.count = CR_TX_MAX};
    if (CR_ASSERTS) {
        STOPS_IN("bus.c", (void)cr_bus_add_frame(&tx, ID_SYNC, 0u));
    } else {
        (void)cr_bus_add_frame(&tx, ID_SYNC, 0u);
        assert_true(tx.frames[CR_TX_MAX - 1u].id == ID_SYNC);
    }
    assert_true(tx.count == CR_TX_MAX);
}

static void a_sound_state_stops_nowhere(void **state) {
    (void)state;
    const cr_bus_config config = cr_servo_config_default().bus;
    cr_servo_counters counters = {0};
    cr_bus bus = make_bus();
    stopped_in = "";
    if (setjmp(stop) == 0) {
        cr_bus_check(&config, &bus, 1000000u, &counters);
    }
    assert_string_equal(stopped_in, "");
}

int main(void) {
    const struct CMUnitTest tests[] = {
#if CR_ASSERTS
        cmocka_unit_test(a_lane_is_taken_only_where_there_is_one),
        cmocka_unit_test(a_search_that_no_tick_leaves_stops),
        cmocka_unit_test(a_hit_that_is_not_there_is_not_added_to_zones),
        cmocka_unit_test(planes_are_turned_of_kinds_that_have_them),
        cmocka_unit_test(half_spaces_push_along_normals_of_length_one),
        cmocka_unit_test(a_zone_joins_once),
        cmocka_unit_test(the_bus_sends_no_torque_before_its_time),
        cmocka_unit_test(speeds_are_of_samples_that_came),
#endif
        cmocka_unit_test(a_frame_too_many_stops_where_it_is_checked),
        cmocka_unit_test(a_sound_state_stops_nowhere),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
