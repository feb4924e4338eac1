"""Random and mutated input for every parser: what each target is given and what must hold."""
