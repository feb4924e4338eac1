"""Hardware abstraction: one small class a device, a registry, a simulated rig as one more."""
