#include "clocks.h"

#include "registers.h"

#ifndef HSE_HZ
#define HSE_HZ 8000000U
#endif
#define HSI_HZ 16000000U
#define PLL_IN_HZ 1000000U
#define PLL_N (2 * CORE_HZ / PLL_IN_HZ) /* the PLL's own frequency is halved, P = 2 */
#define PLL_Q 7U

#define PATIENCE 200000 /* turns of a waiting loop, at 16 MHz some 0.1 s: a crystal needs 2 ms */

_Static_assert(HSE_HZ % PLL_IN_HZ == 0 && HSE_HZ >= 4000000 && HSE_HZ <= 26000000,
               "HSE_HZ is whole megahertz from 4 to 26");

static bool wait_for(const reg *where, uint32_t mask, uint32_t value)
{
    for (uint32_t turn = 0; turn < PATIENCE; turn++) {
        if ((*where & mask) == value) {
            return true;
        }
    }
    return false;
}

bool clocks_start(void)
{
    RCC->CR |= RCC_CR_HSEON;
    bool crystal = wait_for(&RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY);
    uint32_t source_Hz = crystal ? HSE_HZ : HSI_HZ;
    RCC->PLLCFGR = source_Hz / PLL_IN_HZ | PLL_N << 6 | PLL_Q << 24 |
                   (crystal ? RCC_PLLCFGR_PLLSRC_HSE : 0);
    RCC->CFGR = RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2;
    FLASH_ACR = FLASH_ACR_LATENCY_5WS | FLASH_ACR_PRFTEN | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    RCC->CR |= RCC_CR_PLLON;
    if (!wait_for(&FLASH_ACR, FLASH_ACR_LATENCY_MASK, FLASH_ACR_LATENCY_5WS) ||
        !wait_for(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY)) {
        return false;
    }
    RCC->CFGR |= RCC_CFGR_SW_PLL;
    if (!wait_for(&RCC->CFGR, RCC_CFGR_SWS_MASK, RCC_CFGR_SWS_PLL)) {
        return false;
    }
    if (crystal) {
        RCC->CR |= RCC_CR_CSSON; /* a crystal that fails later is a fault: the line opens */
    }
    return crystal;
}
