"""Motion of the rotor: free, decaying, swinging on a spring, or turned by the external drive."""
