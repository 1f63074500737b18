/* can: a raw CAN socket, and one question to the kernel about the bit rate. */
#define _GNU_SOURCE /* NOLINT: ppoll, struct ifreq */
#include "can.h"
#include "servo/servo_stages.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/netlink.h>
#include <linux/can/raw.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define ID_COUNT 0x800u
#define FILTERS_MAX 64
#define SECOND_NS 1000000000ull

uint64_t can_now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * SECOND_NS + (uint64_t)t.tv_nsec;
}

/* ------------------------------------------------------------------------------------------------------ bit rate */

/* Attribute `type` among those in size bytes at `at`; null when there is none. *length: of its payload. */
static const uint8_t *find_attribute(const uint8_t *at, size_t size, unsigned type, size_t *length) {
    struct rtattr head;
    while (size >= sizeof head) {
        memcpy(&head, at, sizeof head);
        if (head.rta_len < sizeof head || head.rta_len > size) {
            return NULL;
        }
        if ((head.rta_type & 0x3fffu) == type) {
            *length = head.rta_len - sizeof head;
            return at + sizeof head;
        }
        size_t step = RTA_ALIGN((size_t)head.rta_len);
        at += step < size ? step : size;
        size -= step < size ? step : size;
    }
    return NULL;
}

uint32_t can_bitrate_of(const void *message, size_t size) {
    const size_t fixed = NLMSG_ALIGN(sizeof(struct nlmsghdr)) + NLMSG_ALIGN(sizeof(struct ifinfomsg));
    struct can_bittiming timing;
    if (size < fixed) {
        return 0u;
    }
    size_t length = size - fixed;
    const uint8_t *at = find_attribute((const uint8_t *)message + fixed, length, IFLA_LINKINFO, &length);
    at = at == NULL ? NULL : find_attribute(at, length, IFLA_INFO_DATA, &length);
    at = at == NULL ? NULL : find_attribute(at, length, IFLA_CAN_BITTIMING, &length);
    if (at == NULL || length < sizeof timing) {
        return 0u;
    }
    memcpy(&timing, at, sizeof timing);
    return timing.bitrate;
}

static uint32_t ask_bitrate(int index) {
    static uint8_t answer[16384];
    struct {
        struct nlmsghdr head;
        struct ifinfomsg info;
    } request;
    memset(&request, 0, sizeof request);
    request.head.nlmsg_len = sizeof request;
    request.head.nlmsg_type = RTM_GETLINK;
    request.head.nlmsg_flags = NLM_F_REQUEST;
    request.info.ifi_index = index;
    int fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    if (fd < 0) {
        return 0u;
    }
    ssize_t got = -1;
    if (send(fd, &request, sizeof request, 0) == (ssize_t)sizeof request) {
        got = recv(fd, answer, sizeof answer, 0);
    }
    close(fd);
    return got > 0 ? can_bitrate_of(answer, (size_t)got) : 0u;
}

/* ------------------------------------------------------------------------------------------------------- opening */

static int set_options(int fd) {
    struct can_filter filters[FILTERS_MAX];
    can_err_mask_t errors = CAN_ERR_BUSOFF | CAN_ERR_RESTARTED;
    int count = 0, on = 1;
    for (uint32_t id = 0; id < ID_COUNT && count < FILTERS_MAX; id++) {
        if (cr_bus_is_of_interest((uint16_t)id)) {
            filters[count].can_id = id;
            filters[count].can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
            count++;
        }
    }
    return setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, (socklen_t)((size_t)count * sizeof *filters)) |
           setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) |
           setsockopt(fd, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
}

static int is_up(int fd, const char *interface) {
    struct ifreq request;
    memset(&request, 0, sizeof request);
    snprintf(request.ifr_name, sizeof request.ifr_name, "%s", interface);
    return ioctl(fd, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
}

static int give_up(can_port *port, char error[CAN_TEXT_MAX], const char *interface, const char *what) {
    snprintf(error, CAN_TEXT_MAX, "%.16s: %s", interface, what);
    can_close(port);
    return -1;
}

int can_open(can_port *port, const char *interface, uint32_t bitrate, char error[CAN_TEXT_MAX]) {
    char text[CAN_TEXT_MAX - 32]; /* leaves room for the interface's name */
    memset(port, 0, sizeof *port);
    if (strlen(interface) >= IF_NAMESIZE) { /* what is cut would be another one */
        snprintf(error, CAN_TEXT_MAX, "%.100s: no such interface: a name has at most 15 letters", interface);
        port->fd = -1;
        return -1;
    }
    port->fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
    if (port->fd < 0) {
        snprintf(text, sizeof text, "no CAN socket: %s; the kernel needs PF_CAN", strerror(errno));
        return give_up(port, error, interface, text);
    }
    unsigned index = if_nametoindex(interface);
    if (index == 0u) {
        return give_up(port, error, interface, "no such interface; see `ip link show type can` or `type vcan`");
    }
    if (!is_up(port->fd, interface)) {
        snprintf(text, sizeof text, "the interface is down; `ip link set %.16s up`", interface);
        return give_up(port, error, interface, text);
    }
    uint32_t found = ask_bitrate((int)index);
    if (found != 0u && found != bitrate) {
        snprintf(text, sizeof text, "runs at %u bit/s, not at %u; `ip link set %.16s type can bitrate %u`",
                 (unsigned)found, (unsigned)bitrate, interface, (unsigned)bitrate);
        return give_up(port, error, interface, text);
    }
    struct sockaddr_can address;
    memset(&address, 0, sizeof address);
    address.can_family = AF_CAN;
    address.can_ifindex = (int)index;
    if (set_options(port->fd) != 0 || bind(port->fd, (struct sockaddr *)&address, sizeof address) != 0) {
        snprintf(text, sizeof text, "cannot be opened: %s", strerror(errno));
        return give_up(port, error, interface, text);
    }
    return 0;
}

void can_close(can_port *port) {
    if (port->fd >= 0) {
        close(port->fd);
    }
    port->fd = -1;
}

/* ------------------------------------------------------------------------------------------------------- frames */

int can_send(can_port *port, const cr_tx *tx) {
    int result = port->off && tx->count > 0u ? -1 : 0;
    for (uint32_t i = 0; i < tx->count && !port->off; i++) {
        struct can_frame frame;
        memset(&frame, 0, sizeof frame);
        frame.can_id = tx->frames[i].id;
        frame.can_dlc = tx->frames[i].size;
        memcpy(frame.data, tx->frames[i].data, sizeof frame.data);
        if (send(port->fd, &frame, sizeof frame, MSG_DONTWAIT) != (ssize_t)sizeof frame) {
            port->bus_off |= errno == ENETDOWN || errno == ENXIO || errno == ENODEV ? 1u : 0u;
            result = -1;
        }
    }
    return result;
}

static void count_drops(can_port *port, struct msghdr *message) {
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c != NULL; c = CMSG_NXTHDR(message, c)) {
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_RXQ_OVFL) {
            memcpy(&port->drops, CMSG_DATA(c), sizeof port->drops);
        }
    }
}

/* 1: a frame for the servo; 0: something else; -1: nothing there. */
static int read_one(can_port *port, cr_frame *out) {
    struct can_frame frame;
    uint8_t control[64];
    struct iovec data = {&frame, sizeof frame};
    struct msghdr message;
    memset(&message, 0, sizeof message);
    message.msg_iov = &data;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    ssize_t got = recvmsg(port->fd, &message, MSG_DONTWAIT);
    if (got < 0) {
        port->bus_off |= errno == ENETDOWN || errno == ENODEV ? 1u : 0u;
        return -1;
    }
    count_drops(port, &message);
    if (got != (ssize_t)sizeof frame) {
        return 0;
    }
    if ((frame.can_id & CAN_ERR_FLAG) != 0u) {
        uint32_t left = (frame.can_id & CAN_ERR_BUSOFF) != 0u ? 1u : 0u;
        port->bus_off |= left;
        port->off = left || ((frame.can_id & CAN_ERR_RESTARTED) == 0u && port->off) ? 1u : 0u;
        return 0;
    }
    port->off = 0u; /* who hears a frame is on the bus */
    out->id = (uint16_t)(frame.can_id & CAN_SFF_MASK);
    out->size = frame.can_dlc <= 8u ? frame.can_dlc : 8u;
    out->flags = 0u;
    memcpy(out->data, frame.data, sizeof out->data);
    return 1;
}

int can_receive(can_port *port, uint64_t until_ns, cr_frame *frame) {
    for (;;) {
        int got = read_one(port, frame);
        if (got == 1) {
            return 1;
        }
        uint64_t now = can_now_ns();
        if (got < 0 && now >= until_ns) {
            return 0;
        }
        if (got < 0) {
            struct pollfd wait = {port->fd, POLLIN, 0};
            uint64_t left = until_ns - now;
            struct timespec t = {(time_t)(left / SECOND_NS), (long)(left % SECOND_NS)};
            if ((ppoll(&wait, 1, &t, NULL) < 0 && errno != EINTR) || port->bus_off) {
                return 0;
            }
        }
    }
}
