"""Back-EMF of the phases from a rotor driven without current."""
