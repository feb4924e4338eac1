/* The board's end of the link to the host: the serial one or the CAN one is linked in. */
#ifndef STM32F405_PORT_H
#define STM32F405_PORT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "boards/board.h"

enum { PORT_CHUNK_MAX = 64 };

extern const enum board_link port_link;

/* Opens the port. Its interrupts, of the highest priority, only move bytes, and call
 * program_received when some have come. */
void port_open(void);

/* As send of struct board. */
bool port_send(const uint8_t *data, size_t count);

/* Takes the next bytes received, at most PORT_CHUNK_MAX; of CAN exactly one frame's data field.
 * Returns 0 if there are none. */
size_t port_take(uint8_t *data);

/* Goes on sending; from the main loop. */
void port_push(void);

#endif
