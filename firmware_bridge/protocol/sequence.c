#include "protocol/sequence.h"

uint32_t sequence_errors(const struct sequence_check *check)
{
    return check->errors + check->corrupt;
}

void sequence_corrupt(struct sequence_check *check) { check->corrupt++; }

void sequence_restart(struct sequence_check *check) { check->known = false; }

bool sequence_accept(struct sequence_check *check, uint16_t number, bool may_restart)
{
    uint32_t missing = 0;
    if (check->known) {
        missing = (uint16_t)(number - check->expected);
        const bool repeats = missing == 0xFFFFU;
        const bool steps_back = missing > 0x8000U;
        if (repeats || (steps_back && !may_restart)) {
            check->corrupt++;
            return false;
        }
        if (steps_back) {
            missing = 1;
        }
    }
    check->known = true;
    check->expected = (uint16_t)(number + 1U);
    check->errors += missing > check->corrupt ? missing : check->corrupt;
    check->corrupt = 0;
    return true;
}
