/* The link on bxCAN: classic CAN at 1 Mbit/s. Pins PA11 (receive) and PA12 (transmit). */
#include <string.h>

#include "clocks.h"
#include "pins.h"
#include "port.h"
#include "program.h"
#include "startup.h"

#ifndef CAN_HOST_ID
#define CAN_HOST_ID 0x110U /* what the host sends, 11 bit */
#endif
#ifndef CAN_BOARD_ID
#define CAN_BOARD_ID 0x190U /* what the board sends */
#endif

/* 42 MHz / 3 = 14 quanta a bit: 1 + 11 + 2, sampled at 86 %, resynchronised by up to 2. */
#define PRESCALER 3U
#define SEGMENT_1 11U
#define SEGMENT_2 2U
#define JUMP_WIDTH 2U
#define BIT_HZ 1000000U
_Static_assert(APB1_HZ == BIT_HZ * PRESCALER * (1 + SEGMENT_1 + SEGMENT_2), "bit timing");

#define PATIENCE 1000000U
#define RELEASE_TURNS 10U

enum { RING_FRAMES_MAX = 64, MAILBOXES = 3 }; /* the ring's size is a power of two */

struct can_frame {
    uint32_t words[2];
    uint8_t count;
};

struct can_ring {
    volatile uint32_t head, tail; /* frames put in and taken out so far */
    struct can_frame frames[RING_FRAMES_MAX];
};

const enum board_link port_link = BOARD_LINK_CAN;

static struct can_ring received, sent;

static uint32_t held(const struct can_ring *ring) { return ring->head - ring->tail; }

static struct can_frame *at(struct can_ring *ring, uint32_t index)
{
    return &ring->frames[index % RING_FRAMES_MAX];
}

static void accept_host_only(void)
{
    CAN1->FMR |= CAN_FMR_FINIT;
    CAN1->FA1R = 0;
    CAN1->FS1R = BIT(0); /* one filter of 32 bits: identifier and mask, into FIFO 0 */
    CAN1->FM1R = 0;
    CAN1->FFA1R = 0;
    CAN1->F[0].FR1 = CAN_HOST_ID << 21;
    CAN1->F[0].FR2 = UINT32_C(0x7FF) << 21 | CAN_ID_IDE | CAN_ID_RTR;
    CAN1->FA1R = BIT(0);
    CAN1->FMR &= ~CAN_FMR_FINIT;
}

void port_open(void)
{
    RCC->APB1ENR |= RCC_APB1ENR_CAN1;
    pins_alternate(GPIOA, 11, 9);
    pins_alternate(GPIOA, 12, 9);
    CAN1->MCR = CAN_MCR_INRQ;
    for (uint32_t turn = 0; turn < PATIENCE && !(CAN1->MSR & CAN_MSR_INAK); turn++) {
    }
    CAN1->MCR = CAN_MCR_INRQ | CAN_MCR_TXFP | CAN_MCR_ABOM; /* in order; back after bus-off */
    CAN1->BTR = (JUMP_WIDTH - 1) << 24 | (SEGMENT_2 - 1) << 20 | (SEGMENT_1 - 1) << 16 |
                (PRESCALER - 1);
    accept_host_only();
    CAN1->IER = CAN_IER_TMEIE | CAN_IER_FMPIE0;
    CAN1->MCR = CAN_MCR_TXFP | CAN_MCR_ABOM; /* on the bus after 11 recessive bits */
    irq_enable(IRQ_CAN1_RX0, PRIORITY_BYTES);
    irq_enable(IRQ_CAN1_TX, PRIORITY_BYTES);
}

bool port_send(const uint8_t *data, size_t count)
{
    if (held(&sent) == RING_FRAMES_MAX) {
        return false;
    }
    struct can_frame *frame = at(&sent, sent.head);
    memcpy(frame->words, data, count);
    frame->count = (uint8_t)count;
    __asm volatile("" ::: "memory");
    sent.head++;
    return true;
}

static void fill_mailboxes(void)
{
    for (uint32_t box = 0; box < MAILBOXES && held(&sent) > 0; box++) {
        if (CAN1->TSR & CAN_TSR_TME0 << box) {
            const struct can_frame *frame = at(&sent, sent.tail);
            CAN1->T[box].TDTR = frame->count;
            CAN1->T[box].TDLR = frame->words[0];
            CAN1->T[box].TDHR = frame->words[1];
            CAN1->T[box].TIR = CAN_BOARD_ID << 21 | CAN_TIR_TXRQ;
            sent.tail++;
        }
    }
}

void port_push(void)
{
    uint32_t primask = irq_save();
    fill_mailboxes();
    irq_restore(primask);
}

size_t port_take(uint8_t *data)
{
    if (held(&received) == 0) {
        return 0;
    }
    const struct can_frame *frame = at(&received, received.tail);
    size_t count = frame->count;
    memcpy(data, frame->words, count);
    __asm volatile("" ::: "memory");
    received.tail++;
    return count;
}

void can1_tx_handler(void)
{
    CAN1->TSR = CAN_TSR_RQCP_ALL; /* acknowledges; the other bits are not written by 0 */
    fill_mailboxes();
}

void can1_rx0_handler(void)
{
    while (CAN1->RF0R & CAN_RF0R_FMP_MASK) {
        uint32_t count = CAN1->R[0].RDTR & 0xF;
        if (count > 0 && held(&received) < RING_FRAMES_MAX) { /* to port_take 0 says: no more */
            struct can_frame *frame = at(&received, received.head);
            frame->count = (uint8_t)(count < 8 ? count : 8);
            frame->words[0] = CAN1->R[0].RDLR;
            frame->words[1] = CAN1->R[0].RDHR;
            __asm volatile("" ::: "memory");
            received.head++;
        }
        CAN1->RF0R = CAN_RF0R_RFOM;
        for (uint32_t turn = 0; turn < RELEASE_TURNS && CAN1->RF0R & CAN_RF0R_RFOM; turn++) {
            /* two cycles, until the mailbox is released */
        }
    }
    program_received();
}
