#include "aside.h"
#include "can.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define ALIGN 64u
#define CHUNK 256u
#define NAP_MS 20
#define LINE_MAX_BYTES 128u
#define FILE_PATIENCE_MS 5000
#define TEXT_PATIENCE_MS 1000
#define SDO_NO_ANSWER 0xffffffffu
#define NODE_FIRST 0x11u /* of drive X */
#define EMCY_BASE 0x680u /* firmware/servo/SPEC.md */

static void nap(long ms) {
    const struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    nanosleep(&t, NULL);
}

/* -------------------------------------------------------------------------------------------------------- the file */

/* Whole records only: what a full disk cut off is taken back.   Output  records written. */
static uint32_t write_records(aside *a, const cr_record *records, uint32_t count) {
    const char *at = (const char *)records;
    size_t left = (size_t)count * sizeof *records, whole = left;
    while (left > 0u) {
        const ssize_t done = write(a->file, at, left);
        if (done < 0 && errno == EINTR) {
            continue;
        }
        if (done <= 0) {
            const int why = done < 0 ? errno : EIO;
            const size_t cut = (whole - left) % sizeof *records;
            const off_t end = lseek(a->file, 0, SEEK_CUR);
            if (cut > 0u && end >= 0 && ftruncate(a->file, end - (off_t)cut) == 0) {
                (void)lseek(a->file, end - (off_t)cut, SEEK_SET);
            }
            atomic_store(&a->write_errno, why);
            break;
        }
        at += done;
        left -= (size_t)done;
    }
    return (uint32_t)((whole - left) / sizeof *records);
}

static void *run_file(void *argument) {
    static cr_record chunk[CHUNK];
    aside *a = argument;
    for (;;) {
        const int done = atomic_load(&a->done);
        const uint32_t count = cr_record_pop(a->ring, chunk, CHUNK);
        uint32_t kept = count;
        if (count > 0u && a->file >= 0) {
            kept = atomic_load(&a->write_errno) == 0 ? write_records(a, chunk, count) : 0u;
        }
        atomic_fetch_add(&a->unwritten, count - kept);
        if (done && count == 0u) {
            atomic_store(&a->file_is_out, 1);
            return NULL;
        }
        if (count < CHUNK) {
            nap(NAP_MS);
        }
    }
}

/* -------------------------------------------------------------------------------------------------------- the text */

static void print_bits(uint32_t bits, const char *(*text)(uint32_t)) {
    for (uint32_t i = 0; i < 32u; i++) {
        if ((bits >> i & 1u) != 0u) {
            printf(" %s", text(1u << i));
        }
    }
}

static void print_drive(uint32_t axis) {
    printf("; drive %c (node 0x%02x)", (int)"XYZ"[axis], (unsigned)(NODE_FIRST + axis));
}

/* The emergency that came in this tick, or which drive it last was.   Output  0: none of either. */
static int print_drive_fault(const cr_record *r) {
    for (uint32_t i = 0; i < r->frame_count && i < CR_RX_MAX; i++) {
        const cr_frame *f = &r->frames[i];
        const uint32_t axis = (uint32_t)f->id - (EMCY_BASE + NODE_FIRST);
        const unsigned code = f->size >= 2u ? f->data[0] | (unsigned)f->data[1] << 8 : 0u;
        if (axis < CR_AXES && code != 0u) {
            print_drive(axis);
            printf(": 0x%04x", code);
            return 1;
        }
    }
    const int known = (r->faults & CR_FAULT_EMCY) == 0u && r->trouble_axis < CR_AXES;
    if (known) {
        print_drive(r->trouble_axis);
    }
    return known;
}

static void print_reason(const cr_record *r) {
    if ((r->faults & (CR_FAULT_DRIVE | CR_FAULT_EMCY)) != 0u && print_drive_fault(r) != 0) {
        return;
    }
    if ((r->faults & (CR_FAULT_SDO | CR_FAULT_MISMATCH)) == 0u || r->trouble_axis >= CR_AXES) {
        return;
    }
    print_drive(r->trouble_axis);
    printf(": 0x%04x:%u ", (unsigned)(r->sdo_object >> 8), (unsigned)(r->sdo_object & 0xffu));
    if ((r->faults & CR_FAULT_MISMATCH) != 0u) {
        printf("is %u (0x%x), must be %u (0x%x)", (unsigned)r->sdo_found, (unsigned)r->sdo_found,
               (unsigned)r->sdo_wanted, (unsigned)r->sdo_wanted);
    } else if (r->sdo_abort == SDO_NO_ANSWER) {
        printf("not answered");
    } else {
        printf("refused, abort 0x%08x", (unsigned)r->sdo_abort);
    }
}

/* Limited and rendering are taken as one. */
static uint32_t told_mode(const cr_record *r) {
    return r->mode == CR_MODE_LIMITED ? (uint32_t)CR_MODE_RENDERING : r->mode;
}

static void tell(const cr_record *r) {
    printf("tick %u: %s", (unsigned)r->tick, cr_mode_text(told_mode(r)));
    if (r->faults != 0u) {
        printf(":");
        print_bits(r->faults, cr_servo_fault_text);
        print_reason(r);
    }
    printf("\n");
    (void)fflush(stdout);
}

static void tell_troubles(aside *a, int *write_told) {
    const int why = atomic_load(&a->write_errno);
    if (why != 0 && !*write_told) {
        *write_told = 1;
        fprintf(stderr, "error: the record ends here: %s; the loop goes on\n", strerror(why));
    }
    if (atomic_load(&a->complained)) {
        fprintf(stderr, "'%s' is no command; start, stop, clear, quit\n", a->complaint);
        atomic_store(&a->complained, 0);
    }
}

static void *run_text(void *argument) {
    static cr_record news[ASIDE_NEWS_RECORDS];
    aside *a = argument;
    int write_told = 0;
    for (;;) {
        const int done = atomic_load(&a->done) && atomic_load(&a->file_is_out);
        const uint32_t count = cr_record_pop(a->news, news, ASIDE_NEWS_RECORDS);
        for (uint32_t i = 0; i < count && !a->quiet; i++) {
            tell(&news[i]);
        }
        tell_troubles(a, &write_told);
        if (done && count == 0u) {
            (void)fputs(a->last, stdout);
            (void)fflush(stdout);
            (void)fputs(a->last_error, stderr);
            atomic_store(&a->text_is_out, 1);
            return NULL;
        }
        nap(NAP_MS);
    }
}

/* ---------------------------------------------------------------------------------------------------- the commands */

static void obey(aside *a, const char *line) {
    if (strcmp(line, "start") == 0) {
        atomic_fetch_or(&a->commands, CR_COMMAND_START);
    } else if (strcmp(line, "stop") == 0) {
        atomic_fetch_or(&a->commands, CR_COMMAND_STOP);
    } else if (strcmp(line, "clear") == 0) {
        atomic_fetch_or(&a->commands, CR_COMMAND_CLEAR);
    } else if (strcmp(line, "quit") == 0) {
        atomic_store(&a->quit, 1);
    } else if (line[0] != '\0' && !atomic_load(&a->complained)) {
        snprintf(a->complaint, sizeof a->complaint, "%s", line);
        atomic_store(&a->complained, 1);
    }
}

typedef struct {
    char line[LINE_MAX_BYTES];
    size_t used;
    int listening; /* 0: the input has ended; no more commands, and no reason to stop */
} input;

/* At most one buffer at a time: input without end gets no more than the nap leaves it. */
static void listen_once(aside *a, input *in) {
    char bytes[LINE_MAX_BYTES];
    struct pollfd wait = {STDIN_FILENO, POLLIN, 0};
    if (!in->listening || poll(&wait, 1, NAP_MS) <= 0) {
        if (!in->listening) {
            nap(NAP_MS);
        }
        return;
    }
    const ssize_t got = read(STDIN_FILENO, bytes, sizeof bytes);
    in->listening = got > 0 || (got < 0 && (errno == EINTR || errno == EAGAIN));
    for (ssize_t i = 0; i < got; i++) {
        if (bytes[i] == '\n' || bytes[i] == '\r') {
            in->line[in->used] = '\0';
            obey(a, in->line);
            in->used = 0u;
        } else if (in->used + 1u < sizeof in->line) {
            in->line[in->used++] = bytes[i];
        }
    }
    if (got == (ssize_t)sizeof bytes) {
        nap(1);
    }
}

static void *run_commands(void *argument) {
    aside *a = argument;
    input in = {{0}, 0u, 1};
    while (!atomic_load(&a->done)) {
        listen_once(a, &in);
        keeper_beat(&a->keep, atomic_load(&a->beats), can_now_ns());
    }
    return NULL;
}

/* -------------------------------------------------------------------------------------------------- start and end */

static cr_record_ring *make_ring(uint32_t records) {
    cr_record_ring *ring = NULL;
    const size_t size = cr_record_ring_size(records);
    void *memory = aligned_alloc(ALIGN, size);
    if (memory == NULL || cr_record_ring_init(&ring, memory, size, records) != CR_OK) {
        free(memory);
        return NULL;
    }
    return ring;
}

int aside_start(aside *a) {
    static void *(*const work[ASIDE_THREADS])(void *) = {run_file, run_text, run_commands};
    a->ring = make_ring(ASIDE_RING_RECORDS);
    a->news = make_ring(ASIDE_NEWS_RECORDS);
    a->told_mode = CR_MODE_COUNT;
    if (a->ring == NULL || a->news == NULL) {
        return -1;
    }
    for (int i = 0; i < ASIDE_THREADS; i++) {
        if (pthread_create(&a->threads[i], NULL, work[i], a) != 0) {
            return -1;
        }
    }
    return 0;
}

void aside_take(aside *a, const cr_record *record) {
    cr_record_push(a->ring, record);
    const uint32_t mode = told_mode(record);
    if (mode != a->told_mode || record->faults != a->told_faults) {
        cr_record_push(a->news, record);
        a->told_mode = mode;
        a->told_faults = record->faults;
    }
    atomic_fetch_add(&a->beats, 1u);
}

/* Patience is by the clock: naps of a busy machine are longer than they are asked to be. */
static int wait_for(const atomic_int *flag, uint64_t patience_ms) {
    for (const uint64_t until_ns = can_now_ns() + patience_ms * 1000000u;
         can_now_ns() < until_ns && !atomic_load(flag);) {
        nap(1);
    }
    return atomic_load(flag);
}

int aside_finish(aside *a) {
    atomic_store(&a->done, 1);
    pthread_join(a->threads[ASIDE_COMMANDS], NULL); /* it never waits longer than a nap */
    keeper_close(&a->keep);                         /* before the waiting below, in which nothing beats */
    const int file = wait_for(&a->file_is_out, FILE_PATIENCE_MS);
    if (!file) {
        atomic_store(&a->write_errno, ETIMEDOUT);
        atomic_store(&a->file_is_out, 1); /* lets the text side end */
    }
    const int text = wait_for(&a->text_is_out, TEXT_PATIENCE_MS);
    if (!file || !text) {
        return -1;
    }
    pthread_join(a->threads[ASIDE_FILE], NULL);
    pthread_join(a->threads[ASIDE_TEXT], NULL);
    return 0;
}
