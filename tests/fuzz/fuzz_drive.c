/* The simulated drives: any frames, at any time. Torque stays within 0x6072 and is zero unless enabled; what is sent is CAN. */
#include "drive.h"
#include "fuzz.h"

#define HOST_IDS 12

static void check(cr_drive *drive) {
    const int32_t most = (int32_t)(cr_node_get(&drive->node, 0x6072, 0) & 0xffffu);
    const int32_t torque = cr_drive_torque(drive);
    HOLDS(torque <= most && torque >= -most);
    HOLDS(torque == 0 || (drive->state == CR_DRIVE_ENABLED && drive->node.nmt == CR_NMT_OPERATIONAL));
    HOLDS(drive->node.out_count <= CR_OUTBOX_MAX && drive->node.emcy_count <= CR_EMCY_MAX);
    for (uint32_t i = 0; i < drive->node.out_count; i++) {
        HOLDS(drive->node.out[i].id <= 0x7ffu && drive->node.out[i].len <= 8u);
    }
    drive->node.out_count = 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const uint16_t ids[HOST_IDS] = {0x000, 0x080, 0x181, 0x211, 0x212, 0x213,
                                           0x311, 0x611, 0x612, 0x613, 0x701, 0x7ff};
    uint64_t now_us = 0u;
    cr_drive drive;
    cr_drive_init(&drive, size > 0u ? data[0] % CR_SIM_AXES : 0u, now_us);
    check(&drive);
    for (size_t at = 1; at + 12u <= size; at += 12u) {
        const uint8_t *d = data + at;
        cr_sim_frame frame = {.id = d[0] < 0xf0u ? ids[d[0] % HOST_IDS] : (uint32_t)(d[0] << 8 | d[1]) & 0x7ffu,
                              .len = (uint8_t)(d[1] % 9u)};
        memcpy(frame.data, d + 4, 8u);
        now_us += (uint64_t)d[2] * d[2] * (d[3] & 15u);
        if (frame.id == 0x080u) {
            const int32_t counts =
                (int32_t)((uint32_t)d[4] | (uint32_t)d[5] << 8 | (uint32_t)d[6] << 16 | (uint32_t)d[7] << 24);
            cr_drive_sync(&drive, counts, (double)(int8_t)d[8] * 20.0, 1e-3, now_us);
        } else {
            (void)cr_drive_receive(&drive, &frame, now_us);
        }
        if ((d[3] & 0x80u) != 0u) {
            cr_drive_poll(&drive, now_us);
        }
        check(&drive);
    }
    return 0;
}
