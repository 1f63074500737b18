/* A servo, its drives and a mechanism: see the header. */
#include "servo_loop.h"
#include "image_builder.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000ull
#define LINK 0.45

static uint8_t *image;
static uint32_t image_bytes;
static cr_scene scene;

int crt_loop_build_scene(void **state) {
    (void)state;
    const crt_solid block = crt_box(-0.08, 0.08, 0.08, -0.05, 0.0);
    const double centre_m[3] = {0.0, 0.0, 0.0}, half_m[3] = {0.03, 0.03, 0.03};
    crt_tool cube = crt_tool_new(0.005);
    crt_add_box(&cube, centre_m, half_m);
    image = crt_image(&block, &cube, 0.004, &image_bytes);
    crt_tool_free(&cube);
    return cr_scene_open(&scene, image, image_bytes) == CR_OK ? 0 : -1;
}

int crt_loop_free_scene(void **state) {
    (void)state;
    free(image);
    return 0;
}

const cr_scene *crt_loop_scene(void) { return &scene; }

crt_loop crt_loop_make(void) { return crt_loop_make_beside(0u); }

crt_loop crt_loop_make_beside(uint32_t late_max_ticks) {
    crt_loop l;
    memset(&l, 0, sizeof l);
    l.config = cr_servo_config_default();
    l.config.world.stiffness_N_m = 500.0f;
    l.config.control.contact_damping_Ns_m = 2.0f;
    l.config.late_max_ticks = late_max_ticks;
    l.search[1] = 1u;
    l.search_work = 1u << 20;
    const size_t size = cr_servo_size(crt_loop_scene(), &l.config);
    assert_true(size > 0u);
    l.memory = aligned_alloc(64, (size + 63u) / 64u * 64u);
    assert_int_equal(cr_servo_init(&l.servo, l.memory, size, crt_loop_scene(), &l.config), CR_OK);
    for (uint32_t a = 0; a < 3u; a++) {
        l.drives[a] = (crt_loop_drive){.nmt = 0x7f, .offset = 7u * a, .boot = 1};
        crt_sdo_start(&l.drives[a].sdo, a);
    }
    l.pos[2] = l.target[2] = 0.05;
    l.hand_N_m = 400.0;
    l.now_ns = 1000u * MS;
    l.period_s = 1e-3f;
    l.record_max = 5000u;
    l.records = malloc(l.record_max * sizeof *l.records);
    return l;
}

void crt_loop_free(crt_loop *l) {
    free(l->memory);
    free(l->records);
}

static uint16_t status_of(const crt_loop_drive *d) {
    static const uint16_t words[] = {0x0240, 0x0221, 0x0223, 0x0227, 0x0208};
    return words[d->state];
}

static void hear(crt_loop *l, uint32_t axis, const cr_frame *f) {
    crt_loop_drive *d = &l->drives[axis];
    if (f->id == 0x000) {
        d->boot |= f->data[0] == 0x82;
        d->nmt = f->data[0] == 0x01 ? 0x05 : f->data[0] == 0x82 ? 0x7f : d->nmt;
        d->state = f->data[0] == 0x82 ? CRT_DRIVE_DISABLED : d->state;
    } else if (f->id == 0x611u + axis && d->refuse_sdo) {
        l->extra[l->extra_count++] = (cr_frame){
            (uint16_t)(0x591u + axis), 8u, 0u, {0x80, f->data[1], f->data[2], f->data[3], 0x22, 0x00, 0x00, 0x08}};
    } else if (f->id == 0x611u + axis) {
        l->extra[l->extra_count++] = crt_sdo_serve(&d->sdo, axis, f);
    } else if (f->id == 0x211u + axis && d->nmt == 0x05) {
        const uint16_t word = f->data[0];
        const int rising = (word & 0x80u) != 0u && (d->control & 0x80u) == 0u;
        d->control = word;
        if (d->state == CRT_DRIVE_FAULTED) {
            d->state = rising ? CRT_DRIVE_DISABLED : CRT_DRIVE_FAULTED;
        } else {
            d->state = word == 0x06                                  ? CRT_DRIVE_READY
                       : word == 0x07 && d->state >= CRT_DRIVE_READY ? CRT_DRIVE_ON
                       : word == 0x0f && d->state >= CRT_DRIVE_ON    ? CRT_DRIVE_ENABLED
                       : word == 0x00                                ? CRT_DRIVE_DISABLED
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

static void move(crt_loop *l) {
    static const double rated[3] = {10.0, 3.6, 3.6}, mass[3] = {5.4, 1.2, 1.2}, viscous[3] = {3.5, 1.5, 1.5};
    double q[3], tau[3], force[3];
    joints_of(l->pos, q);
    for (int a = 0; a < 3; a++) {
        crt_loop_drive *d = &l->drives[a];
        d->held = d->state == CRT_DRIVE_ENABLED && d->nmt == 0x05 ? d->target : 0;
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

static void put_state(crt_loop *l, uint32_t axis) {
    static const double step[3] = {60e-6, 40e-6 / LINK, 40e-6 / LINK};
    crt_loop_drive *d = &l->drives[axis];
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
static void put_wrist(crt_loop *l) {
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

static void drives_speak(crt_loop *l) {
    for (uint32_t a = 0; a < 3u; a++) {
        crt_loop_drive *d = &l->drives[a];
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

static void search(crt_loop *l, uint32_t slices) {
    for (uint32_t i = 0; i < slices; i++) {
        (void)cr_servo_search(l->servo, l->search_work);
    }
}

/* Finite is a matter of course with whole numbers, the limits are not. */
void crt_loop_period(crt_loop *l) {
    cr_tx sync = {0};
    l->now_ns += MS + l->skip_ns;
    l->skip_ns = 0u;
    if (!l->no_sync) {
        cr_servo_sync(l->servo, l->now_ns, &sync);
        move(l);
        drives_speak(l);
    }
    l->no_sync = 0;
    search(l, l->search[0]);
    cr_servo_tick(l->servo, l->now_ns + 400000u, l->period_s, &l->tx);
    search(l, l->search[1]);
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

uint32_t crt_loop_mode(const crt_loop *l) { return cr_servo_get_status(l->servo).mode; }

int crt_loop_run_until(crt_loop *l, uint32_t wanted, uint32_t most) {
    for (uint32_t k = 0; k < most && crt_loop_mode(l) != wanted; k++) {
        crt_loop_period(l);
    }
    return crt_loop_mode(l) == wanted;
}

void crt_loop_press(crt_loop *l) {
    assert_true(crt_loop_run_until(l, CR_MODE_IDLE, 3000u));
    cr_servo_input(l->servo, CR_COMMAND_START);
    crt_loop_period(l);
    assert_true(cr_mode_is_rendering(crt_loop_mode(l)));
    for (int k = 0; k < 600; k++) {
        l->target[2] = fmax(0.02, l->target[2] - 1e-4);
        crt_loop_period(l);
    }
    assert_true(cr_servo_get_record(l->servo)->area_count == 1u);
}

int crt_loop_torque_is_zero(const crt_loop *l) {
    static const uint8_t zero[6] = {0};
    return l->tx.count > 0u && l->tx.frames[0].id == 0x181 && memcmp(l->tx.frames[0].data, zero, 6) == 0;
}

void crt_loop_add_extra(crt_loop *l, uint16_t id, uint8_t size, uint8_t first, uint8_t second) {
    l->extra[l->extra_count++] = (cr_frame){id, size, 0u, {first, second}};
}
