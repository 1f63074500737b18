/* The closed loop for as long as one likes, in lock-step: nothing drifts, counters wrap and do nothing else, the state keeps its
 * size. Strokes round an edge first, then one contact that never ends. CREASE_SOAK_TICKS says how long (`make soak`: 10^7). */
#include "image_builder.h"
#include "servo/servo_stages.h"
#include "sim.h"

#include <malloc.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define TICKS_DEFAULT 200000u
#define CYCLE_TICKS 5000u
#define CYCLES_SETTLE 2u  /* until a stroke is like the one before */
#define HOLD_SHARE 0.3    /* of the ticks: the contact that does not end */
#define SHADOW_EVERY 100u /* ticks between looks at a world that skips nothing and remembers nothing */
#define WRAP_AFTER 20000u /* ticks until the counters wrap */
#define GUARD 4096u
#define GUARD_BYTE 0xa5
#define FRAMES 64
#define OWN_DAMPING_NS_M 1.0 /* of the device, as the energy account takes it: control.c */
#define MS_NS 1000000ull
#define ARM_Y_M (-1.41421356 * 0.45) /* of the base in the world, config.c of the servo */

/* What is kept of a stroke: means over its ticks. */
typedef struct {
    double force_N[3], tip_m[3], energy_end_J;
} stroke;

typedef struct {
    uint8_t *image, *memory;
    cr_scene scene;
    cr_servo *servo;
    size_t servo_bytes;
    cr_world *shadow;
    void *shadow_memory;
    cr_sim *sim;
    uint64_t now_ns, ticks, rendered, limited, limits[CR_LIMIT_COUNT];
    cr_servo_counters before; /* set when the loop begins to render */
    double path_m, energy_J, energy_off_J, quaternion_off;
    cr_vec3 applied[3], tip; /* commanded forces, newest first; the tip before */
    uint32_t free_ticks, shadows;
    size_t heap_bytes;
    stroke sum;
} loop;

/* ---- the loop ---------------------------------------------------------------------------------------------------- */

static loop begin(void) {
    loop l;
    memset(&l, 0, sizeof l);
    /* A cube of 20 mm whose lower face meets a block when the tip is at z = 0; the block ends at x = 25 mm. */
    const crt_solid block = crt_box(-0.05, 0.025, 0.05, -0.06, -0.01);
    const double centre_m[3] = {0.0, 0.0, 0.0}, half_m[3] = {0.01, 0.01, 0.01};
    uint32_t bytes;
    crt_tool cube = crt_tool_new(2.5e-3);
    crt_add_box(&cube, centre_m, half_m);
    l.image = crt_image(&block, &cube, 4e-3, &bytes);
    crt_tool_free(&cube);
    assert_int_equal(cr_scene_open(&l.scene, l.image, bytes), CR_OK);

    cr_servo_config config = cr_servo_config_default();
    config.world.stiffness_N_m = 500.0f;
    config.control.contact_damping_Ns_m = 2.0f;
    l.servo_bytes = cr_servo_size(&l.scene, &config);
    l.memory = aligned_alloc(64, l.servo_bytes + 2u * GUARD);
    assert_non_null(l.memory);
    memset(l.memory, GUARD_BYTE, l.servo_bytes + 2u * GUARD);
    assert_int_equal(cr_servo_init(&l.servo, l.memory + GUARD, l.servo_bytes, &l.scene, &config), CR_OK);

    cr_config plain = config.world;
    plain.skip = 0u;
    l.shadow_memory = aligned_alloc(64, cr_world_size(&l.scene, &plain));
    assert_int_equal(cr_world_init(&l.shadow, l.shadow_memory, cr_world_size(&l.scene, &plain), &l.scene, &plain),
                     CR_OK);

    cr_sim_params params = cr_sim_params_default();
    params.substeps = 2u;  /* of 0.5 ms: enough for modes of 60 Hz, and five times as fast */
    l.now_ns = 1ull << 62; /* 146 years of uptime */
    l.sim = cr_sim_create(&params, 0u, l.now_ns / 1000u);
    assert_non_null(l.sim);
    return l;
}

static void end(loop *l) {
    cr_sim_destroy(l->sim);
    free(l->shadow_memory);
    free(l->memory);
    free(l->image);
}

static void send(loop *l, const cr_tx *tx) {
    for (uint32_t i = 0; i < tx->count; i++) {
        cr_sim_frame f = {.id = tx->frames[i].id, .len = tx->frames[i].size};
        memcpy(f.data, tx->frames[i].data, sizeof f.data);
        cr_sim_receive(l->sim, &f, l->now_ns / 1000u);
    }
}

static void period(loop *l) {
    cr_sim_frame frames[FRAMES];
    cr_tx tx;
    l->now_ns += MS_NS;
    cr_servo_sync(l->servo, l->now_ns, &tx);
    send(l, &tx);
    cr_sim_poll(l->sim, l->now_ns / 1000u);
    for (size_t n = cr_sim_send(l->sim, frames, FRAMES); n-- > 0u;) {
        cr_frame f = {(uint16_t)frames[n].id, frames[n].len, 0u, {0}};
        memcpy(f.data, frames[n].data, sizeof f.data);
        cr_servo_rx(l->servo, &f);
    }
    cr_servo_tick(l->servo, l->now_ns + 300000u, 1e-3f, &tx);
    send(l, &tx);
    l->ticks++;
}

/* Tip and yaw the hand asks for, in the world. */
static void reach_for(loop *l, double x, double y, double z, double yaw) {
    const double target[3] = {x, y - ARM_Y_M, z}, wrist[3] = {yaw, 0.0, 0.0};
    cr_sim_target(l->sim, target, wrist);
}

/* A stroke: down, along the face, over the edge, against the side, up and back. */
static void follow_stroke(loop *l, uint32_t at) {
    static const double way[][4] = {
        {0.0, 0.0, 0.008, 0.0},     {0.0, 0.0, -0.004, 0.0},    {0.02, 0.02, -0.004, 0.3},
        {0.034, 0.0, -0.005, 0.1},  {0.045, -0.02, -0.02, 0.0}, {0.031, 0.0, -0.02, -0.2},
        {0.031, 0.02, -0.005, 0.0}, {0.045, 0.0, 0.015, 0.0},   {0.0, 0.0, 0.008, 0.0},
    };
    const uint32_t legs = sizeof way / sizeof *way - 1u;
    const double turn = (double)at / CYCLE_TICKS * legs;
    const uint32_t leg = (uint32_t)turn;
    const double part = turn - leg, *a = way[leg], *b = way[leg + 1u];
    reach_for(l, a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * (b[2] - a[2]),
              a[3] + part * (b[3] - a[3]));
}

/* ---- what must hold ---------------------------------------------------------------------------------------------- */

/* The energy account in double, from what the record tells: force of two ticks ago on the way made since the last. */
static void account(loop *l, const cr_record *r) {
    const cr_vec3 tip = r->world_from_tool.pos_m, f = l->applied[1];
    const double dx = (double)tip.x - (double)l->tip.x, dy = (double)tip.y - (double)l->tip.y;
    const double dz = (double)tip.z - (double)l->tip.z;
    l->path_m += sqrt(dx * dx + dy * dy + dz * dz);
    l->energy_J += (double)f.x * dx + (double)f.y * dy + (double)f.z * dz;
    if (l->energy_J > 0.0) { /* what the device's own damping takes */
        const cr_vec3 v = r->velocity_world_m_s;
        const double v2 = (double)v.x * (double)v.x + (double)v.y * (double)v.y + (double)v.z * (double)v.z;
        l->energy_J = fmax(0.0, l->energy_J - OWN_DAMPING_NS_M * 1e-3 * v2);
    }
    l->free_ticks = v3_norm(r->contact_force_world_N) <= 1e-6f ? l->free_ticks + 1u : 0u;
    l->energy_J = l->free_ticks >= 4u ? 0.0 : l->energy_J;
    l->energy_off_J = fmax(l->energy_off_J, fabs(l->energy_J - (double)r->energy_J));
    l->applied[1] = l->applied[0];
    l->applied[0] = r->force_world_N;
    l->tip = tip;
}

static void check_tick(loop *l, const cr_record *r) {
    const cr_quat q = r->world_from_tool.rot;
    const double norm = sqrt((double)q.w * (double)q.w + (double)q.x * (double)q.x + (double)q.y * (double)q.y +
                             (double)q.z * (double)q.z);
    assert_true(cr_mode_is_rendering(r->mode) && r->faults == 0u && (r->fresh & 7u) == 7u);
    assert_true(isfinite(r->energy_J) && v3_is_finite(r->force_world_N));
    l->quaternion_off = fmax(l->quaternion_off, fabs(norm - 1.0));
    l->rendered++;
    l->limited += r->limits != 0u;
    for (uint32_t i = 0; i < CR_LIMIT_COUNT; i++) {
        l->limits[i] += r->limits >> i & 1u;
    }
    if (l->ticks % SHADOW_EVERY == 0u) {
        cr_output out;
        cr_tick(l->shadow, &r->world_from_tool, 1e-3f, &out);
        assert_memory_equal(&out.force_world_N, &r->contact_force_world_N, sizeof out.force_world_N);
        assert_memory_equal(&out.torque_world_Nm, &r->contact_torque_world_Nm, sizeof out.torque_world_Nm);
        l->shadows++;
    }
    account(l, r);
}

static void step(loop *l) {
    const size_t heap = l->ticks % 1000u == 0u ? mallinfo2().uordblks : 0u;
    period(l);
    if (heap != 0u) {
        l->heap_bytes = l->heap_bytes == 0u ? heap : l->heap_bytes;
        assert_int_equal(mallinfo2().uordblks, l->heap_bytes);
    }
    check_tick(l, cr_servo_get_record(l->servo));
}

static void check_counters(const loop *l) {
    const cr_servo_counters now = cr_servo_get_status(l->servo).counters;
    cr_servo_counters want = l->before;
    want.ticks_rendering += (uint32_t)l->rendered;
    want.ticks_limited += (uint32_t)l->limited;
    for (uint32_t i = 0; i < CR_LIMIT_COUNT; i++) {
        want.limits[i] += (uint32_t)l->limits[i];
    }
    assert_memory_equal(&now, &want, sizeof now);
}

static void check_guards(const loop *l) {
    for (size_t i = 0; i < GUARD; i++) {
        assert_int_equal(l->memory[i], GUARD_BYTE);
        assert_int_equal(l->memory[GUARD + l->servo_bytes + i], GUARD_BYTE);
    }
    assert_int_equal(cr_servo_size(&l->scene, &l->servo->config), l->servo_bytes);
}

/* ---- the runs ---------------------------------------------------------------------------------------------------- */

static uint64_t ticks_wanted(void) {
    const char *text = getenv("CREASE_SOAK_TICKS");
    return text != NULL ? strtoull(text, NULL, 10) : TICKS_DEFAULT;
}

/* Up to rendering; then every counter as if it had run for almost 2^32 ticks. */
static void start(loop *l) {
    uint32_t words[sizeof l->before / 4u];
    for (int k = 0; k < 3000 && cr_servo_get_status(l->servo).mode != CR_MODE_IDLE; k++) {
        reach_for(l, 0.0, 0.0, 0.008, 0.0);
        period(l);
    }
    cr_servo_input(l->servo, CR_COMMAND_START);
    period(l);
    assert_true(cr_mode_is_rendering(cr_servo_get_status(l->servo).mode));
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        words[i] = UINT32_MAX - WRAP_AFTER + (uint32_t)i;
    }
    memcpy(&l->before, words, sizeof words);
    l->before.rx_drops = l->servo->rx_drops; /* a copy of what the port says */
    l->servo->counters = l->before;
    l->servo->ticks = UINT32_MAX - WRAP_AFTER;
    l->tip = cr_servo_get_record(l->servo)->world_from_tool.pos_m;
}

static stroke one_stroke(loop *l) {
    stroke s = {{0.0}, {0.0}, 0.0};
    for (uint32_t at = 0; at < CYCLE_TICKS; at++) {
        follow_stroke(l, at);
        step(l);
        const cr_record *r = cr_servo_get_record(l->servo);
        const cr_vec3 f = r->force_world_N, p = r->world_from_tool.pos_m;
        const double force[3] = {(double)f.x, (double)f.y, (double)f.z},
                     tip[3] = {(double)p.x, (double)p.y, (double)p.z};
        for (int a = 0; a < 3; a++) {
            s.force_N[a] += force[a] / CYCLE_TICKS;
            s.tip_m[a] += tip[a] / CYCLE_TICKS;
        }
    }
    s.energy_end_J = (double)cr_servo_get_record(l->servo)->energy_J;
    return s;
}

static double apart(const double a[3], const double b[3]) {
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

static void strokes_repeat(loop *l, uint64_t cycles) {
    stroke first = {{0.0}, {0.0}, 0.0};
    double force_off = 0.0, tip_off = 0.0;
    for (uint64_t c = 0; c < cycles; c++) {
        const stroke s = one_stroke(l);
        assert_true(fabs(s.energy_end_J) == 0.0); /* the account closes with every contact */
        if (c <= CYCLES_SETTLE) {
            first = s;
        }
        force_off = fmax(force_off, apart(s.force_N, first.force_N));
        tip_off = fmax(tip_off, apart(s.tip_m, first.tip_m));
        if (c <= CYCLES_SETTLE) {
            force_off = tip_off = 0.0;
        }
    }
    print_message("strokes: %llu of %u ticks, mean force %.4f N; off the third by at most %.2g N, %.2g um\n",
                  (unsigned long long)cycles, CYCLE_TICKS,
                  sqrt(first.force_N[0] * first.force_N[0] + first.force_N[2] * first.force_N[2]), force_off,
                  1e6 * tip_off);
    assert_true(fabs(first.force_N[2]) > 0.05);
    assert_true(force_off < 5e-3 && tip_off < 20e-6);
}

static void one_long_contact(loop *l, uint64_t ticks) {
    double low_N = 1e9, high_N = 0.0;
    for (uint64_t k = 0; k < ticks; k++) {
        const double angle = 2.0 * acos(-1.0) * (double)(k % 2000u) / 2000.0;
        reach_for(l, 0.008 * cos(angle) - 0.008, 0.008 * sin(angle), k < 1000u ? 0.008 - 12e-6 * (double)k : -0.004,
                  0.0);
        step(l);
        const double force = (double)cr_servo_get_record(l->servo)->force_world_N.z; /* up, out of the block */
        low_N = k > 3000u ? fmin(low_N, force) : low_N;
        high_N = k > 3000u ? fmax(high_N, force) : high_N;
    }
    print_message("contact of %llu ticks: force %.3f to %.3f N, energy %.3g J\n", (unsigned long long)ticks, low_N,
                  high_N, (double)cr_servo_get_record(l->servo)->energy_J);
    assert_true(low_N > 0.3 && high_N < 1.5);
}

static void closed_loop_neither_drifts_nor_wraps_wrongly(void **state) {
    (void)state;
    const uint64_t ticks = ticks_wanted(), hold = (uint64_t)(HOLD_SHARE * (double)ticks);
    const uint64_t cycles = (ticks - hold) / CYCLE_TICKS;
    assert_true(cycles > CYCLES_SETTLE + 1u && ticks > 2u * WRAP_AFTER);
    loop l = begin();
    start(&l);
    strokes_repeat(&l, cycles);
    check_counters(&l);
    one_long_contact(&l, hold);
    check_counters(&l);
    check_guards(&l);
    assert_true(l.servo->ticks == (uint32_t)(UINT32_MAX - WRAP_AFTER + l.rendered + 1u)); /* 0 is passed over */
    print_message(
        "%llu ticks, way %.1f m; |q| off 1 by %.2g, energy account off by %.2g J, %u shadows the same to the bit\n",
        (unsigned long long)l.rendered, l.path_m, l.quaternion_off, l.energy_off_J, l.shadows);
    assert_true(l.quaternion_off < 1e-6 && l.energy_off_J < 1e-6);
    assert_true(l.path_m > 8.0); /* the odometers of detect began again on the way */
    end(&l);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_loop_neither_drifts_nor_wraps_wrongly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
