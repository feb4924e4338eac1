"""Control kernel and simulated rig in virtual time: bench, plans, meshes on all processors."""

from motord.virtual.bench import VirtualBench as VirtualBench
from motord.virtual.mesh import MeshPiece as MeshPiece
from motord.virtual.mesh import processors as processors
from motord.virtual.mesh import run_points as run_points
from motord.virtual.plan import PlanFailed as PlanFailed
from motord.virtual.plan import run_plan as run_plan
