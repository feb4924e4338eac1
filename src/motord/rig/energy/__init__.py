"""Where the energy goes: DC supply, losses, work at the shaft; and the temperatures that follow."""
