"""The bridge board, over a serial port or CAN, and its clock."""
