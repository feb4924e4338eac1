"""The package python-can, loaded without its reader and writer of MF4 files.

Where asammdf is installed, `import can` loads it for these, and with it pandas and pyarrow: 0.45 s
of processor time in each process that talks CAN, the loop's among them.
"""

import sys

MF4_PACKAGE = "asammdf"

_hides = MF4_PACKAGE not in sys.modules
if _hides:
    sys.modules[MF4_PACKAGE] = None  # type: ignore[assignment]  # "not installed", to an import
try:
    import can
finally:
    if _hides:
        del sys.modules[MF4_PACKAGE]

__all__ = ["can"]
