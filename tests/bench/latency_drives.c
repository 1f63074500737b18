/* The simulated drives at the other end of a UNIX socket, for tests/bench/latency.py: listens at a path, serves one servo, ends
 * with it.     latency_drives PATH X_M Y_M Z_M        the hand holds the tip there (base frame) */
#include "servo.h"
#include "sim.h"
#include "socketcan.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static int serve(cr_sim *sim, int bus) {
    struct pollfd wait = {bus, POLLIN, 0};
    for (;;) {
        cr_sim_frame out;
        while (cr_sim_send(sim, &out, 1) == 1u) {
            cr_frame frame = {(uint16_t)out.id, out.len, 0u, {0}};
            memcpy(frame.data, out.data, out.len);
            if (send(bus, &frame, sizeof frame, MSG_NOSIGNAL) != (ssize_t)sizeof frame) {
                return 0;
            }
        }
        cr_frame frame;
        if (poll(&wait, 1, 1) > 0) {
            if (recv(bus, &frame, sizeof frame, 0) != (ssize_t)sizeof frame) {
                return 0;
            }
            cr_sim_frame in = {.id = frame.id, .len = frame.size};
            memcpy(in.data, frame.data, frame.size);
            cr_sim_receive(sim, &in, cr_sim_now_us());
        }
        cr_sim_poll(sim, cr_sim_now_us());
    }
}

int main(int argc, char **argv) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const double wrist_rad[3] = {0.0, 0.0, 0.0};
    double target_m[3];
    const int listener = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    if (argc != 5 || listener < 0) {
        return 2;
    }
    for (int i = 0; i < 3; i++) {
        target_m[i] = strtod(argv[2 + i], NULL);
    }
    snprintf(address.sun_path, sizeof address.sun_path, "%s", argv[1]);
    if (bind(listener, (const struct sockaddr *)&address, sizeof address) != 0 || listen(listener, 1) != 0) {
        perror(argv[1]);
        return 1;
    }
    const cr_sim_params params = cr_sim_params_default();
    const int bus = accept(listener, NULL, NULL);
    cr_sim *sim = bus < 0 ? NULL : cr_sim_create(&params, 0u, cr_sim_now_us());
    if (sim == NULL) {
        return 1;
    }
    cr_sim_target(sim, target_m, wrist_rad);
    const int status = serve(sim, bus);
    cr_sim_destroy(sim);
    return status;
}
