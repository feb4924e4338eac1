"""RPCs: taken in, dispatched, answered."""
