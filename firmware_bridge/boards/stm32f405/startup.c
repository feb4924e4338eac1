/* Vector table, start and faults of the STM32F405; the emulated board starts the same way. */
#include "startup.h"

#include "registers.h"

extern uint32_t stack_top, data_load, data_start, data_end, bss_start, bss_end;

typedef void (*handler)(void);

void reset_handler(void)
{
    const uint32_t *from = &data_load;
    for (uint32_t *to = &data_start; to < &data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = &bss_start; to < &bss_end; to++) {
        *to = 0;
    }
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
    handler function;
    uint32_t *stack;
} vector;

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Woverride-init"
__attribute__((section(".vectors"), used)) static const vector vectors[SYSTEM_VECTORS + IRQ_COUNT] = {
    [0 ... SYSTEM_VECTORS + IRQ_COUNT - 1] = {.function = fault_handler},
    [0] = {.stack = &stack_top},
    [1] = {.function = reset_handler},
    [14] = {.function = pendsv_handler},
    [15] = {.function = systick_handler},
    [SYSTEM_VECTORS + IRQ_CAN1_TX] = {.function = can1_tx_handler},
    [SYSTEM_VECTORS + IRQ_CAN1_RX0] = {.function = can1_rx0_handler},
    [SYSTEM_VECTORS + IRQ_USART1] = {.function = usart1_handler},
    [SYSTEM_VECTORS + IRQ_USART2] = {.function = usart2_handler},
};
#pragma GCC diagnostic pop
