/* The CANopen manager with drives that answer its SDOs, period by period and without a servo. */
#ifndef CRT_BUS_RIG_H
#define CRT_BUS_RIG_H

#include "sdo_server.h"
#include "servo/servo_stages.h"

typedef struct {
    cr_bus_config config;
    cr_bus bus;
    cr_servo_counters counters;
    cr_tx tx; /* what the end of the last period sent */
    uint64_t now_ns;
    int16_t target[CR_AXES];
    int off;
    uint32_t faults; /* of all periods */
    crt_sdo_server sdo[CR_AXES];
} crt_bus_rig;

/* Purpose  power-on. */
crt_bus_rig crt_bus_make(void);

/* Purpose  a frame that the host receives; the macro takes its bytes. */
void crt_bus_receive(crt_bus_rig *r, uint16_t id, uint8_t size, const uint8_t *data);
#define CRT_RECEIVE(r, id, ...)                                                                                        \
    crt_bus_receive(r, id, (uint8_t)sizeof((uint8_t[]){__VA_ARGS__}), (uint8_t[]){__VA_ARGS__})

/* Purpose  the end of a period and the SYNC of the next. */
void crt_bus_period(crt_bus_rig *r);

/* Purpose  the frame of that identifier that was sent.   Output  NULL: there was none. */
const cr_frame *crt_bus_sent(const crt_bus_rig *r, uint16_t id);
/* Purpose  was it sent, with these bytes? */
int crt_bus_is_sent(const crt_bus_rig *r, uint16_t id, uint8_t size, const uint8_t *data);
#define CRT_IS_SENT(r, id, ...)                                                                                        \
    crt_bus_is_sent(r, id, (uint8_t)sizeof((uint8_t[]){__VA_ARGS__}), (uint8_t[]){__VA_ARGS__})

/* Purpose  until the reset, and the boot-up messages of all drives. */
void crt_bus_boot_all(crt_bus_rig *r);

/* Purpose  what drives tell in a period: their states with this status word; the wrist. */
void crt_bus_send_states(crt_bus_rig *r, uint16_t status);
void crt_bus_send_wrist(crt_bus_rig *r);

/* Purpose  answers to every SDO until the set-up ends, or after `most` requests.   Output  requests[count], unless it is NULL; count. */
uint32_t crt_bus_answer_all(crt_bus_rig *r, cr_frame *requests, uint32_t most);

/* Purpose  from power-on to running. */
void crt_bus_run_all(crt_bus_rig *r);

#endif
