#include "fault.h"

#include <string.h>

int cr_fault_set(cr_fault_table *table, const cr_sim_fault *rows, size_t count) {
    if (count > CR_SIM_FAULTS_MAX) {
        return -1;
    }
    for (size_t i = 0; i < count; i++) {
        const cr_sim_fault *row = &rows[i];
        if (row->kind == CR_SIM_FAULT_NONE || row->kind >= CR_SIM_FAULT_COUNT || row->direction > CR_SIM_TO_DRIVES ||
            (row->axis >= CR_SIM_AXES && row->axis != CR_SIM_ANY_AXIS) || row->id > 0x7FFu) {
            return -1;
        }
    }
    table->count = (uint32_t)count;
    if (count > 0u) {
        memcpy(table->rows, rows, count * sizeof *rows);
    }
    return 0;
}

static int acts(const cr_sim_fault *row, uint32_t tick, uint32_t axis) {
    const uint32_t ticks = row->ticks > 0u ? row->ticks : 1u;
    return tick >= row->tick && tick - row->tick < ticks && (row->axis == axis || row->axis == CR_SIM_ANY_AXIS);
}

static void corrupt(cr_sim_frame *frame, int32_t value, cr_fault_fate *fate) {
    if (frame->len == 0u) {
        fate->copies = 0u;
    } else {
        const uint32_t byte = (uint32_t)value >> 8 & 7u;
        frame->data[byte % frame->len] ^= (uint8_t)value;
    }
}

cr_fault_fate cr_fault_pass(cr_fault_table *table, uint32_t tick, uint32_t axis, uint32_t direction,
                            cr_sim_frame *frame) {
    cr_fault_fate fate = {.copies = 1};
    for (uint32_t i = 0; i < table->count; i++) {
        const cr_sim_fault *row = &table->rows[i];
        if (row->kind > CR_SIM_FAULT_CORRUPT || row->id != frame->id || row->direction != direction ||
            !acts(row, tick, axis)) {
            continue;
        }
        table->done++;
        switch (row->kind) {
        case CR_SIM_FAULT_DROP:
            fate.copies = 0;
            break;
        case CR_SIM_FAULT_DELAY:
            fate.delay_ticks = row->value > 0 ? (uint32_t)row->value : 0u;
            break;
        case CR_SIM_FAULT_DUPLICATE:
            fate.copies = 2;
            break;
        case CR_SIM_FAULT_REORDER:
            fate.late = 1;
            break;
        default:
            corrupt(frame, row->value, &fate);
            break;
        }
    }
    return fate;
}

const cr_sim_fault *cr_fault_find(cr_fault_table *table, uint32_t tick, uint32_t axis, cr_sim_fault_kind kind) {
    for (uint32_t i = 0; i < table->count; i++) {
        if (table->rows[i].kind == (uint32_t)kind && acts(&table->rows[i], tick, axis)) {
            table->done++;
            return &table->rows[i];
        }
    }
    return NULL;
}
