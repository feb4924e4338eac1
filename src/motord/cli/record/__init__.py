"""Commands on recordings: looked into, repaired, exported, imported."""
