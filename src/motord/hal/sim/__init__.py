"""The simulated rig in the loop."""
