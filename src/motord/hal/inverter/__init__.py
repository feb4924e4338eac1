"""The inverter on CAN, by phase currents or by currents along d and q."""
