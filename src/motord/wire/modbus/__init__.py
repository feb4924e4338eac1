"""Modbus requests and responses, and what the registers mean."""
