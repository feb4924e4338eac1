#include "timing.h"

#include "clocks.h"
#include "registers.h"

#define RELOAD_MAX UINT32_C(0xFFFFFF)
#define SYSTICK_RUN (SYST_CSR_ENABLE | SYST_CSR_TICKINT | SYST_CSR_CLKSOURCE)

void timing_start(uint32_t timer_Hz)
{
    TIM5->PSC = timer_Hz / 1000000 - 1;
    TIM5->ARR = UINT32_MAX;
    TIM5->EGR = TIM_EGR_UG; /* the prescaler takes effect */
    TIM5->CNT = 0;
    TIM5->CR1 = TIM_CR1_CEN;
}

uint32_t timing_us(void)
{
    return TIM5->CNT;
}

bool timing_set_rate(uint32_t rate_Hz)
{
    if (rate_Hz == 0 || CORE_HZ / rate_Hz - 1 > RELOAD_MAX) {
        return false;
    }
    SYST_CSR = 0;
    SYST_RVR = CORE_HZ / rate_Hz - 1;
    SYST_CVR = 0;
    SYST_CSR = SYSTICK_RUN;
    return true;
}
