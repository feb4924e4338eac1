/* The torque sensor on ADC1: converted all the time, the latest conversions in a ring. */
#ifndef STM32F405_ADC_H
#define STM32F405_ADC_H

#include <stdbool.h>
#include <stdint.h>

#define ADC_OVERSAMPLING 16U /* conversions of 1.29 us: the mean is 10.3 us old */

/* Start converting PA1; the clocks of ADC1 and DMA2 are on. */
void adc_start(void);

/* Copy the latest conversions, 0 to 4095. False if the converter or its DMA stream stopped; they
 * are started again. */
bool adc_latest(uint16_t conversions[ADC_OVERSAMPLING]);

#endif
