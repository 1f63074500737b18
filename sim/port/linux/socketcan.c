#define _GNU_SOURCE /* NOLINT: SO_RCVBUFFORCE */
#include "socketcan.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#define POLL_US 1000u
/* The default receive queue holds 278 frames, a quarter of a second's; this one holds seconds. */
#define QUEUE_BYTES (4 << 20)

static volatile sig_atomic_t stopping;

static void stop(int signal_number) {
    (void)signal_number;
    stopping = 1;
}

uint64_t cr_sim_now_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u;
}

static int open_bus(const char *interface, cr_sim_run_report *report) {
    const unsigned index = if_nametoindex(interface);
    const int on = 1, bytes = QUEUE_BYTES;
    if (index == 0u) {
        report->error_number = errno;
        return CR_SIM_RUN_INTERFACE;
    }
    const int bus = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int)index};
    if (bus < 0 || bind(bus, (const struct sockaddr *)&address, sizeof address) != 0) {
        report->error_number = errno;
        if (bus >= 0) {
            close(bus);
        }
        return CR_SIM_RUN_SOCKET;
    }
    (void)setsockopt(bus, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
    if (setsockopt(bus, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes) != 0) {
        (void)setsockopt(bus, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
    }
    return bus;
}

/* A timer that fires every millisecond from now on. */
static int open_timer(void) {
    const struct itimerspec every = {.it_interval = {0, POLL_US * 1000L}, .it_value = {0, POLL_US * 1000L}};
    const int timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    if (timer >= 0) {
        (void)timerfd_settime(timer, 0, &every, NULL);
    }
    return timer;
}

static void send_all(cr_sim *sim, int bus, cr_sim_run_report *report) {
    cr_sim_frame frame;
    while (cr_sim_send(sim, &frame, 1) == 1u) {
        struct can_frame raw = {.can_id = frame.id, .can_dlc = frame.len};
        memcpy(raw.data, frame.data, frame.len);
        if (write(bus, &raw, sizeof raw) != (ssize_t)sizeof raw) {
            report->failed_tx++;
        }
    }
}

static void note_drops(struct msghdr *message, cr_sim_run_report *report) {
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c != NULL; c = CMSG_NXTHDR(message, c)) {
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_RXQ_OVFL) {
            uint32_t total;
            memcpy(&total, CMSG_DATA(c), sizeof total);
            report->dropped_rx = total;
        }
    }
}

/* Output  1 a frame was taken; 0 nothing waits; CR_SIM_RUN_LOST the interface is gone. */
static int receive_one(cr_sim *sim, int bus, cr_sim_run_report *report) {
    struct can_frame raw;
    char control[CMSG_SPACE(sizeof(uint32_t))];
    struct iovec part = {&raw, sizeof raw};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = control, .msg_controllen = sizeof control};
    const ssize_t got = recvmsg(bus, &message, 0);
    if (got < 0) {
        report->error_number = errno;
        return errno == EAGAIN || errno == EINTR || errno == ENETDOWN ? 0 : CR_SIM_RUN_LOST;
    }
    note_drops(&message, report);
    const uint32_t special = CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_ERR_FLAG;
    if (got == (ssize_t)sizeof raw && (raw.can_id & special) == 0u && raw.can_dlc <= 8u) {
        cr_sim_frame frame = {.id = raw.can_id, .len = raw.can_dlc};
        memcpy(frame.data, raw.data, raw.can_dlc);
        cr_sim_receive(sim, &frame, cr_sim_now_us());
    }
    return 1;
}

static int serve(cr_sim *sim, int bus, int timer, uint64_t end_us, cr_sim_run_report *report) {
    struct pollfd watched[2] = {{.fd = bus, .events = POLLIN}, {.fd = timer, .events = POLLIN}};
    for (;;) {
        send_all(sim, bus, report);
        if (stopping || cr_sim_now_us() >= end_us) {
            return CR_SIM_RUN_OK;
        }
        if (poll(watched, 2, 100) < 0) {
            continue; /* a signal: the flag tells */
        }
        uint64_t fired;
        if (read(timer, &fired, sizeof fired) == (ssize_t)sizeof fired) {
            cr_sim_poll(sim, cr_sim_now_us());
        }
        if ((watched[0].revents & (POLLIN | POLLERR)) != 0 && receive_one(sim, bus, report) == CR_SIM_RUN_LOST) {
            return CR_SIM_RUN_LOST;
        }
    }
}

int cr_sim_run_socketcan(cr_sim *sim, const char *interface, uint64_t duration_us, cr_sim_run_report *report) {
    struct sigaction act = {.sa_handler = stop}, old_int, old_term;
    *report = (cr_sim_run_report){0};
    const int bus = open_bus(interface, report);
    if (bus < 0) {
        return bus;
    }
    const int timer = open_timer();
    if (timer < 0) {
        report->error_number = errno;
        close(bus);
        return CR_SIM_RUN_SOCKET;
    }
    stopping = 0;
    sigaction(SIGINT, &act, &old_int);
    sigaction(SIGTERM, &act, &old_term);
    const uint64_t end_us = duration_us > 0u ? cr_sim_now_us() + duration_us : UINT64_MAX;
    const int status = serve(sim, bus, timer, end_us, report);
    sigaction(SIGINT, &old_int, NULL);
    sigaction(SIGTERM, &old_term, NULL);
    close(timer);
    close(bus);
    return status;
}
