#include "program.h"

#include "core/bridge.h"
#include "port.h"
#include "registers.h"
#include "startup.h"
#include "timing.h"

static struct bridge bridge;
static program_read read_inputs;
static volatile bool woken; /* an interrupt has come that may have left work to the main loop */

void systick_handler(void)
{
    struct board_reading reading = {.t_us = timing_us()};
    read_inputs(&reading);
    bridge_on_tick(&bridge, &reading);
    woken = true;
}

void program_received(void)
{
    SCB_ICSR = ICSR_PENDSVSET;
}

void pendsv_handler(void)
{
    uint8_t data[PORT_CHUNK_MAX];
    size_t count;
    while ((count = port_take(data)) > 0) {
        bridge_on_received(&bridge, timing_us(), data, count);
    }
    woken = true;
}

void program_run(const struct board *board, program_read read)
{
    read_inputs = read;
    irq_disable();
    SCB_SHPR3 = (uint32_t)PRIORITY_BRIDGE << 28 | (uint32_t)PRIORITY_BRIDGE << 20;
    bridge_init(&bridge, board);
    port_open();
    irq_enable_all();
    for (;;) {
        woken = false;
        bridge_poll(&bridge);
        port_push();
        irq_disable();
        if (!woken) {
            wait_for_interrupt(); /* wakes though interrupts are off */
        }
        irq_enable_all();
    }
}
