#define _GNU_SOURCE /* NOLINT: SOCK_CLOEXEC */
#include "keeper.h"

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

/* A socket that is full or gone is the manager's trouble, not the loop's. */
static void tell_manager(const keeper *k, const char *text) {
    if (k->notify >= 0) {
        (void)send(k->notify, text, strlen(text), MSG_DONTWAIT | MSG_NOSIGNAL);
    }
}

static uint64_t watch_interval_ns(void) {
    const char *usec = getenv("WATCHDOG_USEC"), *pid = getenv("WATCHDOG_PID");
    char *end = NULL;
    if (usec == NULL || (pid != NULL && strtoll(pid, NULL, 10) != (long long)getpid())) {
        return 0u;
    }
    const unsigned long long us = strtoull(usec, &end, 10);
    return end != usec && us < 1000000000000ull ? (uint64_t)us * 500u
                                                : 0u; /* twice in its time, as sd_watchdog_enabled(3) asks */
}

static int connect_manager(void) {
    const char *name = getenv("NOTIFY_SOCKET");
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const size_t length = name != NULL ? strlen(name) : 0u;
    if (length < 2u || length >= sizeof address.sun_path || (name[0] != '/' && name[0] != '@')) {
        return -1;
    }
    memcpy(address.sun_path, name, length);
    if (name[0] == '@') {
        address.sun_path[0] = '\0'; /* a name that is no file */
    }
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const socklen_t size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length);
    if (fd >= 0 && connect(fd, (const struct sockaddr *)&address, size) != 0) {
        close(fd);
        return -1;
    }
    return fd;
}

int keeper_open(keeper *k, const char *path, char error[KEEPER_TEXT_MAX]) {
    memset(k, 0, sizeof *k);
    k->watchdog = -1;
    k->notify = connect_manager();
    k->notify_every_ns = watch_interval_ns();
    if (path[0] == '\0') {
        return 0;
    }
    k->watchdog = open(path, O_WRONLY | O_CLOEXEC | O_NONBLOCK);
    if (k->watchdog < 0) {
        snprintf(error, KEEPER_TEXT_MAX, "watchdog %.200s: cannot be opened: %s", path, strerror(errno));
        return -1;
    }
    return 0;
}

void keeper_beat(keeper *k, uint32_t beats, uint64_t now_ns) {
    if (beats == 0u) {
        return; /* the loop has not begun */
    }
    if (!k->ready) {
        tell_manager(k, "READY=1");
        k->ready = 1;
    }
    if (k->notify_every_ns > 0u && beats != k->notified_beats && now_ns - k->notified_ns >= k->notify_every_ns) {
        tell_manager(k, "WATCHDOG=1");
        k->notified_beats = beats;
        k->notified_ns = now_ns;
    }
    if (k->watchdog >= 0 && beats != k->beats && now_ns - k->told_ns >= KEEPER_EVERY_NS) {
        /* What it does not take now it is offered again. */
        if (write(k->watchdog, "k", 1) == 1) {
            k->beats = beats;
            k->told_ns = now_ns;
        }
    }
}

void keeper_close(keeper *k) {
    tell_manager(k, "STOPPING=1");
    if (k->watchdog >= 0) {
        (void)!write(k->watchdog, "V", 1); /* "magic close" of the watchdog API */
        close(k->watchdog);
    }
    if (k->notify >= 0) {
        close(k->notify);
    }
    k->watchdog = k->notify = -1;
}
