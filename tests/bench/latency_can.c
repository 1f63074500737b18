/* The bus of creased over a UNIX socket instead of SocketCAN: `interface` is its path. Linked in place of can.c, so that the
 * loop that is timed is creased's own on a machine without CAN. A frame costs one system call at each end, as there. */
#define _GNU_SOURCE /* NOLINT: ppoll */
#include "can.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define SECOND_NS 1000000000ull

uint64_t can_now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * SECOND_NS + (uint64_t)t.tv_nsec;
}

uint32_t can_bitrate_of(const void *message, size_t size) {
    (void)message;
    (void)size;
    return 0u;
}

int can_open(can_port *port, const char *interface, uint32_t bitrate, char error[CAN_TEXT_MAX]) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)bitrate;
    memset(port, 0, sizeof *port);
    snprintf(address.sun_path, sizeof address.sun_path, "%s", interface);
    port->fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
    if (port->fd < 0 || connect(port->fd, (const struct sockaddr *)&address, sizeof address) != 0) {
        snprintf(error, CAN_TEXT_MAX, "%.100s: %s", interface, strerror(errno));
        can_close(port);
        return -1;
    }
    return 0;
}

void can_close(can_port *port) {
    if (port->fd >= 0) {
        close(port->fd);
    }
    port->fd = -1;
}

int can_send(can_port *port, const cr_tx *tx) {
    int result = 0;
    for (uint32_t i = 0; i < tx->count; i++) {
        const ssize_t sent = send(port->fd, &tx->frames[i], sizeof tx->frames[i], MSG_DONTWAIT | MSG_NOSIGNAL);
        port->bus_off |= sent < 0 && errno != EAGAIN ? 1u : 0u;
        result = sent == (ssize_t)sizeof tx->frames[i] ? result : -1;
    }
    return result;
}

int can_receive(can_port *port, uint64_t until_ns, cr_frame *frame) {
    for (;;) {
        const ssize_t got = recv(port->fd, frame, sizeof *frame, MSG_DONTWAIT);
        if (got == (ssize_t)sizeof *frame) {
            return 1;
        }
        const uint64_t now = can_now_ns();
        if (got == 0 || now >= until_ns) {
            port->bus_off |= got == 0 ? 1u : 0u;
            return 0;
        }
        struct pollfd wait = {port->fd, POLLIN, 0};
        const uint64_t left = until_ns - now;
        const struct timespec t = {(time_t)(left / SECOND_NS), (long)(left % SECOND_NS)};
        if (ppoll(&wait, 1, &t, NULL) < 0 && errno != EINTR) {
            return 0;
        }
    }
}
