/* The servo in a loop with three drives and a mechanism made for this test alone: from power-on to a wall, every fault, and the
 * re-run of a recording. Shares nothing with the simulator, nor with the packers of the firmware. */
#include "image_builder.h"
#include "servo/servo_stages.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000ull
#define CONTACT_Z_M 0.03 /* a cube of 60 mm above a block whose top is z = 0 */
#define LINK 0.45

static uint8_t *image;
static uint32_t image_bytes;
static cr_scene scene;

static int build_image(void **state) {
    (void)state;
    const crt_solid block = crt_box(-0.08, 0.08, 0.08, -0.05, 0.0);
    const double centre_m[3] = {0.0, 0.0, 0.0}, half_m[3] = {0.03, 0.03, 0.03};
    crt_tool cube = crt_tool_new(0.005);
    crt_add_box(&cube, centre_m, half_m);
    image = crt_image(&block, &cube, 0.004, &image_bytes);
    crt_tool_free(&cube);
    return cr_scene_open(&scene, image, image_bytes) == CR_OK ? 0 : -1;
}

static int free_image(void **state) {
    (void)state;
    free(image);
    return 0;
}

/* ------------------------------------------------------------------------------------------------------- drives */

enum { DISABLED, READY, ON, ENABLED, FAULTED };

typedef struct {
    int nmt; /* 0x7f, 0x05 */
    int state;
    uint16_t control;
    int16_t target, held; /* received; acting since the last SYNC */
    uint32_t beat, offset;
    int boot, mute, refuse_sdo, mute_heartbeat, stuck;
    int32_t counts; /* as last told */
    int32_t slide;  /* counts added */
} drive;

typedef struct {
    cr_servo *servo;
    void *memory;
    cr_servo_config config;
    drive drives[3];
    double pos[3], vel[3], target[3], hand_N_m; /* tip, world */
    int16_t wrist[3];
    int mute_wrist;
    uint64_t now_ns;
    uint32_t tick;
    cr_frame extra[24];
    uint32_t extra_count;
    uint64_t skip_ns; /* the next SYNC comes later by this */
    float period_s;
    int no_sync;
    cr_tx tx;
    cr_record *records;
    uint32_t record_count, record_max;
} loop;

static loop make_loop(void) {
    loop l;
    memset(&l, 0, sizeof l);
    l.config = cr_servo_config_default();
    l.config.world.stiffness_N_m = 500.0f;
    l.config.control.contact_damping_Ns_m = 2.0f;
    const size_t size = cr_servo_size(&scene, &l.config);
    assert_true(size > 0u);
    l.memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    assert_int_equal(cr_servo_init(&l.servo, l.memory, size, &scene, &l.config), CR_OK);
    for (uint32_t a = 0; a < 3u; a++) {
        l.drives[a] = (drive){.nmt = 0x7f, .offset = 7u * a, .boot = 1};
    }
    l.pos[2] = l.target[2] = 0.05;
    l.hand_N_m = 400.0;
    l.now_ns = 1000u * MS;
    l.period_s = 1e-3f;
    l.record_max = 5000u;
    l.records = malloc(l.record_max * sizeof *l.records);
    return l;
}

static void free_loop(loop *l) {
    free(l->memory);
    free(l->records);
}

static uint16_t status_of(const drive *d) {
    static const uint16_t words[] = {0x0240, 0x0221, 0x0223, 0x0227, 0x0208};
    return words[d->state];
}

static void hear(loop *l, uint32_t axis, const cr_frame *f) {
    drive *d = &l->drives[axis];
    if (f->id == 0x000) {
        d->boot |= f->data[0] == 0x82;
        d->nmt = f->data[0] == 0x01 ? 0x05 : f->data[0] == 0x82 ? 0x7f : d->nmt;
        d->state = f->data[0] == 0x82 ? DISABLED : d->state;
    } else if (f->id == 0x611u + axis && d->refuse_sdo) {
        l->extra[l->extra_count++] = (cr_frame){
            (uint16_t)(0x591u + axis), 8u, 0u, {0x80, f->data[1], f->data[2], f->data[3], 0x22, 0x00, 0x00, 0x08}};
    } else if (f->id == 0x611u + axis) {
        l->extra[l->extra_count++] =
            (cr_frame){(uint16_t)(0x591u + axis), 8u, 0u, {0x60, f->data[1], f->data[2], f->data[3]}};
    } else if (f->id == 0x211u + axis && d->nmt == 0x05) {
        const uint16_t word = f->data[0];
        const int rising = (word & 0x80u) != 0u && (d->control & 0x80u) == 0u;
        d->control = word;
        if (d->state == FAULTED) {
            d->state = rising ? DISABLED : FAULTED;
        } else {
            d->state = word == 0x06                        ? READY
                       : word == 0x07 && d->state >= READY ? ON
                       : word == 0x0f && d->state >= ON    ? ENABLED
                       : word == 0x00                      ? DISABLED
                                                           : d->state;
        }
    } else if (f->id == 0x181 && d->nmt == 0x05) {
        d->target = (int16_t)(f->data[2u * axis] | f->data[2u * axis + 1u] << 8);
    }
}

/* Joints of the tip at the default posture's arm, elbow up. */
static void joints_of(const double pos[3], double joint[3]) {
    const double y = pos[1] + sqrt(2.0) * LINK, z = pos[2], r = sqrt(y * y + z * z);
    const double half = acos(r / (2.0 * LINK));
    joint[0] = pos[0];
    joint[1] = atan2(z, y) + half;
    joint[2] = atan2(z, y) - half;
}

static void move(loop *l) {
    static const double rated[3] = {10.0, 3.6, 3.6}, mass[3] = {5.4, 1.2, 1.2}, viscous[3] = {3.5, 1.5, 1.5};
    double q[3], tau[3], force[3];
    joints_of(l->pos, q);
    for (int a = 0; a < 3; a++) {
        drive *d = &l->drives[a];
        d->held = d->state == ENABLED && d->nmt == 0x05 ? d->target : 0;
        tau[a] = d->held / 1000.0 * rated[a];
    }
    /* J^T F = tau, solved for F: the two arm columns are l (-sin, cos). */
    const double a = -LINK * sin(q[1]), b = LINK * cos(q[1]), c = -LINK * sin(q[2]), d = LINK * cos(q[2]);
    force[0] = tau[0];
    force[1] = (tau[1] * d - tau[2] * b) / (a * d - b * c);
    force[2] = (a * tau[2] - c * tau[1]) / (a * d - b * c);
    for (int i = 0; i < 3; i++) {
        const double hand = l->hand_N_m * (l->target[i] - l->pos[i]) - 8.0 * l->vel[i];
        l->vel[i] += (force[i] + hand - viscous[i] * l->vel[i]) / mass[i] * 1e-3;
        l->pos[i] += l->vel[i] * 1e-3;
    }
}

static void put_state(loop *l, uint32_t axis) {
    static const double step[3] = {60e-6, 40e-6 / LINK, 40e-6 / LINK};
    drive *d = &l->drives[axis];
    double q[3];
    joints_of(l->pos, q);
    if (!d->stuck) {
        d->counts = (int32_t)floor(q[axis] / step[axis] + 0.5) + d->slide;
    }
    const uint32_t u = (uint32_t)d->counts;
    const uint16_t status = status_of(d), held = (uint16_t)d->held;
    const cr_frame f = {(uint16_t)(0x191u + axis),
                        8u,
                        0u,
                        {(uint8_t)u, (uint8_t)(u >> 8), (uint8_t)(u >> 16), (uint8_t)(u >> 24), (uint8_t)held,
                         (uint8_t)(held >> 8), (uint8_t)status, (uint8_t)(status >> 8)}};
    cr_servo_rx(l->servo, &f);
}

/* With every second SYNC, from drive Z. */
static void put_wrist(loop *l) {
    cr_frame f = {0x194, 6u, 0u, {0}};
    for (int i = 0; i < 3; i++) {
        const uint16_t u = (uint16_t)l->wrist[i];
        f.data[2 * i] = (uint8_t)u;
        f.data[2 * i + 1] = (uint8_t)(u >> 8);
    }
    if (l->tick % 2u == 0u && !l->mute_wrist) {
        cr_servo_rx(l->servo, &f);
    }
}

static void drives_speak(loop *l) {
    for (uint32_t a = 0; a < 3u; a++) {
        drive *d = &l->drives[a];
        if (d->mute) {
            continue;
        }
        if (d->nmt == 0x05) {
            put_state(l, a);
            if (a == 2u) {
                put_wrist(l);
            }
        }
        const int beat = (l->tick + d->offset) % 100u == 0u && !d->mute_heartbeat;
        if (beat || d->boot) {
            const cr_frame f = {(uint16_t)(0x711u + a), 1u, 0u, {(uint8_t)(d->boot ? 0 : d->nmt)}};
            cr_servo_rx(l->servo, &f);
            d->boot = 0;
        }
    }
    for (uint32_t i = 0; i < l->extra_count; i++) {
        cr_servo_rx(l->servo, &l->extra[i]);
    }
    l->extra_count = 0u;
}

/* One period. Every frame that leaves is checked: finite is a matter of course with whole numbers, the limits are not. */
static void period(loop *l) {
    cr_tx sync = {0};
    l->now_ns += MS + l->skip_ns;
    l->skip_ns = 0u;
    if (!l->no_sync) {
        cr_servo_sync(l->servo, l->now_ns, &sync);
        move(l);
        drives_speak(l);
    }
    l->no_sync = 0;
    cr_servo_tick(l->servo, l->now_ns + 400000u, l->period_s, &l->tx);
    l->period_s = 1e-3f;
    for (uint32_t i = 0; i < l->tx.count; i++) {
        for (uint32_t a = 0; a < 3u; a++) {
            hear(l, a, &l->tx.frames[i]);
        }
    }
    const cr_record *r = cr_servo_get_record(l->servo);
    for (int a = 0; a < 3; a++) {
        const float most = l->config.axis[a].torque_max / l->config.axis[a].rated * 1000.0f;
        assert_true(fabsf((float)r->target[a]) <= most && isfinite(r->torque[a]));
    }
    if (l->record_count < l->record_max) {
        l->records[l->record_count++] = *r;
    }
    l->tick++;
}

static uint32_t mode(const loop *l) { return cr_servo_get_status(l->servo).mode; }

static int run_until(loop *l, uint32_t wanted, uint32_t most) {
    for (uint32_t k = 0; k < most && mode(l) != wanted; k++) {
        period(l);
    }
    return mode(l) == wanted;
}

/* From power-on to pressing on the wall. */
static void press(loop *l) {
    assert_true(run_until(l, CR_MODE_IDLE, 3000u));
    cr_servo_input(l->servo, CR_COMMAND_START);
    period(l);
    assert_true(cr_mode_is_rendering(mode(l)));
    for (int k = 0; k < 600; k++) {
        l->target[2] = fmax(0.02, l->target[2] - 1e-4);
        period(l);
    }
    assert_true(cr_servo_get_record(l->servo)->area_count == 1u);
}

static int torque_is_zero(const loop *l) {
    static const uint8_t zero[6] = {0};
    return l->tx.count > 0u && l->tx.frames[0].id == 0x181 && memcmp(l->tx.frames[0].data, zero, 6) == 0;
}

/* -------------------------------------------------------------------------------------------------------- normal */

static void servo_brings_the_drives_up_and_waits(void **state) {
    (void)state;
    loop l = make_loop();
    uint32_t seen = 1u << CR_MODE_INIT;
    for (int k = 0; k < 2500; k++) {
        period(&l);
        seen |= 1u << mode(&l);
        assert_true(l.tx.count == 0u || torque_is_zero(&l));
    }
    assert_int_equal(seen, 1u << CR_MODE_INIT | 1u << CR_MODE_BUS_UP | 1u << CR_MODE_CALIBRATING | 1u << CR_MODE_IDLE);
    assert_true(l.drives[0].state == ENABLED && l.drives[1].state == ENABLED && l.drives[2].state == ENABLED);
    free_loop(&l);
}

static void servo_renders_the_wall(void **state) {
    (void)state;
    loop l = make_loop();
    press(&l);
    for (int k = 0; k < 2000; k++) {
        period(&l);
        assert_true(cr_mode_is_rendering(mode(&l)));
    }
    /* The hand (400 N/m to z = 20 mm) and the wall (500 N/m from 30 mm) meet at 25.6 mm: 2.2 N, without an anti-gravity residue. */
    const cr_record *r = cr_servo_get_record(l.servo);
    const double residue = 0.2; /* gravity that the default compensates and this mechanism does not have */
    print_message("wall: z %.3f mm, force %.3f N, speed %.2g m/s, energy %.3g mJ\n", 1e3 * l.pos[2],
                  (double)r->force_world_N.z, l.vel[2], 1e3 * (double)r->energy_J);
    assert_true(fabs(l.pos[2] - (CONTACT_Z_M - (400.0 * 0.01 - residue) / 900.0)) < 3e-4);
    assert_true(fabs((double)r->force_world_N.z - 500.0 * (CONTACT_Z_M - l.pos[2])) < 0.1);
    assert_true(fabs(l.vel[2]) < 2e-3 && r->counters.faults == 0u);
    cr_servo_input(l.servo, CR_COMMAND_STOP);
    period(&l);
    assert_true(mode(&l) == CR_MODE_IDLE && torque_is_zero(&l));
    free_loop(&l);
}

static void servo_starts_inside_the_wall_without_a_kick(void **state) {
    (void)state;
    loop l = make_loop();
    l.pos[2] = l.target[2] = 0.02;
    assert_true(run_until(&l, CR_MODE_IDLE, 3000u));
    cr_servo_input(l.servo, CR_COMMAND_START);
    float last = 0.0f;
    for (int k = 0; k < 300; k++) {
        period(&l);
        const float force = v3_norm(cr_servo_get_record(l.servo)->force_world_N);
        assert_true(force - last < 0.1f);
        last = force;
    }
    assert_true(last > 1.0f);
    free_loop(&l);
}

static void missing_state_is_bridged_with_half_the_torque(void **state) {
    (void)state;
    loop l = make_loop();
    press(&l);
    const float before = cr_servo_get_record(l.servo)->torque[1];
    l.drives[2].mute = 1;
    period(&l);
    const cr_record *r = cr_servo_get_record(l.servo);
    assert_true(mode(&l) == CR_MODE_LIMITED && r->limits == CR_LIMIT_STALE && r->torque[1] == 0.5f * before);
    l.drives[2].mute = 0;
    period(&l);
    assert_true(cr_mode_is_rendering(mode(&l)) && r->counters.missing[2] == 1u && r->counters.faults == 0u);
    free_loop(&l);
}

/* -------------------------------------------------------------------------------------------------------- faults */

typedef enum {
    DO_SILENT,
    DO_HEARTBEAT,
    DO_RESET,
    DO_DRIVE_FAULT,
    DO_DRIVE_OFF,
    DO_EMCY,
    DO_JUMP,
    DO_WRIST_JUMP,
    DO_WRIST_SILENT,
    DO_RANGE,
    DO_NOT_FINITE,
    DO_OVERRUN,
    DO_NO_SYNC,
    DO_BACKWARDS,
    DO_PERIOD,
    DO_ALIEN,
    DO_TWICE,
    DO_BABBLE,
    DO_BUS_OFF,
    DO_SEND_FAILED,
    DO_COUNT
} deed;

/* `ticks`: periods until the fault, 1 is the very tick. */
static const struct {
    uint32_t fault, ticks;
} outcomes[DO_COUNT] = {
    {CR_FAULT_SILENT, 3u},      {CR_FAULT_HEARTBEAT, 252u}, {CR_FAULT_RESET, 1u},      {CR_FAULT_DRIVE, 1u},
    {CR_FAULT_DRIVE_STATE, 1u}, {CR_FAULT_EMCY, 1u},        {CR_FAULT_JUMP, 1u},       {CR_FAULT_JUMP, 2u},
    {CR_FAULT_SILENT, 7u},      {CR_FAULT_RANGE, 400u},     {CR_FAULT_NOT_FINITE, 1u}, {CR_FAULT_OVERRUN, 1u},
    {CR_FAULT_BAD_STATE, 1u},   {CR_FAULT_BAD_STATE, 1u},   {CR_FAULT_BAD_STATE, 1u},  {CR_FAULT_ALIEN, 1u},
    {CR_FAULT_ALIEN, 3u},       {CR_FAULT_BABBLE, 1u},      {CR_FAULT_BUS_OFF, 1u},    {CR_FAULT_BUS_OFF, 1u},
};

static void add_extra(loop *l, uint16_t id, uint8_t size, uint8_t first, uint8_t second) {
    l->extra[l->extra_count++] = (cr_frame){id, size, 0u, {first, second}};
}

static void commit(loop *l, deed what, uint32_t axis, int again) {
    drive *d = &l->drives[axis];
    switch (what) {
    case DO_SILENT:
        d->mute = 1;
        break;
    case DO_HEARTBEAT:
        d->mute_heartbeat = 1;
        break;
    case DO_RESET:
        add_extra(l, (uint16_t)(0x711u + axis), 1u, 0x00, 0);
        break;
    case DO_DRIVE_FAULT:
        d->state = FAULTED;
        break;
    case DO_DRIVE_OFF:
        d->state = ON;
        break;
    case DO_EMCY:
        add_extra(l, (uint16_t)(0x691u + axis), 8u, 0x10, 0x23);
        break;
    case DO_JUMP:
        d->slide += again ? 0 : 100;
        break;
    case DO_WRIST_JUMP:
        l->wrist[1] = 500;
        break;
    case DO_WRIST_SILENT:
        l->mute_wrist = 1;
        break;
    case DO_RANGE:
        d->slide += 40;
        break;
    case DO_NOT_FINITE:
        l->servo->control.energy_J = NAN;
        break;
    case DO_OVERRUN:
        l->skip_ns = 3u * MS;
        break;
    case DO_NO_SYNC:
        l->no_sync = 1;
        break;
    case DO_BACKWARDS:
        l->now_ns -= 5u * MS;
        break;
    case DO_PERIOD:
        l->period_s = NAN;
        break;
    case DO_ALIEN:
        add_extra(l, 0x181, 6u, 0x10, 0);
        break;
    case DO_TWICE: /* the drive's own state a second time */
        add_extra(l, (uint16_t)(0x191u + axis), 8u, 0, 0);
        memcpy(l->extra[0].data, cr_servo_get_record(l->servo)->frames[axis].data, 8);
        break;
    case DO_BABBLE:
        for (int i = 0; i < 20; i++) {
            add_extra(l, (uint16_t)(0x691u + axis), 8u, 0, 0);
        }
        break;
    case DO_BUS_OFF:
        cr_servo_input(l->servo, CR_INPUT_BUS_OFF);
        break;
    case DO_SEND_FAILED:
        cr_servo_input(l->servo, CR_INPUT_SEND_FAILED);
        break;
    default:
        break;
    }
}

static void one_fault(deed what, uint32_t axis, int wait) {
    loop l = make_loop();
    press(&l);
    for (int k = 0; k < wait; k++) {
        period(&l);
    }
    assert_true(v3_norm(cr_servo_get_record(l.servo)->force_world_N) > 0.5f);
    uint32_t ticks = 0u;
    while (mode(&l) != CR_MODE_FAULT && ticks < 500u) {
        commit(&l, what, axis, ticks > 0u);
        period(&l);
        ticks++;
        if (mode(&l) != CR_MODE_FAULT) {
            assert_true(cr_mode_is_rendering(mode(&l)));
        }
    }
    const cr_servo_status first = cr_servo_get_status(l.servo);
    assert_true(ticks <= outcomes[what].ticks);
    assert_true((first.first_fault & outcomes[what].fault) != 0u);
    assert_true(torque_is_zero(&l));
    /* It latches: no start, no time, no good behaviour brings it back. */
    l.drives[axis].mute = l.drives[axis].mute_heartbeat = 0;
    for (int k = 0; k < 300; k++) {
        cr_servo_input(l.servo, CR_COMMAND_START);
        period(&l);
        assert_true(mode(&l) == CR_MODE_FAULT && torque_is_zero(&l));
    }
    assert_true(l.drives[0].held == 0 && l.drives[1].held == 0 && l.drives[2].held == 0);
    assert_int_equal(cr_servo_get_status(l.servo).counters.faults, 1);
    assert_true((l.records[l.record_count - 1u].faults & outcomes[what].fault) != 0u);
    /* Commanded, it comes back from the start, and renders. */
    l.drives[axis].slide = 0;
    l.wrist[1] = 0;
    l.mute_wrist = 0;
    cr_servo_input(l.servo, CR_COMMAND_CLEAR);
    period(&l);
    assert_int_equal(mode(&l), CR_MODE_INIT);
    press(&l);
    free_loop(&l);
}

static void every_fault_zeroes_in_its_tick_latches_and_clears(void **state) {
    (void)state;
    for (int what = 0; what < DO_COUNT; what++) {
        for (int wait = 0; wait < 200; wait += 50) {
            one_fault((deed)what, what == DO_RANGE ? 0u : (uint32_t)(wait / 50) % 3u, wait);
        }
    }
}

/* Leaning on the wall for seconds, and sliding along it, is no reason to suspect an encoder, though X keeps its count. */
static void joint_that_rests_in_contact_is_no_fault(void **state) {
    (void)state;
    loop l = make_loop();
    press(&l);
    for (int k = 0; k < 3000; k++) {
        l.target[1] += k > 1500 ? 1e-5 : 0.0;
        period(&l);
        assert_true(cr_mode_is_rendering(mode(&l)));
    }
    assert_true(cr_servo_get_record(l.servo)->area_count == 1u);
    free_loop(&l);
}

static void stuck_encoder_is_noticed_when_the_torque_swings(void **state) {
    (void)state;
    for (uint32_t axis = 1; axis < 3u; axis++) {
        loop l = make_loop();
        press(&l);
        l.drives[axis].stuck = 1;
        int k = 0;
        for (; k < 1000 && mode(&l) != CR_MODE_FAULT; k++) {
            l.target[2] -= k > 100 && k < 600 ? 1e-4 : 0.0;
            period(&l);
        }
        assert_int_equal(cr_servo_get_status(l.servo).first_fault, CR_FAULT_STUCK);
        assert_true(torque_is_zero(&l) && k > 200);
        free_loop(&l);
    }
}

static void stuck_encoder_is_not_watched_when_told_so(void **state) {
    (void)state;
    loop l = make_loop();
    l.servo->config.axis[1].stuck = 0.0f;
    press(&l);
    l.drives[1].stuck = 1;
    for (int k = 0; k < 1000; k++) {
        l.target[2] -= k > 100 && k < 600 ? 1e-4 : 0.0;
        period(&l);
        assert_true(cr_mode_is_rendering(mode(&l)));
    }
    free_loop(&l);
}

static void drive_that_refuses_its_set_up_is_a_fault(void **state) {
    (void)state;
    loop l = make_loop();
    l.drives[1].refuse_sdo = 1;
    assert_true(run_until(&l, CR_MODE_FAULT, 3000u));
    const cr_servo_status status = cr_servo_get_status(l.servo);
    assert_true(status.first_fault == CR_FAULT_SDO && status.trouble_axis == 1u && status.sdo_abort == 0x08000022u);
    free_loop(&l);
}

static void second_host_is_noticed_before_a_word_is_sent(void **state) {
    (void)state;
    loop l = make_loop();
    for (int k = 0; k < 20; k++) {
        period(&l);
        assert_int_equal(l.tx.count, 0);
    }
    add_extra(&l, 0x080, 0u, 0, 0);
    period(&l);
    assert_true(mode(&l) == CR_MODE_FAULT && l.tx.count == 0u);
    free_loop(&l);
}

static void late_tick_in_idle_is_counted_and_no_fault(void **state) {
    (void)state;
    loop l = make_loop();
    assert_true(run_until(&l, CR_MODE_IDLE, 3000u));
    l.skip_ns = 30u * MS;
    l.period_s = 0.031f;
    period(&l);
    assert_true(mode(&l) == CR_MODE_IDLE && cr_servo_get_status(l.servo).counters.overruns >= 1u);
    free_loop(&l);
}

/* -------------------------------------------------------------------------------------------------------- re-run */

static cr_rerun rerun(const loop *l, const cr_record *records, size_t count, cr_record *out) {
    cr_servo *fresh;
    cr_rerun result = {0};
    const size_t size = cr_servo_size(&scene, &l->config);
    void *memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    assert_int_equal(cr_servo_init(&fresh, memory, size, &scene, &l->config), CR_OK);
    assert_int_equal(cr_servo_rerun(fresh, records, count / 2u, &result, out), CR_OK); /* in two pieces */
    assert_int_equal(
        cr_servo_rerun(fresh, records + count / 2u, count - count / 2u, &result, out == NULL ? NULL : out + count / 2u),
        CR_OK);
    free(memory);
    return result;
}

static void recording_runs_again_to_the_bit(void **state) {
    (void)state;
    for (int what = -1; what < DO_COUNT; what++) {
        if (what == DO_NOT_FINITE) {
            continue; /* reaches into the servo, which no input can */
        }
        loop l = make_loop();
        press(&l);
        for (int k = 0; k < 20; k++) {
            if (what >= 0 && mode(&l) != CR_MODE_FAULT) {
                commit(&l, (deed)what, 1u, k > 0);
            }
            period(&l);
        }
        const cr_rerun result = rerun(&l, l.records, l.record_count, NULL);
        assert_int_equal(result.records, l.record_count);
        assert_int_equal(result.different, 0);
        free_loop(&l);
    }
}

static void re_run_notices_a_changed_bit_and_a_gap(void **state) {
    (void)state;
    loop l = make_loop();
    press(&l);
    l.records[1200].frames[1].data[0] ^= 1u; /* one count of Y */
    cr_rerun result = rerun(&l, l.records, l.record_count, NULL);
    assert_true(result.different > 0u && result.first == 1200u && result.gap == 0u);
    l.records[1200].frames[1].data[0] ^= 1u;
    memmove(&l.records[1300], &l.records[1301], (l.record_count - 1301u) * sizeof *l.records);
    result = rerun(&l, l.records, l.record_count - 1u, NULL);
    assert_true(result.records == 1300u && result.gap == 1u && result.different == 0u);
    free_loop(&l);
}

static void record_holds_what_was_sent(void **state) {
    (void)state;
    loop l = make_loop();
    press(&l);
    period(&l);
    const cr_record *r = cr_servo_get_record(l.servo);
    const uint8_t *data = l.tx.frames[0].data;
    for (int a = 0; a < 3; a++) {
        assert_int_equal(r->target[a], (int16_t)(data[2 * a] | data[2 * a + 1] << 8));
        assert_true(fabsf((float)r->target[a] - r->torque[a] / l.config.axis[a].rated * 1000.0f) <= 0.5001f);
    }
    assert_true((r->fresh & 7u) == 7u && r->frame_count >= 3u && r->period_s == 1e-3f);
    free_loop(&l);
}

static void init_refuses_bad_memory_and_configurations(void **state) {
    (void)state;
    cr_servo_config config = cr_servo_config_default();
    const size_t size = cr_servo_size(&scene, &config);
    uint8_t *memory = aligned_alloc(64, (size + 127u) / 64u * 64u);
    cr_servo *servo = NULL;
    assert_int_equal(cr_servo_init(&servo, memory + 8, size, &scene, &config), CR_ERR_ALIGN);
    assert_int_equal(cr_servo_init(&servo, memory, size - 64u, &scene, &config), CR_ERR_SIZE);
    assert_int_equal(cr_servo_init(&servo, NULL, size, &scene, &config), CR_ERR_NULL);
    config.axis[1].rated = -1.0f;
    assert_int_equal(cr_servo_size(&scene, &config), 0);
    assert_int_equal(cr_servo_init(&servo, memory, size, &scene, &config), CR_ERR_CONFIG);
    assert_null(servo);
    free(memory);
}

static void every_bit_has_a_name(void **state) {
    (void)state;
    for (uint32_t i = 0; i < CR_FAULT_COUNT; i++) {
        assert_string_not_equal(cr_servo_fault_text(1u << i), "unknown");
    }
    for (uint32_t i = 0; i < CR_LIMIT_COUNT; i++) {
        assert_string_not_equal(cr_limit_text(1u << i), "unknown");
    }
    for (uint32_t i = 0; i < CR_MODE_COUNT; i++) {
        assert_string_not_equal(cr_mode_text(i), "unknown");
    }
    assert_string_equal(cr_mode_text(99u), "unknown");
    assert_string_equal(cr_servo_fault_text(CR_FAULT_SDO), "sdo");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(servo_brings_the_drives_up_and_waits),
        cmocka_unit_test(servo_renders_the_wall),
        cmocka_unit_test(servo_starts_inside_the_wall_without_a_kick),
        cmocka_unit_test(missing_state_is_bridged_with_half_the_torque),
        cmocka_unit_test(every_fault_zeroes_in_its_tick_latches_and_clears),
        cmocka_unit_test(joint_that_rests_in_contact_is_no_fault),
        cmocka_unit_test(stuck_encoder_is_noticed_when_the_torque_swings),
        cmocka_unit_test(stuck_encoder_is_not_watched_when_told_so),
        cmocka_unit_test(drive_that_refuses_its_set_up_is_a_fault),
        cmocka_unit_test(second_host_is_noticed_before_a_word_is_sent),
        cmocka_unit_test(late_tick_in_idle_is_counted_and_no_fault),
        cmocka_unit_test(recording_runs_again_to_the_bit),
        cmocka_unit_test(re_run_notices_a_changed_bit_and_a_gap),
        cmocka_unit_test(record_holds_what_was_sent),
        cmocka_unit_test(init_refuses_bad_memory_and_configurations),
        cmocka_unit_test(every_bit_has_a_name),
    };
    return cmocka_run_group_tests(tests, build_image, free_image);
}
