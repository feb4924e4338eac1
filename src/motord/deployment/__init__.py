"""A bench as a systemd service: which files it takes, written, compared and removed again.

`unit` makes the text of the units from those that ship with motord, `plan` lists the files and the
commands that follow, `files` compares and writes them and remembers which, `host` asks systemd.
"""
