/* Decodes payloads of `tick` and `ticks` with tick.proto, read at run time, and prints every field.
 *
 *   decode tick.proto < payloads
 *
 * stdin: for each payload a letter (t: motord.Tick, b: motord.Ticks), its length (u32, little-endian)
 * and its bytes. stdout: a line for each tick, name=value for every field. No library is needed:
 * all fields of a tick are of fixed width.
 */
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_FIELD = 256, NAME = 64, FIXED64 = 1, BYTES = 2, FIXED32 = 5 };

struct field {
    char kind[16];
    char name[NAME];
};

static struct field fields[MAX_FIELD]; /* by number */
static int last_field;

static void fail(const char *what)
{
    fprintf(stderr, "decode: %s\n", what);
    exit(1);
}

static void read_definition(const char *path)
{
    char line[256];
    int inside = 0;
    FILE *file = fopen(path, "r");
    if (file == NULL)
        fail("cannot open the .proto file");
    while (fgets(line, sizeof line, file) != NULL) {
        struct field field;
        int number;
        if (strncmp(line, "message Tick {", 14) == 0)
            inside = 1;
        else if (line[0] == '}')
            inside = 0;
        else if (inside && sscanf(line, " %15s %63[^ =] = %d ;", field.kind, field.name, &number) == 3) {
            if (number < 1 || number >= MAX_FIELD)
                fail("a field number is too large");
            fields[number] = field;
            if (number > last_field)
                last_field = number;
        }
    }
    fclose(file);
}

static uint64_t little_endian(const uint8_t *bytes, int width)
{
    uint64_t value = 0;
    for (int i = 0; i < width; i++)
        value |= (uint64_t)bytes[i] << (8 * i);
    return value;
}

static uint64_t varint(const uint8_t **at, const uint8_t *end)
{
    uint64_t value = 0;
    for (int shift = 0; shift < 64 && *at < end; shift += 7) {
        uint8_t byte = *(*at)++;
        value |= (uint64_t)(byte & 0x7F) << shift;
        if (byte < 0x80)
            return value;
    }
    fail("a number does not end");
    return 0;
}

static void print_value(const struct field *field, uint64_t bits)
{
    uint32_t low = (uint32_t)bits;
    if (strcmp(field->kind, "float") == 0) {
        float value;
        memcpy(&value, &low, sizeof value);
        printf("%s=%.9g", field->name, value);
    } else if (strcmp(field->kind, "double") == 0) {
        double value;
        memcpy(&value, &bits, sizeof value);
        printf("%s=%.17g", field->name, value);
    } else if (strcmp(field->kind, "sfixed64") == 0) {
        printf("%s=%" PRId64, field->name, (int64_t)bits);
    } else if (strcmp(field->kind, "fixed64") == 0) {
        printf("%s=%" PRIu64, field->name, bits);
    } else if (strcmp(field->kind, "sfixed32") == 0) {
        printf("%s=%" PRId32, field->name, (int32_t)low);
    } else if (strcmp(field->kind, "fixed32") == 0) {
        printf("%s=%" PRIu32, field->name, low);
    } else {
        fail("a type that has no fixed width");
    }
}

static void print_tick(const uint8_t *at, const uint8_t *end)
{
    uint64_t values[MAX_FIELD] = {0}; /* what is not in the message is zero */
    while (at < end) {
        uint64_t tag = varint(&at, end);
        int width = (tag & 7) == FIXED64 ? 8 : (tag & 7) == FIXED32 ? 4 : 0;
        if (width == 0 || end - at < width)
            fail("a field is not as the .proto file has it");
        if ((tag >> 3) < MAX_FIELD)
            values[tag >> 3] = little_endian(at, width);
        at += width;
    }
    for (int number = 1; number <= last_field; number++) {
        if (fields[number].name[0] == '\0')
            continue;
        print_value(&fields[number], values[number]);
        putchar(number == last_field ? '\n' : ' ');
    }
}

static void print_ticks(const uint8_t *at, const uint8_t *end)
{
    while (at < end) {
        if (varint(&at, end) != (1 << 3 | BYTES))
            fail("not motord.Ticks");
        uint64_t length = varint(&at, end);
        if (length > (uint64_t)(end - at))
            fail("a tick ends after its block");
        print_tick(at, at + length);
        at += length;
    }
}

int main(int count, char **arguments)
{
    uint8_t head[5];
    if (count != 2)
        fail("usage: decode tick.proto < payloads");
    read_definition(arguments[1]);
    while (fread(head, 1, sizeof head, stdin) == sizeof head) {
        size_t length = (size_t)little_endian(head + 1, 4);
        uint8_t *payload = malloc(length + 1);
        if (payload == NULL || fread(payload, 1, length, stdin) != length)
            fail("a payload is cut off");
        if (head[0] == 't')
            print_tick(payload, payload + length);
        else
            print_ticks(payload, payload + length);
        free(payload);
    }
    return 0;
}
