#include "adc.h"

#include "registers.h"

#define CHANNEL 1U
#define SAMPLING_15_CYCLES UINT32_C(1)
#define PATIENCE 100U
#define STABILISING_TURNS 150U
#define UNUSED UINT16_C(0xFFFF) /* no conversion gives this */

static volatile uint16_t ring[ADC_OVERSAMPLING];

void adc_start(void)
{
    ADC1->CR2 = 0;
    DMA2->S[0].CR = 0;
    for (uint32_t turn = 0; turn < PATIENCE && DMA2->S[0].CR & DMA_CR_EN; turn++) {
        /* until the transfer that goes on has ended, a few cycles */
    }
    DMA2->LIFCR = DMA_LIFCR_STREAM0;
    for (uint32_t i = 0; i < ADC_OVERSAMPLING; i++) {
        ring[i] = UNUSED;
    }
    DMA2->S[0].PAR = (uint32_t)&ADC1->DR;
    DMA2->S[0].M0AR = (uint32_t)ring;
    DMA2->S[0].NDTR = ADC_OVERSAMPLING;
    DMA2->S[0].CR =
        DMA_CR_CIRC | DMA_CR_MINC | DMA_CR_PSIZE_16 | DMA_CR_MSIZE_16 | DMA_CR_PL_HIGH;
    DMA2->S[0].CR |= DMA_CR_EN;
    ADC_CCR = ADC_CCR_ADCPRE_DIV4; /* 21 MHz; 15 + 12 cycles a conversion */
    ADC1->SMPR2 = SAMPLING_15_CYCLES << (3 * CHANNEL);
    ADC1->SQR1 = 0;
    ADC1->SQR3 = CHANNEL;
    ADC1->SR = 0;
    ADC1->CR2 = ADC_CR2_ADON | ADC_CR2_CONT | ADC_CR2_DMA | ADC_CR2_DDS;
    for (uint32_t turn = 0; turn < STABILISING_TURNS; turn++) {
        (void)ADC1->CR2; /* 3 us until the converter is stable */
    }
    ADC1->CR2 |= ADC_CR2_SWSTART;
}

bool adc_latest(uint16_t conversions[ADC_OVERSAMPLING])
{
    bool all = true;
    for (uint32_t i = 0; i < ADC_OVERSAMPLING; i++) {
        conversions[i] = ring[i];
        ring[i] = UNUSED; /* one still there next time was not converted anew */
        all = all && conversions[i] != UNUSED;
    }
    if (ADC1->SR & ADC_SR_OVR || !(DMA2->S[0].CR & DMA_CR_EN)) {
        adc_start();
        return false;
    }
    return all;
}
