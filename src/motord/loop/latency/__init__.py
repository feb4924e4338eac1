"""How punctual the loop is on a machine, measured in alternation with cyclictest."""
