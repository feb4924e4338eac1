/* Vector table, start and faults of the STM32F405; the emulated board starts the same way. */
#include "startup.h"

#include <string.h>

#include "registers.h"

/* Of stm32f405.ld; the address of one that ends in _bytes is a number of bytes. */
extern uint32_t stack_top[];
extern uint8_t data_start[], bss_start[];
extern const uint8_t data_load[], data_bytes[], bss_bytes[];

typedef void (*handler)(void);

void reset_handler(void)
{
    memcpy(data_start, data_load, (size_t)data_bytes);
    memset(bss_start, 0, (size_t)bss_bytes);
    SCB_VTOR = UINT32_C(0x08000000);
    board_main();
    fault_handler();
}

void fault_handler(void)
{
    board_open_line();
    SCB_AIRCR = AIRCR_SYSRESETREQ;
    for (;;) {
    }
}

/* Handlers that a board does not have are faults. */
#define OPTIONAL __attribute__((weak, alias("fault_handler"), noreturn))
OPTIONAL void systick_handler(void);
OPTIONAL void pendsv_handler(void);
OPTIONAL void usart1_handler(void);
OPTIONAL void usart2_handler(void);
OPTIONAL void can1_tx_handler(void);
OPTIONAL void can1_rx0_handler(void);

#define SYSTEM_VECTORS 16

typedef union {
    handler function; /* cppcheck-suppress unusedStructMember */
    uint32_t *stack;  /* cppcheck-suppress unusedStructMember */
} vector;

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Woverride-init"
__attribute__((section(".vectors"), used)) static const vector vectors[SYSTEM_VECTORS + IRQ_COUNT] = {
    [0 ... SYSTEM_VECTORS + IRQ_COUNT - 1] = {.function = fault_handler},
    [0] = {.stack = stack_top},
    [1] = {.function = reset_handler},
    [14] = {.function = pendsv_handler},
    [15] = {.function = systick_handler},
    [SYSTEM_VECTORS + IRQ_CAN1_TX] = {.function = can1_tx_handler},
    [SYSTEM_VECTORS + IRQ_CAN1_RX0] = {.function = can1_rx0_handler},
    [SYSTEM_VECTORS + IRQ_USART1] = {.function = usart1_handler},
    [SYSTEM_VECTORS + IRQ_USART2] = {.function = usart2_handler},
};
#pragma GCC diagnostic pop
