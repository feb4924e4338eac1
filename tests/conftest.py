"""Settings of hypothesis: no deadlines (kernels compile on first use), fewer cases interpreted."""

import os

from hypothesis import HealthCheck, settings

settings.register_profile(
    "motord", deadline=None, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.register_profile("interpreted", parent=settings.get_profile("motord"), max_examples=8)
settings.load_profile("interpreted" if os.environ.get("NUMBA_DISABLE_JIT") == "1" else "motord")
