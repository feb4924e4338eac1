"""Commands that watch and operate a bench by hand."""
