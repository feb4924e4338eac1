"""A drive's CAN messages, from its DBC."""
