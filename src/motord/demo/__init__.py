"""`motord demo`: calibrate the simulated rig in virtual time and judge it by its truth."""

from motord.demo.report import write_report
from motord.demo.run import STAGES, Demo, run_demo

__all__ = ["STAGES", "Demo", "run_demo", "write_report"]
