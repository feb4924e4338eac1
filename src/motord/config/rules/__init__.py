"""What must hold between the tables of a bench: rules that yield what is wrong, and the remedy."""
