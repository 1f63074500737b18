/* The servo among obedient drives: see the header. */
#include "servo_rig.h"

#include "../check/holds.h"
#include "image_builder.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

const cr_scene *crt_plate_scene(void) {
    static cr_scene scene;
    if (scene.meta == NULL) {
        const crt_solid block = crt_box(-0.016, 0.016, 0.016, -0.02, 5e-4);
        uint32_t bytes = 0u;
        crt_tool plate = crt_plate();
        const uint8_t *image = crt_image(&block, &plate, 0.004, &bytes);
        HOLDS(cr_scene_open(&scene, image, bytes) == CR_OK);
        crt_tool_free(&plate);
    }
    return &scene;
}

int crt_servo_start(crt_servo_rig *rig, const cr_servo_config *config) {
    memset(rig, 0, sizeof *rig);
    rig->memory_bytes = cr_servo_size(crt_plate_scene(), config);
    if (rig->memory_bytes == 0u) {
        return 0;
    }
    rig->memory = aligned_alloc(64, rig->memory_bytes);
    HOLDS(rig->memory != NULL);
    HOLDS(cr_servo_init(&rig->servo, rig->memory, rig->memory_bytes, crt_plate_scene(), config) == CR_OK);
    for (int a = 0; a < CR_AXES; a++) {
        const cr_axis_config *x = &config->axis[a];
        static const float rest[CR_AXES] = {0.0f, 0.78539816f, -0.78539816f};
        rig->drives[a].boot = 1;
        crt_sdo_start(&rig->drives[a].sdo, (uint32_t)a);
        crt_sdo_put(&rig->drives[a].sdo, 0x6076, 0, 4, (uint32_t)(x->rated * 1000.0f + 0.5f));
        crt_sdo_put(&rig->drives[a].sdo, 0x6072, 0, 2, 32767u);
        rig->drives[a].status = 0x0240u;
        rig->drives[a].counts = (int32_t)fminf(fmaxf((rest[a] - x->offset) / x->step, -2e9f), 2e9f);
    }
    rig->now_ns = 1000000000u;
    rig->search_work = CRT_SEARCH_WHOLE;
    return 1;
}

void crt_servo_stop(crt_servo_rig *rig) { free(rig->memory); }

void crt_servo_input(crt_servo_rig *rig, uint32_t bits) {
    rig->inputs |= bits;
    cr_servo_input(rig->servo, bits);
}

/* ---- the drives -------------------------------------------------------------------------------------------------- */

static uint16_t status_after(uint16_t status, uint16_t control) {
    switch (control) {
    case 0x06:
        return 0x0221u;
    case 0x07:
        return status == 0x0240u ? status : 0x0223u;
    case 0x0f:
        return status == 0x0223u || status == 0x0227u ? 0x0227u : status;
    default:
        return 0x0240u;
    }
}

static void hear(crt_drive *d, uint32_t axis, const cr_frame *f) {
    if (f->id == 0x000u) {
        d->operational = f->data[0] == 0x01u;
        d->boot = f->data[0] == 0x82u;
        d->status = d->boot ? 0x0240u : d->status;
    } else if (f->id == 0x611u + axis) {
        d->answer = crt_sdo_serve(&d->sdo, axis, f);
    } else if (f->id == 0x211u + axis && d->operational) {
        d->control = (uint16_t)(f->data[0] | f->data[1] << 8);
        d->status = status_after(d->status, d->control);
    }
}

static void speak(crt_servo_rig *rig, uint32_t axis) {
    crt_drive *d = &rig->drives[axis];
    if (d->operational && !d->mute) {
        cr_frame state = {(uint16_t)(0x191u + axis), 8u, 0u, {0}};
        for (int k = 0; k < 4; k++) {
            state.data[k] = (uint8_t)((uint32_t)d->counts >> 8 * k);
        }
        state.data[6] = (uint8_t)d->status;
        state.data[7] = (uint8_t)(d->status >> 8);
        cr_servo_rx(rig->servo, &state);
    }
    if (d->operational && axis == 2u && rig->tick % 2u == 0u) {
        cr_frame wrist = {0x194u, 6u, 0u, {0}};
        for (int k = 0; k < 3; k++) {
            wrist.data[2 * k] = (uint8_t)((uint16_t)rig->wrist[k] & 0xffu);
            wrist.data[2 * k + 1] = (uint8_t)((uint16_t)rig->wrist[k] >> 8);
        }
        cr_servo_rx(rig->servo, &wrist);
    }
    if (d->answer.size > 0u) {
        cr_servo_rx(rig->servo, &d->answer);
        d->answer.size = 0u;
    }
    if (d->boot || rig->tick % 8u == axis) {
        const cr_frame beat = {(uint16_t)(0x711u + axis),
                               1u,
                               0u,
                               {(uint8_t)(d->boot          ? 0x00
                                          : d->operational ? 0x05
                                                           : 0x7f)}};
        cr_servo_rx(rig->servo, &beat);
        d->boot = 0;
    }
}

void crt_drives_speak(crt_servo_rig *rig) {
    for (uint32_t a = 0; a < CR_AXES; a++) {
        speak(rig, a);
    }
}

/* ---- what must hold ---------------------------------------------------------------------------------------------- */

static void check_vector(cr_vec3 v) { HOLDS(isfinite(v.x) && isfinite(v.y) && isfinite(v.z)); }

void crt_check_record(const cr_servo_config *config, const cr_record *r) {
    const int rendering = r->mode == CR_MODE_RENDERING || r->mode == CR_MODE_LIMITED;
    HOLDS(r->mode < CR_MODE_COUNT && (r->faults != 0u) == (r->mode == CR_MODE_FAULT));
    HOLDS((r->mode == CR_MODE_LIMITED) == (r->limits != 0u));
    for (int a = 0; a < CR_AXES; a++) {
        const cr_axis_config *x = &config->axis[a];
        HOLDS(isfinite(r->torque[a]) && fabsf(r->torque[a]) <= x->torque_max * 1.00001f);
        HOLDS((double)abs(r->target[a]) <= (double)x->torque_max / (double)x->rated * 1000.0 * 1.000001);
        HOLDS(rendering || (r->target[a] == 0 && r->torque[a] == 0.0f));
        HOLDS(isfinite(r->joints.joint[a]) && isfinite(r->joints.wrist_rad[a]));
    }
    check_vector(r->force_world_N);
    check_vector(r->contact_force_world_N);
    check_vector(r->contact_torque_world_Nm);
    check_vector(r->velocity_world_m_s);
    check_vector(r->world_from_tool.pos_m);
    const cr_quat q = r->world_from_tool.rot;
    HOLDS(isfinite(q.w) && isfinite(q.x) && isfinite(q.y) && isfinite(q.z));
    const uint32_t late_max = config->late_max_ticks, late = r->contact_late_ticks;
    HOLDS(late_max == 0u || late == CR_NOT_FELT || late <= late_max + 1u);
    HOLDS(late_max == 0u || late <= late_max || v3_norm(r->contact_force_world_N) == 0.0f);
    HOLDS(isfinite(r->energy_J) && isfinite(r->depth_m) && isfinite(r->margin));
    HOLDS(sqrtf(v3_dot(r->force_world_N, r->force_world_N)) <=
          2.0f * (config->control.force_max_N + config->control.passivity_damping_max_Ns_m * 1e3f) * 1e6f);
}

static void check_frames(const crt_servo_rig *rig, const cr_record *r) {
    HOLDS(rig->tx.count <= CR_TX_MAX);
    for (uint32_t i = 0; i < rig->tx.count; i++) {
        HOLDS(rig->tx.frames[i].id <= 0x7ffu && rig->tx.frames[i].size <= 8u);
    }
    if (rig->tx.count > 0u) {
        const cr_frame *torque = &rig->tx.frames[0];
        HOLDS(torque->id == 0x181u && torque->size == 6u);
        for (int a = 0; a < CR_AXES; a++) {
            HOLDS((int16_t)(torque->data[2 * a] | torque->data[2 * a + 1] << 8) == r->target[a]);
        }
    }
}

void crt_servo_tick(crt_servo_rig *rig, uint64_t now_ns, float period_s) {
    cr_servo_tick(rig->servo, now_ns, period_s, &rig->tx);
    const cr_record *r = cr_servo_get_record(rig->servo);
    const cr_servo_status status = cr_servo_get_status(rig->servo);
    crt_check_record(&rig->servo->config, r);
    check_frames(rig, r);
    HOLDS(status.mode == r->mode && status.faults == r->faults);
    HOLDS(rig->was_mode != CR_MODE_FAULT || r->mode == CR_MODE_FAULT || (rig->inputs & CR_COMMAND_CLEAR) != 0u);
    if (rig->record_count < CRT_RECORDS_MAX) {
        rig->records[rig->record_count++] = *r;
    }
    rig->was_mode = r->mode;
    rig->inputs = 0u;
    if (rig->search_work > 0u) {
        (void)cr_servo_search(rig->servo, rig->search_work);
    }
    rig->tick++;
    for (uint32_t i = 0; i < rig->tx.count; i++) {
        for (uint32_t a = 0; a < CR_AXES; a++) {
            hear(&rig->drives[a], a, &rig->tx.frames[i]);
        }
    }
}

void crt_servo_period(crt_servo_rig *rig, uint64_t period_ns) {
    cr_tx sync;
    rig->now_ns += period_ns;
    cr_servo_sync(rig->servo, rig->now_ns, &sync);
    crt_drives_speak(rig);
    crt_servo_tick(rig, rig->now_ns + period_ns / 3u, (float)period_ns * 1e-9f);
}

int crt_servo_bring_up(crt_servo_rig *rig, uint64_t period_ns, uint32_t periods_max) {
    for (uint32_t k = 0; k < periods_max; k++) {
        crt_servo_period(rig, period_ns);
        if (rig->was_mode == CR_MODE_IDLE) {
            crt_servo_input(rig, CR_COMMAND_START);
        } else if (cr_mode_is_rendering(rig->was_mode) && cr_servo_get_record(rig->servo)->area_count > 0u) {
            return 1;
        }
    }
    return 0;
}
