"""The text of bench files: what keys mean, values as TOML, edits in place."""
