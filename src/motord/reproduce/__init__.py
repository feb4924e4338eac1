"""`motord reproduce`: the experiments of Poels 2008 on the simulated rig, on one page.

Every experiment runs in virtual time, is recorded, and is analysed from its recording as any other
would be; the page sets the report's figures, tables and numbers beside what was found.
"""

from motord.reproduce.page import write_page
from motord.reproduce.run import STAGES, Found, reproduce

__all__ = ["STAGES", "Found", "reproduce", "write_page"]
