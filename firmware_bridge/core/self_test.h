/* What the core tests of itself at boot: that this build, on this processor, computes right. */
#ifndef CORE_SELF_TEST_H
#define CORE_SELF_TEST_H

#include <stdbool.h>

/* True if checksums, stuffing, Gray code and the enable line's judgement give what they
 * must. Main context, once. */
bool self_test(void);

#endif
