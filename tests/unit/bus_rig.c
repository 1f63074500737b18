/* The manager of the bus without a bus: see the header. */
#include "bus_rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <cmocka.h>

#define MS 1000000ull

crt_bus_rig crt_bus_make(void) {
    crt_bus_rig r;
    memset(&r, 0, sizeof r);
    r.config = cr_servo_config_default().bus;
    r.now_ns = 5u * MS;
    cr_bus_reset(&r.bus, cr_servo_config_default().axis);
    for (uint32_t a = 0; a < CR_AXES; a++) {
        crt_sdo_start(&r.sdo[a], a);
    }
    return r;
}

void crt_bus_receive(crt_bus_rig *r, uint16_t id, uint8_t size, const uint8_t *data) {
    cr_frame frame = {id, size, 0u, {0}};
    memcpy(frame.data, data, size);
    cr_bus_receive(&r->config, &r->bus, &frame, r->now_ns, &r->counters);
}

void crt_bus_period(crt_bus_rig *r) {
    cr_tx sync = {0};
    r->tx.count = 0u;
    cr_bus_check(&r->config, &r->bus, r->now_ns, &r->counters);
    r->faults |= r->bus.faults;
    r->off |= r->bus.faults != 0u;
    r->bus.faults = 0u;
    cr_bus_transmit(&r->config, &r->bus, r->target, r->off, r->now_ns, &r->counters, &r->tx);
    r->now_ns += MS;
    cr_bus_sync(&r->bus, &sync);
}

const cr_frame *crt_bus_sent(const crt_bus_rig *r, uint16_t id) {
    for (uint32_t i = 0; i < r->tx.count; i++) {
        if (r->tx.frames[i].id == id) {
            return &r->tx.frames[i];
        }
    }
    return NULL;
}

int crt_bus_is_sent(const crt_bus_rig *r, uint16_t id, uint8_t size, const uint8_t *data) {
    const cr_frame *frame = crt_bus_sent(r, id);
    return frame != NULL && frame->size == size && memcmp(frame->data, data, size) == 0;
}

void crt_bus_boot_all(crt_bus_rig *r) {
    while (r->bus.phase != CR_PHASE_RESET) {
        crt_bus_period(r);
    }
    CRT_RECEIVE(r, 0x711, 0x00);
    CRT_RECEIVE(r, 0x712, 0x00);
    CRT_RECEIVE(r, 0x713, 0x00);
}

void crt_bus_send_states(crt_bus_rig *r, uint16_t status) {
    for (uint16_t a = 0; a < 3u; a++) {
        CRT_RECEIVE(r, (uint16_t)(0x191 + a), 0x10, 0, 0, 0, 0, 0, (uint8_t)(status & 0xffu), (uint8_t)(status >> 8));
    }
}

void crt_bus_send_wrist(crt_bus_rig *r) { CRT_RECEIVE(r, 0x194, 0x01, 0x00, 0xfe, 0xff, 0x10, 0x0e); }

uint32_t crt_bus_answer_all(crt_bus_rig *r, cr_frame *requests, uint32_t most) {
    uint32_t count = 0u;
    while (r->bus.phase <= CR_PHASE_SET_UP && count < most) {
        crt_bus_period(r);
        for (uint32_t i = 0; i < r->tx.count; i++) {
            const cr_frame *f = &r->tx.frames[i];
            if ((f->id & 0x780u) == 0x600u) {
                if (requests != NULL) {
                    requests[count] = *f;
                }
                count++;
                const cr_frame answer = crt_sdo_serve(&r->sdo[f->id - 0x611u], f->id - 0x611u, f);
                crt_bus_receive(r, answer.id, 8u, answer.data);
            }
        }
    }
    return count;
}

void crt_bus_run_all(crt_bus_rig *r) {
    crt_bus_boot_all(r);
    crt_bus_answer_all(r, NULL, 1000u);
    assert_int_equal(r->bus.phase, CR_PHASE_ENABLE);
    for (int k = 0; k < 3; k++) {
        crt_bus_send_states(r, 0x0627);
        crt_bus_send_wrist(r);
        crt_bus_period(r);
    }
    assert_int_equal(r->bus.phase, CR_PHASE_RUN);
    assert_int_equal(r->faults, 0);
}
