"""Iterative learning control: corrections of the torque learned at the points of the mesh."""
