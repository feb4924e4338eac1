"""Control kernel and simulated rig in virtual time: bench, plans, meshes on all processors."""

from motord.virtual.bench import VirtualBench
from motord.virtual.mesh import MeshPiece, processors, run_points
from motord.virtual.plan import PlanFailed, run_plan

__all__ = ["MeshPiece", "PlanFailed", "VirtualBench", "processors", "run_plan", "run_points"]
