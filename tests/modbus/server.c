/* A Modbus device made with libmodbus, controlled by lines on stdin.
 *
 *   server tcp PORT UNIT
 *   server rtu DEVICE BAUD UNIT
 *
 * Commands, one a line; each is answered by one line on stdout:
 *   holding ADDRESS VALUE     set a register
 *   input ADDRESS VALUE
 *   read ADDRESS              a holding register's value
 *   exception ADDRESS CODE    refuse requests for ADDRESS with CODE; 0: no longer
 *   silent COUNT              leave the next COUNT requests without an answer
 *   late COUNT                answer the next COUNT requests only when another one has come
 *   release                   answer what is being held back
 *   pause MS                  take this long for every answer from now on
 *   raw HEX                   send these bytes to whoever asked last
 *   hangup                    reset all connections
 *   counts                    connections and requests so far
 */
#include <errno.h>
#include <modbus/modbus.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

enum { REGISTERS = 64, HELD = 8, LINE = 512 };

struct held {
    int fd;
    int length;
    uint8_t request[MODBUS_MAX_ADU_LENGTH];
};

static modbus_t *context;
static modbus_mapping_t *mapping;
static int exceptions[REGISTERS];
static struct held held[HELD];
static int held_count, silent, late, unit, over_tcp, last_fd = -1;
static unsigned connections, requests, pause_us;
static fd_set open_fds;

static void hang_up(int fd) {
    FD_CLR(fd, &open_fds);
    close(fd);
    for (int i = 0; i < held_count; i++) {
        if (held[i].fd == fd) {
            held[i].length = 0;
        }
    }
    if (last_fd == fd) {
        last_fd = -1;
    }
}

static void answer(const struct held *what) {
    int header = modbus_get_header_length(context);
    const uint8_t *pdu = what->request + header;
    int address = pdu[1] << 8 | pdu[2];
    if (what->length == 0) {
        return;
    }
    modbus_set_socket(context, what->fd);
    if (over_tcp && what->request[header - 1] != unit) {
        modbus_reply_exception(context, what->request, 11);
    } else if (address < REGISTERS && exceptions[address]) {
        modbus_reply_exception(context, what->request, (unsigned)exceptions[address]);
    } else {
        modbus_reply(context, what->request, what->length, mapping);
    }
}

static void release(void) {
    for (int i = 0; i < held_count; i++) {
        answer(&held[i]);
    }
    held_count = 0;
}

static void take(int fd) {
    struct held now = {.fd = fd};
    modbus_set_socket(context, fd);
    now.length = modbus_receive(context, now.request);
    if (now.length < 0) {
        if (over_tcp) {
            hang_up(fd);
        }
        return;
    }
    if (now.length == 0) {
        return; /* for another unit */
    }
    requests++;
    last_fd = fd;
    if (silent > 0) {
        silent--;
    } else if (late > 0 && held_count < HELD) {
        late--;
        held[held_count++] = now;
    } else {
        release();
        usleep(pause_us);
        answer(&now);
    }
}

static void send_raw(const char *hex) {
    uint8_t bytes[LINE / 2];
    size_t count = 0;
    unsigned byte;
    while (sscanf(hex + 2 * count, "%2x", &byte) == 1) {
        bytes[count++] = (uint8_t)byte;
    }
    printf("ok %d\n", last_fd < 0 ? -1 : (int)write(last_fd, bytes, count));
}

static void reset_all(int listening) {
    struct linger at_once = {.l_onoff = 1, .l_linger = 0};
    for (int fd = 0; fd < FD_SETSIZE; fd++) {
        if (FD_ISSET(fd, &open_fds) && fd != listening && fd != STDIN_FILENO) {
            setsockopt(fd, SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
            hang_up(fd);
        }
    }
}

static int is_register(int address) { return address >= 0 && address < REGISTERS; }

static void obey(const char *line, int listening) {
    char word[16] = "", rest[LINE] = "";
    int a = 0, b = 0;
    sscanf(line, "%15s %511s", word, rest);
    sscanf(line, "%*s %i %i", &a, &b);
    if (!strcmp(word, "holding") && is_register(a)) {
        mapping->tab_registers[a] = (uint16_t)b;
    } else if (!strcmp(word, "input") && is_register(a)) {
        mapping->tab_input_registers[a] = (uint16_t)b;
    } else if (!strcmp(word, "read") && is_register(a)) {
        printf("ok %d\n", mapping->tab_registers[a]);
        return;
    } else if (!strcmp(word, "exception") && is_register(a)) {
        exceptions[a] = b;
    } else if (!strcmp(word, "silent")) {
        silent = a;
    } else if (!strcmp(word, "late")) {
        late = a;
    } else if (!strcmp(word, "release")) {
        release();
    } else if (!strcmp(word, "pause")) {
        pause_us = (unsigned)a * 1000;
    } else if (!strcmp(word, "raw")) {
        send_raw(rest);
        return;
    } else if (!strcmp(word, "hangup")) {
        reset_all(listening);
    } else if (!strcmp(word, "counts")) {
        printf("ok %u %u\n", connections, requests);
        return;
    } else {
        printf("unknown %s\n", word);
        return;
    }
    printf("ok\n");
}

/* Returns 0 at the end of stdin. Reads bytes, so that nothing waits in a buffer unseen. */
static int commands(int listening) {
    static char line[LINE];
    static size_t length;
    char byte;
    if (read(STDIN_FILENO, &byte, 1) != 1) {
        return 0;
    }
    if (byte == '\n') {
        line[length] = '\0';
        length = 0;
        obey(line, listening);
    } else if (length < LINE - 1) {
        line[length++] = byte;
    }
    return 1;
}

int main(int argc, char **argv) {
    int listening = -1;
    setvbuf(stdout, NULL, _IOLBF, 0);
    signal(SIGPIPE, SIG_IGN);
    over_tcp = argc == 4 && !strcmp(argv[1], "tcp");
    if (!over_tcp && argc != 5) {
        fprintf(stderr, "usage: server tcp PORT UNIT | rtu DEVICE BAUD UNIT\n");
        return 2;
    }
    unit = atoi(argv[over_tcp ? 3 : 4]);
    context = over_tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2]))
                       : modbus_new_rtu(argv[2], atoi(argv[3]), 'N', 8, 1);
    mapping = modbus_mapping_new(0, 0, REGISTERS, REGISTERS);
    if (!context || !mapping) {
        fprintf(stderr, "%s\n", modbus_strerror(errno));
        return 1;
    }
    FD_ZERO(&open_fds);
    FD_SET(STDIN_FILENO, &open_fds);
    if (over_tcp) {
        listening = modbus_tcp_listen(context, 4);
    } else {
        modbus_set_slave(context, unit);
        listening = modbus_connect(context);
    }
    if (listening < 0) {
        fprintf(stderr, "%s\n", modbus_strerror(errno));
        return 1;
    }
    if (!over_tcp) {
        listening = -1;
        FD_SET(modbus_get_socket(context), &open_fds);
    } else {
        FD_SET(listening, &open_fds);
    }
    printf("ready\n");
    for (;;) {
        fd_set readable = open_fds;
        if (select(FD_SETSIZE, &readable, NULL, NULL, NULL) < 0) {
            continue;
        }
        for (int fd = STDIN_FILENO + 1; fd < FD_SETSIZE; fd++) {
            if (!FD_ISSET(fd, &readable) || !FD_ISSET(fd, &open_fds)) {
                continue;
            }
            if (fd == listening) {
                int connection = modbus_tcp_accept(context, &listening);
                if (connection >= 0) {
                    connections++;
                    FD_SET(connection, &open_fds);
                }
            } else {
                take(fd);
            }
        }
        if (FD_ISSET(STDIN_FILENO, &readable) && !commands(listening)) {
            return 0;
        }
    }
}
