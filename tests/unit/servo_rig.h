/* A servo with three obedient drives and no mechanism: tests and fuzz targets move the encoders as they like. */
#ifndef CRT_SERVO_RIG_H
#define CRT_SERVO_RIG_H

#include "sdo_server.h"
#include "servo/servo_stages.h"

#define CRT_RECORDS_MAX 512
#define CRT_SEARCH_WHOLE (1u << 20)

typedef struct {
    int operational, boot;
    int mute; /* 1: its states are lost */
    uint16_t control, status;
    int32_t counts;
    crt_sdo_server sdo;
    cr_frame answer; /* to the last SDO; size 0: none */
} crt_drive;

typedef struct {
    cr_servo *servo;
    void *memory;
    size_t memory_bytes;
    crt_drive drives[CR_AXES];
    int16_t wrist[3]; /* counts; drive Z tells them with every second SYNC */
    uint64_t now_ns;
    uint32_t tick, was_mode, inputs; /* of the tick to come */
    uint32_t search_work;            /* after each tick, where contact is searched for beside the ticks; 0: none */
    cr_tx tx;
    uint32_t record_count;
    cr_record records[CRT_RECORDS_MAX];
} crt_servo_rig;

/* Purpose  the scene of all of them: a plate 0.5 mm deep in a block, at the posture where the drives begin. */
const cr_scene *crt_plate_scene(void);

/* Purpose  power-on.   Output  0 when the configuration is refused. */
int crt_servo_start(crt_servo_rig *rig, const cr_servo_config *config);
void crt_servo_stop(crt_servo_rig *rig);

/* Purpose  a period as it should be, period_ns after the last: SYNC, states, heartbeats and answers, tick. */
void crt_servo_period(crt_servo_rig *rig, uint64_t period_ns);
/* Purpose  its parts: what the drives send; the tick, with everything that must hold after it. */
void crt_drives_speak(crt_servo_rig *rig);
void crt_servo_tick(crt_servo_rig *rig, uint64_t now_ns, float period_s);
/* Purpose  input bits of the next tick. */
void crt_servo_input(crt_servo_rig *rig, uint32_t bits);

/* Purpose  from power-on to rendering in contact.   Output  0 when that is not reached in so many periods. */
int crt_servo_bring_up(crt_servo_rig *rig, uint64_t period_ns, uint32_t periods_max);

/* Purpose  what must hold of any record, whatever came before.   Output  aborts when it does not. */
void crt_check_record(const cr_servo_config *config, const cr_record *record);

#endif
