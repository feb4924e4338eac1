"""Plans on the bench: run, journalled, resumed."""
