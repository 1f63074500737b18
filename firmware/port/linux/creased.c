/* creased: the servo on a Linux machine with SocketCAN. One real-time loop; the search for contact (searcher.h), file, text and commands (aside.h) beside it.
 *
 * Signals      INT, TERM, HUP, QUIT: zero torque in the next period, drives off, end. PIPE, TSTP, TTIN, TTOU, XFSZ change nothing: a servo in
 *              contact does not die of its terminal, nor stand still.
 * Exit status  0 stopped as asked; 1 the record could not be written; 2 wrong command line, configuration or scene; 3 the bus cannot
 *              be reached, or not all drives answered; 4 stopped in fault. */
#define _GNU_SOURCE /* NOLINT: getopt_long */
#include "aside.h"
#include "can.h"
#include "device.h"
#include "searcher.h"

#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { EXIT_DONE = 0, EXIT_RECORD = 1, EXIT_USAGE = 2, EXIT_BUS = 3, EXIT_FAULT = 4 };

#define ALIGN 64u
#define FAULT_TICKS                                                                                                    \
    2 /* in fault before --exit-on-fault ends it: the emergency with the reason comes behind the states */
#define STOP_TICKS 3 /* zero torque, then off: so many periods before the port closes */

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
    aside beside;
    searcher contact; /* with late_max_ticks above 0 */
    uint64_t ticks, skipped, late_max_ns;
    uint32_t final_mode, final_faults, final_seen; /* for the last lines */
} daemon_state;

static atomic_int stop_asked;

static void ask_stop(int number) {
    (void)number;
    atomic_store(&stop_asked, 1);
}

/* What was ignored from the start (nohup) stays so. */
static void take_signals(void) {
    static const int ends[] = {SIGINT, SIGTERM, SIGHUP, SIGQUIT},
                     ignored[] = {SIGPIPE, SIGTSTP, SIGTTIN, SIGTTOU, SIGXFSZ};
    struct sigaction action, before;
    memset(&action, 0, sizeof action);
    action.sa_handler = ask_stop;
    action.sa_flags = SA_RESTART;
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        if (sigaction(ends[i], NULL, &before) == 0 && before.sa_handler != SIG_IGN) {
            sigaction(ends[i], &action, NULL);
        }
    }
    action.sa_handler = SIG_IGN;
    for (size_t i = 0; i < sizeof ignored / sizeof *ignored; i++) {
        sigaction(ignored[i], &action, NULL);
    }
}

/* ------------------------------------------------------------------------------------------------- real-time side */

/* A timer coarser than this cannot carry the loop. */
#define TIMER_STEP_MAX_NS 100000

static int searches_beside(const daemon_state *d) { return d->device.servo.late_max_ticks > 0u; }

/* Lock all memory, take a real-time priority, the commands one below it: each when allowed, and said when not. */
static void become_real_time(daemon_state *d) {
    const int own = (int)d->device.priority;
    const struct sched_param priority = {.sched_priority = own}, below = {.sched_priority = own > 1 ? own - 1 : 1};
    struct timespec step;
    if (clock_getres(CLOCK_MONOTONIC, &step) == 0 && (step.tv_sec > 0 || step.tv_nsec > TIMER_STEP_MAX_NS)) {
        fprintf(stderr, "warning: timers of this kernel step by %ld us; it needs high-resolution timers\n",
                step.tv_nsec / 1000);
    }
    if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
        fprintf(stderr, "warning: memory is not locked: %s; a page fault can delay a tick\n", strerror(errno));
    }
    int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &priority);
    error = error == 0 ? pthread_setschedparam(d->beside.threads[ASIDE_COMMANDS], SCHED_FIFO, &below) : error;
    if (error != 0) {
        fprintf(stderr, "warning: no real-time priority: %s; run with CAP_SYS_NICE or an rtprio limit\n",
                strerror(error));
    }
}

static void sleep_until(uint64_t ns) {
    const struct timespec t = {(time_t)(ns / 1000000000u), (long)(ns % 1000000000u)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {
        /* a signal: what it asks for is done in the period that begins on time */
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
    cr_servo_input(d->servo, atomic_exchange(&d->beside.commands, 0u) | more);
}

/* One period that should begin at due_ns. */
static void run_period(daemon_state *d, uint64_t due_ns, uint64_t *last_ns, uint32_t commands) {
    cr_tx tx;
    collect(d, 0u); /* what came after the last tick */
    uint64_t sync_ns = can_now_ns();
    cr_servo_sync(d->servo, sync_ns, &tx);
    send_all(d, &tx);
    collect(d, sync_ns + (uint64_t)d->device.deadline_us * 1000u);
    take_commands(d, commands);
    uint64_t now_ns = can_now_ns();
    float period_s = d->ticks == 0u ? d->device.servo.period_s : (float)((double)(sync_ns - *last_ns) * 1e-9);
    cr_servo_tick(d->servo, now_ns, period_s <= 1.0f ? period_s : 1.0f, &tx);
    send_all(d, &tx);
    if (searches_beside(d)) {
        searcher_wake(&d->contact);
    }
    cr_record record = *cr_servo_get_record(d->servo);
    uint64_t late_ns = sync_ns - due_ns, cost_ns = can_now_ns() - now_ns;
    record.wake_late_ns = late_ns < UINT32_MAX ? (uint32_t)late_ns : UINT32_MAX;
    record.tick_ns = cost_ns < UINT32_MAX ? (uint32_t)cost_ns : UINT32_MAX;
    aside_take(&d->beside, &record);
    d->late_max_ns = late_ns > d->late_max_ns ? late_ns : d->late_max_ns;
    *last_ns = sync_ns;
    d->ticks++;
}

static void run_loop(daemon_state *d) {
    const uint64_t period_ns = (uint64_t)((double)d->device.servo.period_s * 1e9 + 0.5);
    uint64_t due_ns = can_now_ns() + period_ns, last_ns = 0u;
    const uint64_t end_ns = d->opt.seconds > 0.0 ? due_ns + (uint64_t)(d->opt.seconds * 1e9) : UINT64_MAX;
    uint64_t idle_ns = 0u; /* when idle began */
    uint32_t faulted = 0u; /* periods in fault */
    int stopping = 0, start_due = d->opt.start;
    while (stopping < STOP_TICKS) {
        sleep_until(due_ns);
        uint32_t mode = cr_servo_get_status(d->servo).mode;
        faulted = mode == CR_MODE_FAULT ? faulted + 1u : 0u;
        int stop = atomic_load(&stop_asked) || atomic_load(&d->beside.quit) || due_ns >= end_ns ||
                   (d->opt.exit_on_fault && faulted >= FAULT_TICKS);
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
#define SEE_HELP "; see `creased --help`\n"

/* What getopt_long refuses: a value that is missing, or one too many, or an option that there is not. */
static int complain_of_option(int key, const char *word) {
    const int is_long = strncmp(word, "--", 2) == 0, length = (int)strcspn(word, "=");
    if (key == ':') {
        fprintf(stderr, "error: %s needs a value" SEE_HELP, word);
    } else if (is_long && optopt == 0) {
        fprintf(stderr, "error: there is no option %.*s" SEE_HELP, length, word);
    } else if (is_long && word[length] == '=') {
        fprintf(stderr, "error: %.*s takes no value" SEE_HELP, length, word);
    } else {
        fprintf(stderr, "error: there is no option -%c" SEE_HELP, optopt);
    }
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
        "  --quiet            no line when the mode changes\n"
        "  --version          of the library\n\n"
        "start renders, stop ends it, clear leaves a fault and begins again, quit or Ctrl-C ends.\n"
        "A watchdog ([loop] watchdog) and systemd (Type=notify, WatchdogSec=) are told that the loop runs.\n"
        "Exit status: 0 stopped as asked; 1 the record could not be written; 2 wrong command line, configuration\n"
        "or scene; 3 the bus cannot be reached, or not all drives answered; 4 stopped in fault.\n"
        "Words of a fault, those of drive and emcy with the drive and its error code (0x603F):\n");
    uint32_t column = 0u;
    for (uint32_t i = 0; i < (uint32_t)CR_FAULT_COUNT; i++) {
        const int last = i + 1u == (uint32_t)CR_FAULT_COUNT;
        column += (uint32_t)printf("%s%s", cr_servo_fault_text(1u << i), last ? "." : ",");
        printf("%s", last || column > 80u ? "\n" : " ");
        column = column > 80u ? 0u : column;
    }
}

static int read_seconds(const char *text, double *out) {
    char *end;
    *out = strtod(text, &end);
    return end == text || *end != '\0' || !(*out > 0.0 && *out <= 1e6);
}

static int read_options(int argc, char **argv, options *opt) {
    static const struct option known[] = {
        {"config", required_argument, NULL, 'c'}, {"interface", required_argument, NULL, 'i'},
        {"record", required_argument, NULL, 'r'}, {"seconds", required_argument, NULL, 's'},
        {"start", no_argument, NULL, 'S'},        {"exit-on-fault", no_argument, NULL, 'x'},
        {"quiet", no_argument, NULL, 'q'},        {"start-after", required_argument, NULL, 'a'},
        {"force", no_argument, NULL, 'f'},        {"help", no_argument, NULL, 'h'},
        {"version", no_argument, NULL, 'v'},      {NULL, 0, NULL, 0}};
    static const char no_letters[] = ":"; /* and a missing value told from an option that there is not */
    int wrong = 0;
    memset(opt, 0, sizeof *opt);
    opterr = 0; /* getopt_long says nothing by itself */
    for (int key = getopt_long(argc, argv, no_letters, known, NULL); key != -1;
         key = getopt_long(argc, argv, no_letters, known, NULL)) {
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
        case 'v':
            printf("creased %d.%d.%d\n", CR_VERSION_MAJOR, CR_VERSION_MINOR, CR_VERSION_PATCH);
            exit(EXIT_DONE);
        default:
            return complain_of_option(key, argv[optind - 1]);
        }
    }
    if (wrong) {
        return complain(EXIT_USAGE, "--seconds, --start-after: a number above 0, up to 1000000");
    }
    if (opt->device_path == NULL || optind != argc - 1) {
        fprintf(stderr, "error: %s" SEE_HELP,
                opt->device_path == NULL ? "--config is missing"
                : optind == argc         ? "scene.crs is missing"
                                         : "more than one scene.crs is given");
        return EXIT_USAGE;
    }
    opt->scene_path = argv[optind];
    return 0;
}

/* What is wrong with a scene that cr_scene_open refuses, and the mend. */
static int complain_of_scene(const daemon_state *d, cr_err err) {
    char text[512];
    const char *why = cr_err_text(err), *path = d->opt.scene_path;
    if (err == CR_ERR_SIZE) {
        snprintf(text, sizeof text, "%s: is cut off, after %zu bytes, or damaged; bake it again", path, d->image_bytes);
    } else {
        snprintf(text, sizeof text, "%s: %s%s", path, why,
                 strstr(why, "bake it again") == NULL ? "; bake it again" : "");
    }
    return complain(EXIT_USAGE, text);
}

static int load_scene(daemon_state *d) {
    char text[512];
    FILE *file = fopen(d->opt.scene_path, "rb");
    const int why = errno;
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
        const char *what = size == 0 ? "is an empty file; bake it again" : "cannot be read";
        snprintf(text, sizeof text, "%s: %s%s%s", d->opt.scene_path, what, file == NULL ? ": " : "",
                 file == NULL ? strerror(why) : "");
        return complain(EXIT_USAGE, text);
    }
    cr_err err = cr_scene_open(&d->scene, d->image, d->image_bytes);
    return err == CR_OK ? 0 : complain_of_scene(d, err);
}

static int make_servo(daemon_state *d) {
    size_t size = cr_servo_size(&d->scene, &d->device.servo);
    void *memory = aligned_alloc(ALIGN, (size + ALIGN - 1u) / ALIGN * ALIGN);
    cr_err err = memory == NULL ? CR_ERR_SIZE : cr_servo_init(&d->servo, memory, size, &d->scene, &d->device.servo);
    return err == CR_OK ? 0 : complain(EXIT_USAGE, cr_err_text(err));
}

static int open_record(daemon_state *d) {
    static uint8_t head[CR_RECORDS_AT];
    char text[512];
    d->beside.file = -1;
    if (d->opt.record_path == NULL) {
        return 0;
    }
    const int flags = O_WRONLY | O_CREAT | O_CLOEXEC | (d->opt.force ? O_TRUNC : O_EXCL);
    d->beside.file = open(d->opt.record_path, flags, 0666);
    const int why = errno;
    struct stat found;
    if (d->beside.file < 0 && stat(d->opt.record_path, &found) == 0 && S_ISDIR(found.st_mode)) {
        snprintf(text, sizeof text, "%s: is a folder; name a file", d->opt.record_path);
        return complain(EXIT_RECORD, text);
    }
    if (d->beside.file < 0 && why == EEXIST) {
        snprintf(text, sizeof text, "%s: is there already; --force replaces it", d->opt.record_path);
        return complain(EXIT_RECORD, text);
    }
    cr_record_head_write(&d->device.servo, d->image, d->image_bytes, head);
    if (d->beside.file < 0 || write(d->beside.file, head, sizeof head) != (ssize_t)sizeof head) {
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
    d->beside.quiet = d->opt.quiet;
    if (keeper_open(&d->beside.keep, d->device.watchdog, text) != 0) {
        return complain(EXIT_USAGE, text);
    }
    return open_record(d);
}

static size_t add_faults(char *text, size_t at, uint32_t faults) {
    for (uint32_t i = 0; i < 32u && at < ASIDE_TEXT_MAX; i++) {
        if ((faults >> i & 1u) != 0u) {
            at += (size_t)snprintf(text + at, ASIDE_TEXT_MAX - at, " %s", cr_servo_fault_text(1u << i));
        }
    }
    return at < ASIDE_TEXT_MAX ? at : ASIDE_TEXT_MAX - 1u;
}

/* The last lines, for the text side to say. */
static void write_last(daemon_state *d) {
    cr_servo_status s = cr_servo_get_status(d->servo);
    char *text = d->beside.last, *error = d->beside.last_error;
    size_t at = (size_t)snprintf(
        text, ASIDE_TEXT_MAX,
        "%llu ticks, %llu skipped, wake-up at most %.0f us late, %u overruns, %u frames lost, %u records lost\n",
        (unsigned long long)d->ticks, (unsigned long long)d->skipped, (double)d->late_max_ns / 1e3,
        (unsigned)s.counters.overruns, (unsigned)s.counters.rx_drops, (unsigned)cr_record_lost(d->beside.ring));
    if (d->final_mode == CR_MODE_FAULT) {
        at += (size_t)snprintf(text + at, ASIDE_TEXT_MAX - at, "stopped in fault:");
        at = add_faults(text, at, d->final_faults);
        snprintf(text + at, ASIDE_TEXT_MAX - at, "\n");
    }
    if (d->final_mode != CR_MODE_INIT) {
        return;
    }
    at = (size_t)snprintf(error, ASIDE_TEXT_MAX, "error: no answer from drive");
    for (uint32_t a = 0; a < CR_AXES; a++) {
        if ((d->final_seen >> a & 1u) == 0u) {
            at += (size_t)snprintf(error + at, ASIDE_TEXT_MAX - at, " %c (node 0x%02x)", (int)"XYZ"[a],
                                   0x11u + (unsigned)a);
        }
    }
    snprintf(error + at, ASIDE_TEXT_MAX - at, "; is it powered, and on this bus?\n");
}

static int exit_status(daemon_state *d) {
    int cut = atomic_load(&d->beside.write_errno) != 0 || atomic_load(&d->beside.unwritten) > 0u;
    if (d->beside.file >= 0 && (close(d->beside.file) != 0 || cut)) {
        return EXIT_RECORD;
    }
    if (d->final_mode == CR_MODE_INIT) {
        return EXIT_BUS;
    }
    return d->final_mode == CR_MODE_FAULT ? EXIT_FAULT : EXIT_DONE;
}

static int start_threads(daemon_state *d) {
    return searches_beside(d) && searcher_start(&d->contact, d->servo) != 0 ? -1 : aside_start(&d->beside);
}

int main(int argc, char **argv) {
    static daemon_state d;
    int status = set_up(&d, argc, argv);
    if (status != 0) {
        return status;
    }
    take_signals();
    if (start_threads(&d) != 0) {
        keeper_close(&d.beside.keep);
        can_close(&d.port);
        return complain(EXIT_RECORD, "no memory or threads for the record and the search for contact");
    }
    become_real_time(&d);
    run_loop(&d);
    can_close(&d.port);
    if (searches_beside(&d)) {
        searcher_end(&d.contact);
    }
    write_last(&d);
    int stuck = aside_finish(&d.beside) != 0;
    status = exit_status(&d);
    if (stuck) {
        _exit(status); /* a thread waits for a disk or a terminal that does not answer: nothing more can be said */
    }
    return status;
}
