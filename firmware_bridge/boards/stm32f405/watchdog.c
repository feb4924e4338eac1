#include "watchdog.h"

#include "registers.h"

#define PRESCALER_4 0U
#define RELOAD 160U /* of 8 kHz */

void watchdog_start(void)
{
    IWDG->KR = IWDG_KR_START;
    IWDG->KR = IWDG_KR_UNLOCK;
    IWDG->PR = PRESCALER_4;
    IWDG->RLR = RELOAD;
    IWDG->KR = IWDG_KR_FEED;
}

void watchdog_feed(void) { IWDG->KR = IWDG_KR_FEED; }
