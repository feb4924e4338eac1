"""The mesh that fills: what has become of each operating point of a plan. Pure.

A view is never changed; each function returns the next one.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from motord.api.plan_messages import MESH_POINTS_MAX, MeshPoint, MeshView
from motord.calibration import magnitudes_differ
from motord.sequencing import NOTHING_INDUCED, Executor, OperatingPoint
from motord.sequencing.capture import final
from motord.sequencing.quality import GOOD


def planned(name: str, run_id: str, points: Sequence[OperatingPoint]) -> MeshView:
    """Return the mesh of a plan of which nothing is taken."""
    return MeshView(
        plan=name,
        run_id=run_id,
        points_total=len(points),
        by_magnitude=magnitudes_differ(
            (point.torque_Nm, point.speed_Hz)
            for point in points
            if point.induced == NOTHING_INDUCED
        ),
        points=[
            MeshPoint(
                point=point.index,
                torque_Nm=point.torque_Nm,
                speed_Hz=point.speed_Hz,
                turns=point.turns,
                aim=point.aim,
                induced={} if point.induced == NOTHING_INDUCED else asdict(point.induced),
            )
            for point in points
        ],
    )


def with_captures(mesh: MeshView, captures: Iterable[Mapping[str, Any]]) -> MeshView:
    """Return the mesh after captures, each as the topic `/operating_point` has it."""
    points = {point.point: point for point in mesh.points}
    for captured in captures:
        index = int(captured["index"])
        if index in points:
            points[index] = points[index].model_copy(update=_outcome(captured))
    return mesh.model_copy(update={"points": list(points.values())})


def with_taken(mesh: MeshView, taken: Iterable[int]) -> MeshView:
    """Return the mesh after points of which no more is known than that they are taken."""
    known = set(taken)
    points = [
        point.model_copy(update={"state": "done"})
        if point.point in known and point.state in ("planned", "taking")
        else point
        for point in mesh.points
    ]
    return mesh.model_copy(update={"points": points})


def with_under_way(mesh: MeshView, point: int | None) -> MeshView:
    """Return the mesh with `point` as the one that is being taken, or none."""
    points = [_under_way(one, point) for one in mesh.points]
    return mesh.model_copy(update={"points": points})


def under_way(executor: Executor) -> int | None:
    """Return the number of the point that is being taken, also while the plan is paused."""
    left = executor.plan.points[executor.points_done :]
    return left[0].index if left and not executor.over else None


def window(mesh: MeshView) -> MeshView:
    """Return the mesh as published: of a plan with more points those about the one under way."""
    if len(mesh.points) <= MESH_POINTS_MAX:
        return mesh
    states = [point.state for point in mesh.points]
    at = next((n for n, state in enumerate(states) if state in ("taking", "planned")), len(states))
    first = min(max(at - MESH_POINTS_MAX // 2, 0), len(states) - MESH_POINTS_MAX)
    return mesh.model_copy(update={"points": mesh.points[first : first + MESH_POINTS_MAX]})


def _outcome(captured: Mapping[str, Any]) -> dict[str, Any]:
    quality = str(captured.get("quality", GOOD))
    state = "taking" if not final(captured) else "done" if quality == GOOD else "poor"
    errors = {name: captured.get(name) for name in ("rms_error_percent", "mean_error_percent")}
    return {"state": state, "takes": int(captured.get("take", 1)), "quality": quality, **errors}


def _under_way(point: MeshPoint, under_way: int | None) -> MeshPoint:
    if point.state not in ("planned", "taking"):
        return point
    state = "taking" if point.point == under_way else "planned"
    return point if point.state == state else point.model_copy(update={"state": state})
