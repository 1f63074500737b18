#include "sdo_server.h"

#include <string.h>

void crt_sdo_put(crt_sdo_server *server, uint16_t index, uint8_t sub, uint8_t size, uint32_t value) {
    const uint32_t object = (uint32_t)index << 8 | sub;
    uint32_t at = 0u;
    while (at < server->count && server->kept[at].object != object) {
        at++;
    }
    at = at < CRT_SDO_OBJECTS_MAX ? at : CRT_SDO_OBJECTS_MAX - 1u;
    server->count = at < server->count ? server->count : at + 1u;
    server->kept[at].object = object;
    server->kept[at].value = value;
    server->kept[at].size = size;
}

void crt_sdo_start(crt_sdo_server *server, uint32_t axis) {
    static const uint32_t rated[3] = {10000u, 3600u, 3600u}, limit[3] = {2000u, 2500u, 2500u};
    memset(server, 0, sizeof *server);
    crt_sdo_put(server, 0x1018, 1, 4, 0u);
    crt_sdo_put(server, 0x1018, 2, 4, 0x402u);
    crt_sdo_put(server, 0x1018, 3, 4, 0x00010000u);
    crt_sdo_put(server, 0x6076, 0, 4, rated[axis]);
    crt_sdo_put(server, 0x6072, 0, 2, limit[axis]);
}

cr_frame crt_sdo_serve(crt_sdo_server *server, uint32_t axis, const cr_frame *request) {
    const uint8_t *d = request->data;
    const uint16_t index = (uint16_t)(d[1] | d[2] << 8);
    cr_frame answer = {(uint16_t)(0x591u + axis), 8u, 0u, {0x60, d[1], d[2], d[3], 0, 0, 0, 0}};
    if ((d[0] & 0xe0u) == 0x20u) {
        const uint32_t value = d[4] | (uint32_t)d[5] << 8 | (uint32_t)d[6] << 16 | (uint32_t)d[7] << 24;
        crt_sdo_put(server, index, d[3], (uint8_t)(4u - (d[0] >> 2 & 3u)), value);
        return answer;
    }
    for (uint32_t i = 0; i < server->count; i++) {
        if (server->kept[i].object == ((uint32_t)index << 8 | d[3])) {
            answer.data[0] = (uint8_t)(0x43u | (4u - server->kept[i].size) << 2);
            for (uint32_t k = 0; k < 4u; k++) {
                answer.data[4u + k] = (uint8_t)(server->kept[i].value >> 8u * k);
            }
            return answer;
        }
    }
    answer.data[0] = 0x80u; /* 0x06020000: no such object */
    answer.data[6] = 0x02u;
    answer.data[7] = 0x06u;
    return answer;
}
