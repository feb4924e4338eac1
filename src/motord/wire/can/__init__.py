"""A drive's CAN messages, from its DBC."""

import motord.python_can  # noqa: F401  # before cantools, which loads python-can as it comes
