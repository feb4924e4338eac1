"""Brake and external drive over Modbus."""
