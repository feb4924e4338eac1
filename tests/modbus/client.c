/* A Modbus host made with libmodbus, controlled by lines on stdin.
 *
 *   client tcp PORT
 *   client rtu DEVICE BAUD
 *
 * Commands, one a line; each is answered by one line on stdout: "ok" with the values, "exception"
 * with its number, or "error" with the reason:
 *   unit NUMBER               the device that is asked from now on
 *   timeout MS                how long an answer may take
 *   read ADDRESS COUNT        holding registers
 *   input ADDRESS COUNT       input registers
 *   write ADDRESS VALUE       function 6
 *   writes ADDRESS VALUE...   function 16
 *   mask ADDRESS AND OR       function 22
 *   both ADDRESS VALUE ADDRESS COUNT    function 23: write one, read several
 *   bits ADDRESS COUNT        coils
 *   raw HEX                   send a request, as it is
 *   bytes HEX                 send bytes that are no request, and await nothing
 *   reconnect
 */
#include <errno.h>
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { LINE = 512, MOST = 125 };

static void report(int count, const uint16_t *values) {
    if (count < 0 && errno > MODBUS_ENOBASE && errno <= EMBXGTAR) {
        printf("exception %d\n", errno - MODBUS_ENOBASE);
    } else if (count < 0) {
        printf("error %s\n", modbus_strerror(errno));
    } else {
        printf("ok");
        for (int i = 0; values && i < count; i++) {
            printf(" %u", values[i]);
        }
        printf("\n");
    }
}

static size_t from_hex(const char *hex, uint8_t *bytes) {
    size_t count = 0;
    unsigned byte;
    while (sscanf(hex + 2 * count, "%2x", &byte) == 1) {
        bytes[count++] = (uint8_t)byte;
    }
    return count;
}

static size_t numbers(char *rest, int *found, size_t most) {
    size_t count = 0;
    for (char *word = strtok(rest, " "); word && count < most; word = strtok(NULL, " ")) {
        found[count++] = (int)strtol(word, NULL, 0);
    }
    return count;
}

static void raw(modbus_t *context, const char *hex, int awaits) {
    uint8_t bytes[LINE / 2], answer[MODBUS_MAX_ADU_LENGTH];
    size_t count = from_hex(hex, bytes);
    if (!awaits) {
        printf("ok %d\n", (int)write(modbus_get_socket(context), bytes, count));
        return;
    }
    int header = modbus_get_header_length(context);
    int length = modbus_send_raw_request(context, bytes, (int)count) < 0
                     ? -1
                     : modbus_receive_confirmation(context, answer);
    if (length < 0) {
        report(-1, NULL);
    } else if (answer[header] & 0x80) {
        printf("exception %d\n", answer[header + 1]);
    } else {
        printf("ok\n");
    }
}

static void obey(modbus_t *context, char *line) {
    uint16_t values[MOST] = {0};
    int n[MOST + 1] = {0};
    char word[16] = "";
    char *rest = strchr(line, ' ');
    sscanf(line, "%15s", word);
    rest = rest ? rest + 1 : line + strlen(line);
    if (!strcmp(word, "raw") || !strcmp(word, "bytes")) {
        raw(context, rest, word[0] == 'r');
        return;
    }
    size_t count = numbers(rest, n, MOST + 1);
    if (!strcmp(word, "unit")) {
        report(modbus_set_slave(context, n[0]), NULL);
    } else if (!strcmp(word, "timeout")) {
        report(modbus_set_response_timeout(context, (uint32_t)n[0] / 1000,
                                           (uint32_t)n[0] % 1000 * 1000), NULL);
    } else if (!strcmp(word, "read")) {
        report(modbus_read_registers(context, n[0], n[1], values), values);
    } else if (!strcmp(word, "input")) {
        report(modbus_read_input_registers(context, n[0], n[1], values), values);
    } else if (!strcmp(word, "write")) {
        report(modbus_write_register(context, n[0], (uint16_t)n[1]), NULL);
    } else if (!strcmp(word, "writes")) {
        for (size_t i = 1; i < count; i++) {
            values[i - 1] = (uint16_t)n[i];
        }
        report(modbus_write_registers(context, n[0], (int)count - 1, values), NULL);
    } else if (!strcmp(word, "mask")) {
        report(modbus_mask_write_register(context, n[0], (uint16_t)n[1], (uint16_t)n[2]), NULL);
    } else if (!strcmp(word, "both")) {
        uint16_t value = (uint16_t)n[1];
        report(modbus_write_and_read_registers(context, n[0], 1, &value, n[2], n[3], values),
               values);
    } else if (!strcmp(word, "bits")) {
        uint8_t bits[MOST];
        report(modbus_read_bits(context, n[0], n[1], bits), NULL);
    } else if (!strcmp(word, "reconnect")) {
        modbus_close(context);
        report(modbus_connect(context), NULL);
    } else {
        printf("unknown %s\n", word);
    }
}

int main(int argc, char **argv) {
    char line[LINE];
    int over_tcp = argc == 3 && !strcmp(argv[1], "tcp");
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (!over_tcp && argc != 4) {
        fprintf(stderr, "usage: client tcp PORT | rtu DEVICE BAUD\n");
        return 2;
    }
    modbus_t *context = over_tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2]))
                                 : modbus_new_rtu(argv[2], atoi(argv[3]), 'N', 8, 1);
    if (!context || modbus_set_slave(context, 1) || modbus_connect(context)) {
        fprintf(stderr, "%s\n", modbus_strerror(errno));
        return 1;
    }
    printf("ready\n");
    while (fgets(line, sizeof line, stdin)) {
        line[strcspn(line, "\n")] = '\0';
        obey(context, line);
    }
    modbus_close(context);
    modbus_free(context);
    return 0;
}
