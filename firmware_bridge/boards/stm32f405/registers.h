/* The registers of the STM32F405 that the bridge uses, named as in ST's reference manual RM0090 and
 * Arm's ARMv7-M manual (DDI 0403). Only those used are here.
 * What QEMU does not have is where stm32f405.ld says, so that tests can put it into RAM. */
#ifndef STM32F405_REGISTERS_H
#define STM32F405_REGISTERS_H

#include <stdint.h>

#define BIT(n) (UINT32_C(1) << (n))

typedef volatile uint32_t reg;

/* ---- core: ARMv7-M system control space ---------------------------------------------------- */
#define NVIC_ISER(n) (((reg *)0xE000E100)[n])
#define NVIC_IPR(irq) (((volatile uint8_t *)0xE000E400)[irq])
#define SCB_ICSR (*(reg *)0xE000ED04)
#define SCB_VTOR (*(reg *)0xE000ED08)
#define SCB_AIRCR (*(reg *)0xE000ED0C)
#define SCB_SHPR3 (*(reg *)0xE000ED20)
#define AIRCR_SYSRESETREQ (UINT32_C(0x05FA0000) | BIT(2))

#define ICSR_PENDSVSET BIT(28)
#define SYST_CSR (*(reg *)0xE000E010)
#define SYST_RVR (*(reg *)0xE000E014)
#define SYST_CVR (*(reg *)0xE000E018)
#define SYST_CSR_ENABLE BIT(0)
#define SYST_CSR_TICKINT BIT(1)
#define SYST_CSR_CLKSOURCE BIT(2)

/* ---- RCC: clocks ---------------------------------------------------------------------------- */
typedef struct {
    reg CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, reserved0, APB1RSTR, APB2RSTR;
    reg reserved1[2], AHB1ENR, AHB2ENR, AHB3ENR, reserved2, APB1ENR, APB2ENR;
    reg reserved3[2], AHB1LPENR, AHB2LPENR, AHB3LPENR, reserved4, APB1LPENR, APB2LPENR;
    reg reserved5[2], BDCR, CSR;
} rcc_registers;
extern rcc_registers rcc_block;
#define RCC (&rcc_block)
#define RCC_CR_HSEON BIT(16)
#define RCC_CR_HSERDY BIT(17)
#define RCC_CR_CSSON BIT(19)
#define RCC_CR_PLLON BIT(24)
#define RCC_CR_PLLRDY BIT(25)
#define RCC_PLLCFGR_PLLSRC_HSE BIT(22)
#define RCC_CFGR_SW_PLL UINT32_C(2)
#define RCC_CFGR_SWS_MASK (UINT32_C(3) << 2)
#define RCC_CFGR_SWS_PLL (UINT32_C(2) << 2)
#define RCC_CFGR_PPRE1_DIV4 (UINT32_C(5) << 10)
#define RCC_CFGR_PPRE2_DIV2 (UINT32_C(4) << 13)
#define RCC_AHB1ENR_GPIOA BIT(0)
#define RCC_AHB1ENR_GPIOB BIT(1)
#define RCC_AHB1ENR_GPIOC BIT(2)
#define RCC_AHB1ENR_DMA2 BIT(22)
#define RCC_APB1ENR_TIM5 BIT(3)
#define RCC_APB1ENR_CAN1 BIT(25)
#define RCC_APB2ENR_USART1 BIT(4)
#define RCC_APB2ENR_ADC1 BIT(8)

/* ---- flash interface ------------------------------------------------------------------------ */
extern reg flash_block;
#define FLASH_ACR flash_block
#define FLASH_ACR_LATENCY_5WS UINT32_C(5)
#define FLASH_ACR_LATENCY_MASK UINT32_C(7)
#define FLASH_ACR_PRFTEN BIT(8)
#define FLASH_ACR_ICEN BIT(9)
#define FLASH_ACR_DCEN BIT(10)

/* ---- GPIO ----------------------------------------------------------------------------------- */
typedef struct {
    reg MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFRL, AFRH;
} gpio_registers;
extern gpio_registers gpioa_block, gpiob_block, gpioc_block;
#define GPIOA (&gpioa_block)
#define GPIOB (&gpiob_block)
#define GPIOC (&gpioc_block)

/* ---- USART ---------------------------------------------------------------------------------- */
typedef struct {
    reg SR, DR, BRR, CR1, CR2, CR3, GTPR;
} usart_registers;
#define USART1 ((usart_registers *)0x40011000)
#define USART2 ((usart_registers *)0x40004400)
#define USART_SR_ORE BIT(3)
#define USART_SR_RXNE BIT(5)
#define USART_SR_TXE BIT(7)
#define USART_CR1_RE BIT(2)
#define USART_CR1_TE BIT(3)
#define USART_CR1_RXNEIE BIT(5)
#define USART_CR1_TXEIE BIT(7)
#define USART_CR1_UE BIT(13)

/* ---- general-purpose timer (TIM5 counts 32 bits) --------------------------------------------- */
typedef struct {
    reg CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR;
} tim_registers;
#define TIM5 ((tim_registers *)0x40000C00)
#define TIM_CR1_CEN BIT(0)
#define TIM_EGR_UG BIT(0)

/* ---- ADC and its DMA stream ----------------------------------------------------------------- */
typedef struct {
    reg SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_registers;
extern adc_registers adc1_block;
extern reg adc_ccr_block;
#define ADC1 (&adc1_block)
#define ADC_CCR adc_ccr_block
#define ADC_SR_OVR BIT(5)
#define ADC_CR2_ADON BIT(0)
#define ADC_CR2_CONT BIT(1)
#define ADC_CR2_DMA BIT(8)
#define ADC_CR2_DDS BIT(9)
#define ADC_CR2_SWSTART BIT(30)
#define ADC_CCR_ADCPRE_DIV4 (UINT32_C(1) << 16)

typedef struct {
    reg CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_registers;
typedef struct {
    reg LISR, HISR, LIFCR, HIFCR;
    dma_stream_registers S[8];
} dma_registers;
extern dma_registers dma2_block;
#define DMA2 (&dma2_block)
#define DMA_CR_EN BIT(0)
#define DMA_CR_CIRC BIT(8)
#define DMA_CR_MINC BIT(10)
#define DMA_CR_PSIZE_16 (UINT32_C(1) << 11)
#define DMA_CR_MSIZE_16 (UINT32_C(1) << 13)
#define DMA_CR_PL_HIGH (UINT32_C(2) << 16)
#define DMA_LIFCR_STREAM0 UINT32_C(0x3D)

/* ---- independent watchdog ------------------------------------------------------------------- */
typedef struct {
    reg KR, PR, RLR, SR;
} iwdg_registers;
extern iwdg_registers iwdg_block;
#define IWDG (&iwdg_block)
#define IWDG_KR_UNLOCK UINT32_C(0x5555)
#define IWDG_KR_FEED UINT32_C(0xAAAA)
#define IWDG_KR_START UINT32_C(0xCCCC)

/* ---- bxCAN ---------------------------------------------------------------------------------- */
typedef struct {
    reg TIR, TDTR, TDLR, TDHR;
} can_transmit_registers;
typedef struct {
    reg RIR, RDTR, RDLR, RDHR;
} can_receive_registers;
typedef struct {
    reg MCR, MSR, TSR, RF0R, RF1R, IER, ESR, BTR, reserved0[88];
    can_transmit_registers T[3];
    can_receive_registers R[2];
    reg reserved1[12], FMR, FM1R, reserved2, FS1R, reserved3, FFA1R, reserved4, FA1R, reserved5[8];
    struct {
        reg FR1, FR2;
    } F[28];
} can_registers;
extern can_registers can1_block;
#define CAN1 (&can1_block)
#define CAN_MCR_INRQ BIT(0)
#define CAN_MCR_TXFP BIT(2)
#define CAN_MCR_ABOM BIT(6)
#define CAN_MSR_INAK BIT(0)
#define CAN_TSR_RQCP_ALL (BIT(0) | BIT(8) | BIT(16))
#define CAN_TSR_TME0 BIT(26)
#define CAN_TIR_TXRQ BIT(0)
#define CAN_RF0R_FMP_MASK UINT32_C(3)
#define CAN_RF0R_RFOM BIT(5)
#define CAN_IER_TMEIE BIT(0)
#define CAN_IER_FMPIE0 BIT(1)
#define CAN_ID_IDE BIT(2)
#define CAN_ID_RTR BIT(1)
#define CAN_FMR_FINIT BIT(0)

/* ---- interrupt numbers ---------------------------------------------------------------------- */
#define IRQ_CAN1_TX 19
#define IRQ_CAN1_RX0 20
#define IRQ_USART1 37
#define IRQ_USART2 38
#define IRQ_COUNT 82

static inline void irq_enable(uint32_t irq, uint8_t priority)
{
    NVIC_IPR(irq) = (uint8_t)(priority << 4);
    NVIC_ISER(irq / 32) = BIT(irq % 32);
}

static inline void irq_disable(void) { __asm volatile("cpsid i" ::: "memory"); }

static inline void irq_enable_all(void) { __asm volatile("cpsie i" ::: "memory"); }

static inline uint32_t irq_save(void)
{
    uint32_t primask;
    __asm volatile("mrs %0, primask\n\tcpsid i" : "=r"(primask)::"memory");
    return primask;
}

static inline void irq_restore(uint32_t primask)
{
    __asm volatile("msr primask, %0" ::"r"(primask) : "memory");
}

static inline void wait_for_interrupt(void)
{
    __asm volatile("wfi" ::: "memory");
}

#endif
