"""The wait of the very first run, explained."""

from pathlib import Path

from motord.cli.console import remark


def explain_first_run(*, silent: bool = False) -> None:
    """Say on stderr that the kernels are being compiled, if none of this version are kept yet."""
    import numba

    import motord.jit  # noqa: F401 - it names the cache

    if not silent and not Path(numba.config.CACHE_DIR).exists():  # type: ignore[attr-defined]
        remark("first run: compiling the numerical kernels, which takes a minute or two, once")
