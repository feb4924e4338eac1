"""Recordings made elsewhere, CSV or TDMS, turned into runs: `import_run`.

The source is read twice, block by block: `survey` finds its rate and its operating points,
`convert` writes them. Both see the rows that `rows` lets through, so they agree on them.
"""

from motord.importing.convert import Imported, import_run
from motord.importing.mapping import ImportMap, load_map

__all__ = ["ImportMap", "Imported", "import_run", "load_map"]
