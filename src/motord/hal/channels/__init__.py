"""Sources of slow channels: Modbus, CAN, serial lines of text, and drivers of other packages."""
