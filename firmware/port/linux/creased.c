/* creased: the servo on a Linux machine with SocketCAN. One real-time loop; one thread for the file, the commands and the text.
 *
 * Exit status  0 stopped as asked; 1 the record could not be written; 2 wrong command line, configuration or scene; 3 the bus cannot
 *              be reached, or not all drives answered; 4 stopped in fault. */
#define _GNU_SOURCE /* NOLINT: getopt_long */
#include "can.h"
#include "device.h"

#include <errno.h>
#include <getopt.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

enum { EXIT_DONE = 0, EXIT_RECORD = 1, EXIT_USAGE = 2, EXIT_BUS = 3, EXIT_FAULT = 4 };

#define ALIGN 64u
#define RING_RECORDS 8192u /* 8 s at 1 kHz: how long the disk may stall */
#define CHUNK 256u
#define STOP_TICKS 3 /* zero torque, then off: so many periods before the port closes */
#define WRITER_SLEEP_MS 20

typedef struct {
    const char *device_path, *scene_path, *record_path, *interface;
    double seconds;     /* 0: no end */
    double start_after; /* in idle, s */
    int start, exit_on_fault, quiet, force;
} options;

typedef struct {
    options opt;
    device_config device;
    can_port port;
    void *image;
    size_t image_bytes;
    cr_scene scene;
    cr_servo *servo;
    cr_record_ring *ring;
    FILE *record;
    pthread_t writer;
    atomic_uint commands; /* CR_COMMAND_* from the text side */
    atomic_int done, quit, write_failed;
    uint64_t ticks, skipped, late_max_ns;
    uint32_t final_mode, final_faults, final_seen; /* for the last lines */
} daemon_state;

static volatile sig_atomic_t stop_asked;

static void ask_stop(int number) {
    (void)number;
    stop_asked = 1;
}

/* ------------------------------------------------------------------------------------------------------ text side */

static void print_bits(const char *what, uint32_t bits, const char *(*text)(uint32_t)) {
    if (bits == 0u) {
        return;
    }
    printf("%s", what);
    for (uint32_t i = 0; i < 32u; i++) {
        if ((bits >> i & 1u) != 0u) {
            printf(" %s", text(1u << i));
        }
    }
}

/* A line whenever the mode changes, limited and rendering taken as one. */
static void tell(const cr_record *r, uint32_t *last_mode, uint32_t *last_faults) {
    uint32_t mode = r->mode == CR_MODE_LIMITED ? (uint32_t)CR_MODE_RENDERING : r->mode;
    if (mode == *last_mode && r->faults == *last_faults) {
        return;
    }
    printf("tick %u: %s", (unsigned)r->tick, cr_mode_text(mode));
    print_bits(":", r->faults, cr_servo_fault_text);
    printf("\n");
    (void)fflush(stdout);
    *last_mode = mode;
    *last_faults = r->faults;
}

static void obey(daemon_state *d, char *line) {
    line[strcspn(line, "\r\n")] = '\0';
    if (strcmp(line, "start") == 0) {
        atomic_fetch_or(&d->commands, CR_COMMAND_START);
    } else if (strcmp(line, "stop") == 0) {
        atomic_fetch_or(&d->commands, CR_COMMAND_STOP);
    } else if (strcmp(line, "clear") == 0) {
        atomic_fetch_or(&d->commands, CR_COMMAND_CLEAR);
    } else if (strcmp(line, "quit") == 0) {
        atomic_store(&d->quit, 1);
    } else if (line[0] != '\0') {
        fprintf(stderr, "'%s' is no command; start, stop, clear, quit\n", line);
    }
}

/* Whole lines from standard input, without waiting longer than the writer sleeps. */
static int listen_to_commands(daemon_state *d, char *line, size_t *used, size_t size) {
    struct pollfd wait = {STDIN_FILENO, POLLIN, 0};
    if (poll(&wait, 1, WRITER_SLEEP_MS) <= 0) {
        return 1;
    }
    char c;
    ssize_t got = read(STDIN_FILENO, &c, 1);
    while (got == 1) {
        if (c == '\n') {
            line[*used] = '\0';
            obey(d, line);
            *used = 0u;
        } else if (*used + 1u < size) {
            line[(*used)++] = c;
        }
        if (poll(&wait, 1, 0) <= 0) {
            return 1;
        }
        got = read(STDIN_FILENO, &c, 1);
    }
    return got > 0; /* the end of the input: no more commands, and no reason to stop */
}

static void *write_records(void *argument) {
    daemon_state *d = argument;
    static cr_record chunk[CHUNK];
    char line[128];
    size_t used = 0u;
    uint32_t mode = CR_MODE_COUNT, faults = 0u;
    int listening = 1;
    for (;;) {
        int done = atomic_load(&d->done);
        uint32_t count = cr_record_pop(d->ring, chunk, CHUNK);
        if (count > 0u && d->record != NULL && fwrite(chunk, sizeof *chunk, count, d->record) != count) {
            atomic_store(&d->write_failed, 1);
        }
        for (uint32_t i = 0; i < count && !d->opt.quiet; i++) {
            tell(&chunk[i], &mode, &faults);
        }
        if (done && count == 0u) {
            return NULL;
        }
        if (listening) {
            listening = listen_to_commands(d, line, &used, sizeof line);
        } else if (count == 0u) {
            const struct timespec t = {0, WRITER_SLEEP_MS * 1000000L};
            nanosleep(&t, NULL);
        }
    }
}

/* ------------------------------------------------------------------------------------------------- real-time side */

/* A timer coarser than this cannot carry the loop. */
#define TIMER_STEP_MAX_NS 100000

/* Lock all memory, take a real-time priority: each when allowed, and said when not. */
static void become_real_time(const device_config *device) {
    const struct sched_param priority = {.sched_priority = (int)device->priority};
    struct timespec step;
    if (clock_getres(CLOCK_MONOTONIC, &step) == 0 && (step.tv_sec > 0 || step.tv_nsec > TIMER_STEP_MAX_NS)) {
        fprintf(stderr, "warning: timers of this kernel step by %ld us; it needs high-resolution timers\n",
                step.tv_nsec / 1000);
    }
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
        fprintf(stderr, "warning: memory is not locked: %s; a page fault can delay a tick\n", strerror(errno));
    }
    int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
    if (error != 0) {
        fprintf(stderr, "warning: no real-time priority: %s; run with CAP_SYS_NICE or an rtprio limit\n",
                strerror(error));
    }
}

static void sleep_until(uint64_t ns) {
    const struct timespec t = {(time_t)(ns / 1000000000u), (long)(ns % 1000000000u)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR && !stop_asked) {
    }
}

static void send_all(daemon_state *d, const cr_tx *tx) {
    if (can_send(&d->port, tx) != 0) {
        cr_servo_input(d->servo, CR_INPUT_SEND_FAILED);
    }
}

static void collect(daemon_state *d, uint64_t until_ns) {
    cr_frame frame;
    while (can_receive(&d->port, until_ns, &frame)) {
        cr_servo_rx(d->servo, &frame);
        if (until_ns != 0u && cr_servo_get_status(d->servo).ready) {
            until_ns = 0u; /* all there: only what already waits */
        }
    }
    cr_servo_rx_drops(d->servo, d->port.drops);
    if (d->port.bus_off) {
        cr_servo_input(d->servo, CR_INPUT_BUS_OFF);
        d->port.bus_off = 0u;
    }
}

static void take_commands(daemon_state *d, uint32_t more) {
    cr_servo_input(d->servo, atomic_exchange(&d->commands, 0u) | more);
}

/* One period that should begin at due_ns. */
static void run_period(daemon_state *d, uint64_t due_ns, uint64_t *last_ns, uint32_t commands) {
    cr_tx tx;
    collect(d, 0u); /* what came after the last tick */
    uint64_t sync_ns = can_now_ns();
    cr_servo_sync(d->servo, sync_ns, &tx);
    send_all(d, &tx);
    collect(d, due_ns + (uint64_t)d->device.deadline_us * 1000u);
    take_commands(d, commands);
    uint64_t now_ns = can_now_ns();
    float period_s = d->ticks == 0u ? d->device.servo.period_s : (float)((double)(sync_ns - *last_ns) * 1e-9);
    cr_servo_tick(d->servo, now_ns, period_s <= 1.0f ? period_s : 1.0f, &tx);
    send_all(d, &tx);
    cr_record record = *cr_servo_get_record(d->servo);
    uint64_t late_ns = sync_ns - due_ns, cost_ns = can_now_ns() - now_ns;
    record.wake_late_ns = late_ns < UINT32_MAX ? (uint32_t)late_ns : UINT32_MAX;
    record.tick_ns = cost_ns < UINT32_MAX ? (uint32_t)cost_ns : UINT32_MAX;
    cr_record_push(d->ring, &record);
    d->late_max_ns = late_ns > d->late_max_ns ? late_ns : d->late_max_ns;
    *last_ns = sync_ns;
    d->ticks++;
}

static void run_loop(daemon_state *d) {
    const uint64_t period_ns = (uint64_t)((double)d->device.servo.period_s * 1e9 + 0.5);
    uint64_t due_ns = can_now_ns() + period_ns, last_ns = 0u;
    const uint64_t end_ns = d->opt.seconds > 0.0 ? due_ns + (uint64_t)(d->opt.seconds * 1e9) : UINT64_MAX;
    uint64_t idle_ns = 0u; /* when idle began */
    int stopping = 0, start_due = d->opt.start;
    while (stopping < STOP_TICKS) {
        sleep_until(due_ns);
        uint32_t mode = cr_servo_get_status(d->servo).mode;
        int stop =
            stop_asked || atomic_load(&d->quit) || due_ns >= end_ns || (d->opt.exit_on_fault && mode == CR_MODE_FAULT);
        if (stop && stopping == 0) {
            d->final_mode = mode;
            d->final_faults = cr_servo_get_status(d->servo).faults;
            d->final_seen = cr_servo_get_status(d->servo).axes_seen;
        }
        stopping += stop || stopping > 0 ? 1 : 0;
        uint32_t commands = stopping == 1 ? (uint32_t)CR_COMMAND_STOP : stopping > 1 ? (uint32_t)CR_COMMAND_OFF : 0u;
        idle_ns = mode == CR_MODE_IDLE && idle_ns == 0u ? due_ns : idle_ns;
        if (start_due && mode == CR_MODE_IDLE && stopping == 0 &&
            due_ns - idle_ns >= (uint64_t)(d->opt.start_after * 1e9)) {
            commands |= CR_COMMAND_START;
            start_due = 0;
        }
        run_period(d, due_ns, &last_ns, commands);
        due_ns += period_ns;
        for (uint64_t now = can_now_ns(); due_ns + period_ns <= now; due_ns += period_ns) {
            d->skipped++; /* overslept: these periods are gone */
        }
    }
}

/* -------------------------------------------------------------------------------------------------------- set-up */

static int complain(int status, const char *text) {
    fprintf(stderr, "error: %s\n", text);
    return status;
}

#define USAGE                                                                                                          \
    "usage: creased --config device.toml [--interface NAME] [--record FILE] [--start] [--start-after S]\n"             \
    "               [--exit-on-fault] [--force] [--quiet] [--seconds S] scene.crs\n"                                   \
    "commands on standard input: start, stop, clear, quit\n"

static int usage(void) {
    fprintf(stderr, USAGE "creased --help tells more\n");
    return EXIT_USAGE;
}

static void help(void) {
    printf(
        USAGE
        "\n"
        "The servo of a haptic device on SocketCAN: a scene image, three CiA 402 drives, contact forces at 1 kHz.\n\n"
        "  --config FILE      the device; firmware/port/linux/device.toml has every key with its default\n"
        "  --interface NAME   such as can0 or vcan0, instead of the file's\n"
        "  --record FILE      every tick, for crease replay and crease plot; see --force\n"
        "  --force            the record may replace a file\n"
        "  --start            render as soon as the drives are calibrated, without the command\n"
        "  --start-after S    the same, S seconds later\n"
        "  --seconds S        stop after this time\n"
        "  --exit-on-fault    stop at the first fault instead of waiting for the command clear\n"
        "  --quiet            no line when the mode changes\n\n"
        "start renders, stop ends it, clear leaves a fault and begins again, quit or Ctrl-C ends.\n"
        "Exit status: 0 stopped as asked; 1 the record could not be written; 2 wrong command line, configuration\n"
        "or scene; 3 the bus cannot be reached, or not all drives answered; 4 stopped in fault.\n");
}

static int read_seconds(const char *text, double *out) {
    char *end;
    *out = strtod(text, &end);
    return end == text || *end != '\0' || !(*out > 0.0 && *out <= 1e6);
}

static int read_options(int argc, char **argv, options *opt) {
    static const struct option known[] = {{"config", required_argument, NULL, 'c'},
                                          {"interface", required_argument, NULL, 'i'},
                                          {"record", required_argument, NULL, 'r'},
                                          {"seconds", required_argument, NULL, 's'},
                                          {"start", no_argument, NULL, 'S'},
                                          {"exit-on-fault", no_argument, NULL, 'x'},
                                          {"quiet", no_argument, NULL, 'q'},
                                          {"start-after", required_argument, NULL, 'a'},
                                          {"force", no_argument, NULL, 'f'},
                                          {"help", no_argument, NULL, 'h'},
                                          {NULL, 0, NULL, 0}};
    int wrong = 0;
    memset(opt, 0, sizeof *opt);
    for (int key = getopt_long(argc, argv, "", known, NULL); key != -1;
         key = getopt_long(argc, argv, "", known, NULL)) {
        switch (key) {
        case 'c':
            opt->device_path = optarg;
            break;
        case 'i':
            opt->interface = optarg;
            break;
        case 'r':
            opt->record_path = optarg;
            break;
        case 's':
            wrong |= read_seconds(optarg, &opt->seconds);
            break;
        case 'a':
            wrong |= read_seconds(optarg, &opt->start_after);
            opt->start = 1;
            break;
        case 'S':
            opt->start = 1;
            break;
        case 'x':
            opt->exit_on_fault = 1;
            break;
        case 'q':
            opt->quiet = 1;
            break;
        case 'f':
            opt->force = 1;
            break;
        case 'h':
            help();
            exit(EXIT_DONE);
        default:
            return usage();
        }
    }
    if (wrong) {
        return complain(EXIT_USAGE, "--seconds, --start-after: a number above 0, up to 1000000");
    }
    if (opt->device_path == NULL || optind != argc - 1) {
        fprintf(stderr, opt->device_path == NULL ? "error: --config is missing\n" : "error: one scene.crs is needed\n");
        return usage();
    }
    opt->scene_path = argv[optind];
    return 0;
}

static int load_scene(daemon_state *d) {
    char text[512];
    FILE *file = fopen(d->opt.scene_path, "rb");
    long size = -1;
    if (file != NULL && fseek(file, 0, SEEK_END) == 0) {
        size = ftell(file);
        rewind(file);
    }
    if (size > 0) {
        d->image_bytes = (size_t)size;
        d->image = aligned_alloc(ALIGN, ((size_t)size + ALIGN - 1u) / ALIGN * ALIGN);
    }
    int whole = d->image != NULL && fread(d->image, 1, d->image_bytes, file) == d->image_bytes;
    if (file != NULL) {
        (void)fclose(file); /* read only: nothing is lost */
    }
    if (!whole) {
        snprintf(text, sizeof text, "%s: cannot be read", d->opt.scene_path);
        return complain(EXIT_USAGE, text);
    }
    cr_err err = cr_scene_open(&d->scene, d->image, d->image_bytes);
    if (err != CR_OK) {
        snprintf(text, sizeof text, "%s: %s; bake it again", d->opt.scene_path, cr_err_text(err));
        return complain(EXIT_USAGE, text);
    }
    return 0;
}

static int make_servo(daemon_state *d) {
    size_t size = cr_servo_size(&d->scene, &d->device.servo), ring = cr_record_ring_size(RING_RECORDS);
    void *memory = aligned_alloc(ALIGN, (size + ALIGN - 1u) / ALIGN * ALIGN), *records = aligned_alloc(ALIGN, ring);
    cr_err err = memory == NULL || records == NULL
                     ? CR_ERR_SIZE
                     : cr_servo_init(&d->servo, memory, size, &d->scene, &d->device.servo);
    err = err == CR_OK ? cr_record_ring_init(&d->ring, records, ring, RING_RECORDS) : err;
    return err == CR_OK ? 0 : complain(EXIT_USAGE, cr_err_text(err));
}

static int open_record(daemon_state *d) {
    static uint8_t head[CR_RECORDS_AT];
    char text[512];
    if (d->opt.record_path == NULL) {
        return 0;
    }
    d->record = fopen(d->opt.record_path, d->opt.force ? "wb" : "wbx");
    if (d->record == NULL && errno == EEXIST) {
        snprintf(text, sizeof text, "%s: is there already; --force replaces it", d->opt.record_path);
        return complain(EXIT_RECORD, text);
    }
    cr_record_head_write(&d->device.servo, d->image, d->image_bytes, head);
    if (d->record == NULL || fwrite(head, sizeof head, 1, d->record) != 1) {
        snprintf(text, sizeof text, "%s: cannot be written: %s", d->opt.record_path, strerror(errno));
        return complain(EXIT_RECORD, text);
    }
    return 0;
}

static int set_up(daemon_state *d, int argc, char **argv) {
    char text[DEVICE_TEXT_MAX];
    int status = read_options(argc, argv, &d->opt);
    if (status != 0) {
        return status;
    }
    if (device_load(d->opt.device_path, &d->device, text) != 0) {
        return complain(EXIT_USAGE, text);
    }
    status = load_scene(d);
    status = status != 0 ? status : make_servo(d);
    if (status != 0) {
        return status;
    }
    const char *interface = d->opt.interface != NULL ? d->opt.interface : d->device.interface;
    if (can_open(&d->port, interface, d->device.bitrate, text) != 0) {
        return complain(EXIT_BUS, text);
    }
    return open_record(d);
}

static void say_end(const daemon_state *d) {
    cr_servo_status s = cr_servo_get_status(d->servo);
    printf("%llu ticks, %llu skipped, wake-up at most %.0f us late, %u overruns, %u frames lost, %u records lost\n",
           (unsigned long long)d->ticks, (unsigned long long)d->skipped, (double)d->late_max_ns / 1e3,
           (unsigned)s.counters.overruns, (unsigned)s.counters.rx_drops, (unsigned)cr_record_lost(d->ring));
    if (d->final_mode == CR_MODE_FAULT) {
        print_bits("stopped in fault:", d->final_faults, cr_servo_fault_text);
        printf("\n");
    }
}

static int say_missing(const daemon_state *d) {
    fprintf(stderr, "error: no answer from drive");
    for (uint32_t a = 0; a < CR_AXES; a++) {
        if ((d->final_seen >> a & 1u) == 0u) {
            fprintf(stderr, " %c (node 0x%02x)", (int)"XYZ"[a], 0x11u + (unsigned)a);
        }
    }
    fprintf(stderr, "; is it powered, and on this bus?\n");
    return EXIT_BUS;
}

int main(int argc, char **argv) {
    static daemon_state d;
    int status = set_up(&d, argc, argv);
    if (status != 0) {
        return status;
    }
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = ask_stop;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (pthread_create(&d.writer, NULL, write_records, &d) != 0) {
        return complain(EXIT_RECORD, "no thread for the record");
    }
    become_real_time(&d.device);
    run_loop(&d);
    atomic_store(&d.done, 1);
    pthread_join(d.writer, NULL);
    can_close(&d.port);
    if (d.record != NULL && (fclose(d.record) != 0 || atomic_load(&d.write_failed))) {
        return complain(EXIT_RECORD, "the record was not written whole");
    }
    say_end(&d);
    if (d.final_mode == CR_MODE_INIT) {
        return say_missing(&d);
    }
    return d.final_mode == CR_MODE_FAULT ? EXIT_FAULT : EXIT_DONE;
}
