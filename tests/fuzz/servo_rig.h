/* A servo with three obedient drives and no mechanism: the fuzz targets move the encoders as they like. */
#ifndef CRF_SERVO_RIG_H
#define CRF_SERVO_RIG_H

#include "servo_stages.h"

#define CRF_RECORDS_MAX 512

typedef struct {
    int operational, boot;
    uint16_t control, status;
    int32_t counts;
    cr_frame answer; /* to the last SDO; size 0: none */
} crf_drive;

typedef struct {
    cr_servo *servo;
    void *memory;
    size_t memory_bytes;
    crf_drive drives[CR_AXES];
    uint64_t now_ns;
    uint32_t tick, was_mode, inputs; /* of the tick to come */
    cr_tx tx;
    uint32_t record_count;
    cr_record records[CRF_RECORDS_MAX];
} crf_rig;

/* Purpose  the scene of all of them: a plate 0.5 mm deep in a block, at the posture where the drives begin. */
const cr_scene *crf_scene(void);

/* Purpose  power-on.   Output  0 when the configuration is refused. */
int crf_start(crf_rig *rig, const cr_servo_config *config);
void crf_stop(crf_rig *rig);

/* Purpose  a period as it should be, period_ns after the last: SYNC, states, heartbeats and answers, tick. */
void crf_period(crf_rig *rig, uint64_t period_ns);
/* Purpose  its parts: what the drives send; the tick, with everything that must hold after it. */
void crf_drives_speak(crf_rig *rig);
void crf_tick(crf_rig *rig, uint64_t now_ns, float period_s);
/* Purpose  input bits of the next tick. */
void crf_input(crf_rig *rig, uint32_t bits);

/* Purpose  from power-on to rendering in contact.   Output  0 when that is not reached in so many periods. */
int crf_bring_up(crf_rig *rig, uint64_t period_ns, uint32_t periods_max);

/* Purpose  what must hold of any record, whatever came before.   Output  aborts when it does not. */
void crf_check_record(const cr_servo_config *config, const cr_record *record);

#endif
