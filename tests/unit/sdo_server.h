/* The SDO server of an obedient drive: keeps what is written, gives back what it keeps. Written from CiA 301 7.2.4.3 alone. */
#ifndef CRT_SDO_SERVER_H
#define CRT_SDO_SERVER_H

#include "servo.h"

#define CRT_SDO_OBJECTS_MAX 64

typedef struct {
    struct {
        uint32_t object, value; /* index << 8 | sub */
        uint8_t size;
    } kept[CRT_SDO_OBJECTS_MAX];
    uint32_t count;
} crt_sdo_server;

/* Purpose  a drive of the dictionary at power-on: its identity (0x1018), rated torque (0x6076) and limit (0x6072). */
void crt_sdo_start(crt_sdo_server *server, uint32_t axis);

/* Purpose  put a value in, as another make or a stubborn drive would have it. */
void crt_sdo_put(crt_sdo_server *server, uint16_t index, uint8_t sub, uint8_t size, uint32_t value);

/* Purpose  the answer to a request 0x611 + axis.   Output  a frame 0x591 + axis: done, the value, or abort 0x06020000. */
cr_frame crt_sdo_serve(crt_sdo_server *server, uint32_t axis, const cr_frame *request);

#endif
