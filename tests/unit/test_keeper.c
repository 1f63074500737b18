/* Watchdog and service manager: told only of a loop that ticks, never waited for. The manager is a socket of this test. */
#include "keeper.h"

#include <fcntl.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cmocka.h>

#define MS 1000000ull

static char folder[] = "/tmp/crease-keeper-XXXXXX";
static char watchdog[64], manager_path[64], error[KEEPER_TEXT_MAX];
static int manager;

static int begin(void **state) {
    (void)state;
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (mkdtemp(folder) == NULL) {
        return -1;
    }
    snprintf(watchdog, sizeof watchdog, "%s/dog", folder);
    snprintf(manager_path, sizeof manager_path, "%s/notify", folder);
    snprintf(address.sun_path, sizeof address.sun_path, "%s", manager_path);
    close(open(watchdog, O_CREAT | O_WRONLY, 0600));
    manager = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    return bind(manager, (const struct sockaddr *)&address, sizeof address);
}

static int end(void **state) {
    (void)state;
    close(manager);
    unlink(watchdog);
    unlink(manager_path);
    return rmdir(folder);
}

/* What the watchdog got so far. */
static const char *barked(void) {
    static char text[256];
    const int fd = open(watchdog, O_RDONLY);
    const ssize_t got = read(fd, text, sizeof text - 1u);
    close(fd);
    text[got > 0 ? got : 0] = '\0';
    return text;
}

static const char *said(void) {
    static char text[64];
    const ssize_t got = recv(manager, text, sizeof text - 1u, 0);
    text[got > 0 ? got : 0] = '\0';
    return text;
}

static keeper open_keeper(const char *usec, const char *pid) {
    keeper k;
    setenv("NOTIFY_SOCKET", manager_path, 1);
    usec != NULL ? setenv("WATCHDOG_USEC", usec, 1) : unsetenv("WATCHDOG_USEC");
    pid != NULL ? setenv("WATCHDOG_PID", pid, 1) : unsetenv("WATCHDOG_PID");
    close(open(watchdog, O_TRUNC | O_WRONLY));
    assert_int_equal(keeper_open(&k, watchdog, error), 0);
    return k;
}

static void loop_that_ticks_is_told_every_100_ms(void **state) {
    (void)state;
    keeper k = open_keeper("1000000", NULL);
    for (uint32_t ms = 0; ms < 2000u; ms += 20u) {
        keeper_beat(&k, ms, (5000u + ms) * MS);
    }
    assert_in_range(strlen(barked()), 19, 20);
    assert_string_equal(said(), "READY=1");
    for (int i = 0; i < 4; i++) { /* of a second, every half; 20 ms, 520 ms, ... */
        assert_string_equal(said(), "WATCHDOG=1");
    }
    assert_string_equal(said(), "");
    keeper_close(&k);
    assert_string_equal(said(), "STOPPING=1");
    assert_int_equal(barked()[strlen(barked()) - 1u], 'V');
}

static void loop_that_hangs_is_told_no_more(void **state) {
    (void)state;
    keeper k = open_keeper("200000", NULL);
    keeper_beat(&k, 0u, 1000u * MS); /* has not begun */
    assert_true(strlen(barked()) == 0u && strlen(said()) == 0u);
    keeper_beat(&k, 7u, 1100u * MS);
    assert_true(strlen(barked()) == 1u);
    for (uint32_t ms = 0; ms < 5000u; ms += 20u) {
        keeper_beat(&k, 7u, (1200u + ms) * MS);
    }
    assert_string_equal(barked(), "k");
    assert_string_equal(said(), "READY=1");
    assert_string_equal(said(), "WATCHDOG=1");
    assert_string_equal(said(), "");
    keeper_beat(&k, 8u, 7000u * MS); /* it was only late */
    assert_string_equal(barked(), "kk");
    keeper_close(&k);
}

static void manager_of_another_process_or_none_is_not_told(void **state) {
    (void)state;
    keeper k = open_keeper("200000", "1"); /* the watchdog is meant for process 1 */
    (void)said();
    while (said()[0] != '\0') {
    }
    keeper_beat(&k, 1u, 1000u * MS);
    assert_string_equal(said(), "READY=1");
    assert_string_equal(said(), "");
    keeper_close(&k);
    unsetenv("NOTIFY_SOCKET");
    assert_int_equal(keeper_open(&k, "", error), 0);
    assert_true(k.notify == -1 && k.watchdog == -1);
    keeper_beat(&k, 1u, 1000u * MS);
    keeper_close(&k);
    setenv("NOTIFY_SOCKET", "/nowhere/at/all", 1);
    assert_int_equal(keeper_open(&k, "", error), 0);
    assert_int_equal(k.notify, -1);
}

static void manager_that_does_not_read_holds_up_nothing(void **state) {
    (void)state;
    keeper k = open_keeper("2000", NULL);
    for (uint32_t i = 1; i < 1000u; i++) {
        keeper_beat(&k, i, (1000u + i) * MS);
    }
    keeper_close(&k);
    while (said()[0] != '\0') {
    }
}

static void watchdog_that_cannot_be_opened_is_said(void **state) {
    (void)state;
    keeper k;
    assert_int_equal(keeper_open(&k, "/nowhere/dog", error), -1);
    assert_string_equal(error, "watchdog /nowhere/dog: cannot be opened: No such file or directory");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(loop_that_ticks_is_told_every_100_ms),
        cmocka_unit_test(loop_that_hangs_is_told_no_more),
        cmocka_unit_test(manager_of_another_process_or_none_is_not_told),
        cmocka_unit_test(manager_that_does_not_read_holds_up_nothing),
        cmocka_unit_test(watchdog_that_cannot_be_opened_is_said),
    };
    return cmocka_run_group_tests(tests, begin, end);
}
