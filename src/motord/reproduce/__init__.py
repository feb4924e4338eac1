"""`motord reproduce`: Poels 2008 on the simulated rig, on one page; `motord demo`: its calibration.

Every experiment runs in virtual time, is recorded, and is analysed from its recording as any other
would be; the page sets the report's figures, tables and numbers next to what was found.
"""
