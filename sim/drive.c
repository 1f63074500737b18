/* State machine of CiA 402-2, 7.2; transitions by number in the comments. */
#include "drive.h"

#include <math.h>

enum { CW_SWITCH_ON = 1, CW_VOLTAGE = 2, CW_NO_QUICK_STOP = 4, CW_ENABLE = 8, CW_FAULT_RESET = 0x80 };
enum { SW_VOLTAGE = 0x10, SW_REMOTE = 0x200, SW_LIMIT = 0x800, SW_FOLLOWS = 0x1000 };
enum { MODE_CYCLIC_TORQUE = 10 };

static uint16_t statusword(const cr_drive *drive) {
    static const uint16_t bits[] = {0x00, 0x40, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x08};
    uint16_t word = (uint16_t)(bits[drive->state] | SW_REMOTE);
    if (drive->state >= CR_DRIVE_SWITCHED_ON && drive->state <= CR_DRIVE_QUICK_STOP) {
        word |= SW_VOLTAGE;
    }
    if (drive->limited && drive->state == CR_DRIVE_ENABLED) {
        word |= SW_LIMIT;
    }
    if (drive->state == CR_DRIVE_ENABLED && cr_node_get_signed(&drive->node, 0x6061, 0) == MODE_CYCLIC_TORQUE) {
        word |= SW_FOLLOWS;
    }
    return word;
}

static cr_drive_state enabled_by(cr_drive_state state, uint16_t command) {
    const uint16_t switch_on = CW_SWITCH_ON | CW_VOLTAGE | CW_NO_QUICK_STOP;
    const int on = (command & switch_on) == switch_on, enable = on && (command & CW_ENABLE) != 0;
    if (state == CR_DRIVE_READY && on) {
        return CR_DRIVE_SWITCHED_ON; /* 3 */
    }
    if (state == CR_DRIVE_SWITCHED_ON && enable) {
        return CR_DRIVE_ENABLED; /* 4 */
    }
    if (state == CR_DRIVE_ENABLED && on && !enable) {
        return CR_DRIVE_SWITCHED_ON; /* 5 */
    }
    return state == CR_DRIVE_QUICK_STOP && enable ? CR_DRIVE_ENABLED : state; /* 16 */
}

/* Where a controlword leads from a state that is neither fault nor not ready. */
static cr_drive_state commanded(cr_drive_state state, uint16_t command) {
    if ((command & CW_VOLTAGE) == 0) {
        return CR_DRIVE_SWITCH_ON_DISABLED; /* 7, 9, 10, 12 */
    }
    if ((command & CW_NO_QUICK_STOP) == 0) {
        if (state == CR_DRIVE_ENABLED || state == CR_DRIVE_QUICK_STOP) {
            return CR_DRIVE_QUICK_STOP; /* 11 */
        }
        return CR_DRIVE_SWITCH_ON_DISABLED; /* 7, 10 */
    }
    if ((command & CW_SWITCH_ON) == 0) {
        return state == CR_DRIVE_QUICK_STOP ? state : CR_DRIVE_READY; /* 2, 6, 8 */
    }
    return enabled_by(state, command);
}

static void reset_fault(cr_drive *drive) {
    drive->state = CR_DRIVE_SWITCH_ON_DISABLED; /* 15 */
    cr_node_set(&drive->node, 0x603F, 0, 0);
    cr_node_emcy(&drive->node, CR_EMCY_NONE, 0);
}

static void publish(cr_drive *drive) {
    cr_node *node = &drive->node;
    const int32_t target = cr_node_get_signed(node, 0x6071, 0);
    const int32_t most = (int32_t)cr_node_get(node, 0x6072, 0);
    drive->limited = target > most || target < -most;
    cr_node_set(node, 0x6074, 0, (uint32_t)cr_drive_torque(drive));
    cr_node_set(node, 0x6041, 0, statusword(drive));
}

/* What the frame or the SYNC just handled has changed. */
static void react(cr_drive *drive) {
    cr_node *node = &drive->node;
    const uint16_t command = (uint16_t)cr_node_get(node, 0x6040, 0);
    const int reset_edge = (command & CW_FAULT_RESET) != 0 && (drive->controlword & CW_FAULT_RESET) == 0;
    const int32_t mode = cr_node_get_signed(node, 0x6060, 0);
    drive->controlword = command;
    if (mode == MODE_CYCLIC_TORQUE || mode == 0) {
        cr_node_set(node, 0x6061, 0, (uint32_t)mode);
    }
    if (node->error != 0u) {
        const uint16_t error = node->error;
        node->error = 0;
        /* Torque frames may stop while no torque is given; the host may not. */
        if (error != CR_EMCY_RPDO_TIMEOUT || drive->state == CR_DRIVE_ENABLED) {
            cr_drive_fault(drive, error);
        }
    } else if (drive->state == CR_DRIVE_FAULT) {
        if (reset_edge) {
            reset_fault(drive);
        }
    } else if (drive->state != CR_DRIVE_FAULT_REACTION) {
        drive->state = commanded(drive->state, command);
    }
    if (node->nmt != CR_NMT_OPERATIONAL && drive->state == CR_DRIVE_ENABLED) {
        drive->state = CR_DRIVE_SWITCHED_ON; /* 5: without PDOs nobody steers */
    }
    publish(drive);
}

void cr_drive_init(cr_drive *drive, uint8_t axis, uint64_t now_us) {
    *drive = (cr_drive){.state = CR_DRIVE_SWITCH_ON_DISABLED}; /* 0, 1 */
    cr_node_init(&drive->node, axis, now_us);
    publish(drive);
}

int cr_drive_receive(cr_drive *drive, const cr_sim_frame *frame, uint64_t now_us) {
    cr_node *node = &drive->node;
    const int ours = cr_node_receive(node, frame, now_us);
    if (ours && frame->id == 0u && (frame->data[0] == 0x81u || frame->data[0] == 0x82u)) {
        drive->state = CR_DRIVE_SWITCH_ON_DISABLED;
        drive->controlword = 0;
        drive->sampled = 0;
        cr_node_set(node, 0x6040, 0, 0);
        cr_node_set(node, 0x6071, 0, 0);
        cr_node_set(node, 0x603F, 0, 0);
    }
    react(drive);
    return ours;
}

void cr_drive_sync(cr_drive *drive, int32_t counts, double torque_permille, double period_s, uint64_t now_us) {
    cr_node *node = &drive->node;
    const double rate = drive->sampled ? ((double)counts - (double)drive->counts) / period_s : 0.0;
    drive->counts = counts;
    drive->sampled = 1;
    cr_node_set(node, 0x6064, 0, (uint32_t)counts);
    cr_node_set(node, 0x606C, 0, (uint32_t)(int32_t)fmax(fmin(rate, 2e9), -2e9));
    cr_node_set(node, 0x6077, 0, (uint32_t)(int32_t)lround(fmax(fmin(torque_permille, 32767.0), -32768.0)));
    if (drive->state == CR_DRIVE_FAULT_REACTION) {
        drive->state = CR_DRIVE_FAULT; /* 14 */
    }
    publish(drive);
    cr_node_sync(node, now_us);
    react(drive);
}

void cr_drive_poll(cr_drive *drive, uint64_t now_us) {
    cr_node_poll(&drive->node, now_us);
    if (drive->node.error != 0u) {
        react(drive);
        cr_node_poll(&drive->node, now_us);
    } else if (drive->state == CR_DRIVE_FAULT_REACTION) {
        drive->state = CR_DRIVE_FAULT; /* 14 */
        publish(drive);
    }
}

/* Error register, 7.5.2.2: generic, and the group of the code. */
static uint8_t register_of(uint16_t code) {
    switch (code >> 12) {
    case 2:
        return 0x03;
    case 3:
        return 0x05;
    case 4:
        return 0x09;
    case 8:
        return 0x11;
    default:
        return 0x01;
    }
}

void cr_drive_fault(cr_drive *drive, uint16_t error_code) {
    if (drive->state != CR_DRIVE_FAULT && drive->state != CR_DRIVE_FAULT_REACTION) {
        drive->state = CR_DRIVE_FAULT_REACTION; /* 13 */
    }
    cr_node_set(&drive->node, 0x603F, 0, error_code);
    cr_node_set(&drive->node, 0x6071, 0, 0);
    cr_node_emcy(&drive->node, error_code, register_of(error_code));
    publish(drive);
}

int16_t cr_drive_torque(const cr_drive *drive) {
    const cr_node *node = &drive->node;
    const int32_t most = (int32_t)cr_node_get(node, 0x6072, 0);
    const int32_t target = cr_node_get_signed(node, 0x6071, 0);
    if (drive->state != CR_DRIVE_ENABLED || node->nmt != CR_NMT_OPERATIONAL ||
        cr_node_get_signed(node, 0x6061, 0) != MODE_CYCLIC_TORQUE) {
        return 0;
    }
    return (int16_t)(target > most ? most : target < -most ? -most : target);
}
