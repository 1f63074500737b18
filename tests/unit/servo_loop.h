/* The servo in a loop with three drives and a mechanism of its own: a cube of 60 mm that a hand presses on a block. Shares nothing with the
 * simulator, nor with the packers of the firmware. */
#ifndef CRT_SERVO_LOOP_H
#define CRT_SERVO_LOOP_H

#include "sdo_server.h"
#include "servo/servo_stages.h"

enum { CRT_DRIVE_DISABLED, CRT_DRIVE_READY, CRT_DRIVE_ON, CRT_DRIVE_ENABLED, CRT_DRIVE_FAULTED };

typedef struct {
    int nmt; /* 0x7f, 0x05 */
    int state;
    uint16_t control;
    int16_t target, held; /* received; acting since the last SYNC */
    uint32_t beat, offset;
    int boot, mute, refuse_sdo, mute_heartbeat, stuck;
    int32_t counts; /* as last told */
    int32_t slide;  /* counts added */
    crt_sdo_server sdo;
} crt_loop_drive;

typedef struct {
    cr_servo *servo;
    void *memory;
    cr_servo_config config;
    crt_loop_drive drives[3];
    double pos[3], vel[3], target[3], hand_N_m; /* tip, world */
    int16_t wrist[3];
    int mute_wrist;
    uint64_t now_ns;
    uint32_t tick;
    cr_frame extra[24];
    uint32_t extra_count;
    uint64_t skip_ns; /* the next SYNC comes later by this */
    float period_s;
    int no_sync;
    uint32_t search[2], search_work; /* slices of the search between SYNC and tick, and after the tick; work of each */
    cr_tx tx;
    cr_record *records;
    uint32_t record_count, record_max;
} crt_loop;

/* Purpose  the scene of all loops, for cmocka_run_group_tests: built before the tests, freed after them. */
int crt_loop_build_scene(void **state);
int crt_loop_free_scene(void **state);
const cr_scene *crt_loop_scene(void);

/* Purpose  power-on, 20 mm above the wall; with late_max_ticks above 0, contact is searched for beside the ticks. */
crt_loop crt_loop_make(void);
crt_loop crt_loop_make_beside(uint32_t late_max_ticks);
void crt_loop_free(crt_loop *l);

/* Purpose  a period: SYNC, motion, what drives send, tick. Every torque that leaves is checked against its limit; the record is kept. */
void crt_loop_period(crt_loop *l);

uint32_t crt_loop_mode(const crt_loop *l);

/* Purpose  periods until that mode.   Output  0 when it is not reached in so many. */
int crt_loop_run_until(crt_loop *l, uint32_t wanted, uint32_t most);

/* Purpose  from power-on to pressing on the wall. */
void crt_loop_press(crt_loop *l);

/* Purpose  did the last period send torques of zero? */
int crt_loop_torque_is_zero(const crt_loop *l);

/* Purpose  a frame besides those of the drives in the next period, with its first two bytes. */
void crt_loop_add_extra(crt_loop *l, uint16_t id, uint8_t size, uint8_t first, uint8_t second);

#endif
