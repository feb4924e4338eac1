"""The package python-can, loaded without its reader and writer of MF4 files.

Where asammdf is installed, `import can` loads it for these, and with it pandas and pyarrow: 0.45 s
of processor time in each process that talks CAN, the loop's among them.
"""

from motord.process.hidden_packages import hidden

with hidden("asammdf"):
    import can

__all__ = ["can"]
