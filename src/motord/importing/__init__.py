"""Recordings made elsewhere, CSV, TDMS or MDF, turned into runs: `convert.import_run`.

The source is read twice, block by block: `survey` finds its rate and its operating points,
`convert` writes them. Both see the rows that `rows` lets through, so they agree on them.
"""
