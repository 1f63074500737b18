/* QEMU plugin (plugin API 1): instructions of each tick, by stage and by function. The same number in every run.
 *
 *     qemu-system-arm ... -plugin count.so,out=FILE
 *
 * Counts every instruction executed; one that a condition skips counts too. FILE gets
 *     tick I TOTAL STAGE...                one line a tick; stages in the order of the line `stages`
 *     fn TOTAL WORST NAME                  instructions of a function in all ticks, and in the most expensive one
 *
 * A stage begins when its function is entered, and ends when a function that calls stages goes on. Functions that are not named below
 * belong to the stage that runs. */
#include "plugin.h"

enum { OUTSIDE, TICK, DETECT, RELATE, DEPTH, RESOLVE, FEEL, SERVO, COUPLE, STAGE_COUNT };
static const char *const stage_names[STAGE_COUNT] = {"outside", "tick", "detect", "relate", "depth",
                                                     "resolve", "feel", "servo",  "couple"};

/* Functions that set the stage: at their first instruction, or wherever they run because stages return into them. */
static const struct {
    const char *name;
    int stage, everywhere;
} marks[] = {{"job_tick", OUTSIDE, 1},         {"main", OUTSIDE, 1},
             {"cr_servo_rerun", OUTSIDE, 1},   {"device_tick_end", OUTSIDE, 0},
             {"job_hash", OUTSIDE, 0},         {"cr_tick", TICK, 1},
             {"cr_motion_advance", DETECT, 0}, {"cr_detect", DETECT, 0},
             {"cr_way_measure", DEPTH, 1},     {"cr_way_relate", RELATE, 0},
             {"cr_way_lead", RELATE, 0},       {"cr_way_join", RELATE, 0},
             {"cr_way_turn", RELATE, 0},       {"cr_way_agree", RELATE, 0},
             {"cr_way_share_arm", RELATE, 0},  {"cr_way_push", RESOLVE, 0},
             {"cr_search_slice", TICK, 1},     {"cr_feel", FEEL, 1},
             {"cr_search", TICK, 1},           {"cr_accept", FEEL, 0},
             {"cr_render", FEEL, 0},           {"cr_servo_tick", SERVO, 1},
             {"cr_servo_sync", SERVO, 0},      {"cr_servo_rx", SERVO, 0},
             {"cr_couple_tick", COUPLE, 0},    {"cr_way_tell_counts", RELATE, 0}};

typedef struct {
    char name[64];
    uint64_t count, before, worst;
} function;

#define FUNCTIONS_MAX 2048
static function functions[FUNCTIONS_MAX];
static size_t function_count;
static uint64_t now, since, in_stage[STAGE_COUNT], ticks, most;
static int stage = OUTSIDE;
static FILE *out;

static function *find_function(const char *name) {
    for (size_t i = 0; i < function_count; i++) {
        if (strcmp(functions[i].name, name) == 0) {
            return &functions[i];
        }
    }
    if (function_count == FUNCTIONS_MAX) {
        fprintf(stderr, "count: more than %d functions\n", FUNCTIONS_MAX);
        exit(1);
    }
    function *f = &functions[function_count++];
    snprintf(f->name, sizeof f->name, "%s", name);
    return f;
}

static void change_stage(unsigned cpu, void *user) {
    (void)cpu;
    in_stage[stage] += now - since;
    since = now;
    stage = (int)(intptr_t)user;
}

static void end_tick(unsigned cpu, void *user) {
    change_stage(cpu, user);
    uint64_t total = 0u;
    for (int s = OUTSIDE + 1; s < STAGE_COUNT; s++) {
        total += in_stage[s];
    }
    fprintf(out, "tick %" PRIu64 " %" PRIu64, ticks++, total);
    for (int s = OUTSIDE + 1; s < STAGE_COUNT; s++) {
        fprintf(out, " %" PRIu64, in_stage[s]);
    }
    fprintf(out, "\n");
    for (size_t i = 0; i < function_count; i++) {
        functions[i].worst = total > most ? functions[i].count - functions[i].before : functions[i].worst;
        functions[i].before = functions[i].count;
    }
    most = total > most ? total : most;
    memset(in_stage, 0, sizeof in_stage);
}

static void translated(plugin_id id, struct block *block) {
    (void)id;
    const struct instruction *first = qemu_plugin_tb_get_insn(block, 0);
    const char *name = qemu_plugin_insn_symbol(first);
    name = name != NULL && *name != '\0' ? name : "?";
    /* A function's first block to be translated is its entry: nothing jumps into its middle before. */
    static struct {
        const char *name;
        uint64_t entry;
    } entries[sizeof marks / sizeof *marks];
    const uint64_t at = qemu_plugin_insn_vaddr(first);
    for (size_t i = 0; i < sizeof marks / sizeof *marks; i++) {
        if (strcmp(marks[i].name, name) != 0) {
            continue;
        }
        if (entries[i].name == NULL) {
            entries[i].name = marks[i].name;
            entries[i].entry = at;
        }
        if (marks[i].everywhere || entries[i].entry == at) {
            void (*run)(unsigned, void *) = strcmp(name, "device_tick_end") == 0 ? end_tick : change_stage;
            qemu_plugin_register_vcpu_tb_exec_cb(block, run, NO_REGISTERS, (void *)(intptr_t)marks[i].stage);
        }
    }
    const uint64_t size = qemu_plugin_tb_n_insns(block);
    qemu_plugin_register_vcpu_tb_exec_inline(block, INLINE_ADD, &now, size);
    qemu_plugin_register_vcpu_tb_exec_inline(block, INLINE_ADD, &find_function(name)->count, size);
}

static int more_in_worst(const void *a, const void *b) {
    const function *x = a, *y = b;
    return (x->worst < y->worst) - (x->worst > y->worst);
}

static void finish(plugin_id id, void *user) {
    (void)id;
    (void)user;
    qsort(functions, function_count, sizeof *functions, more_in_worst);
    for (size_t i = 0; i < function_count; i++) {
        fprintf(out, "fn %" PRIu64 " %" PRIu64 " %s\n", functions[i].count, functions[i].worst, functions[i].name);
    }
    fclose(out);
}

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv) {
    (void)info;
    out = plugin_open(argc, argv);
    if (out == NULL) {
        return -1;
    }
    fprintf(out, "stages");
    for (int s = OUTSIDE + 1; s < STAGE_COUNT; s++) {
        fprintf(out, " %s", stage_names[s]);
    }
    fprintf(out, "\n");
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
