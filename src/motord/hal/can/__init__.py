"""CAN buses: what a driver asks of one, SocketCAN, the interfaces of python-can."""
