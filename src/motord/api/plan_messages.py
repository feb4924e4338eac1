"""Published messages of plans, JSON: `plan` and `mesh`."""

from typing import Any, Literal

from pydantic import Field

from motord.api.published_message import PublishedMessage


class PlanView(PublishedMessage):
    """`motord/<bench>/plan`: a plan's progress. One that was interrupted can be resumed."""

    plan: str
    """Name of the plan."""
    state: Literal[
        "running", "pausing", "paused", "ending", "done", "aborted", "failed", "interrupted"
    ]
    """It is over in `done`, `aborted`, `failed` and, the daemon having ended meanwhile,
    `interrupted`."""
    step: str = ""
    """What it does now."""
    message: str = ""
    """Why it ended, or is paused."""
    points: int = 0
    """Operating points, all."""
    points_done: int = 0
    """Operating points taken."""
    fraction: float = 0.0
    """Of all the work, 0 to 1."""
    elapsed_s: float = 0.0
    """Since its start."""
    eta_s: float = 0.0
    """Until its end, about."""
    speed_set_Hz: float = 0.0
    """Of the point under way, turns per second."""
    torque_set_Nm: float = 0.0
    """Of the point under way."""
    detached: bool = False
    """It goes on without a lease."""
    started_by: str = ""
    """Holder of the lease at its start."""
    serial: str = ""
    """Serial number of the motor, where it was named at the start."""
    recording: str = ""
    """Path of its recording once it is whole."""
    recorded: bool = True
    """False if points that were taken are not in the recording, as if the disk was full."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """With which it was started."""
    run_id: str = ""
    """Stays the same when it is resumed."""
    continues: str = ""
    """The recording that the present one continues."""
    targets: dict[str, float] = Field(default_factory=dict)
    """Half-widths of 95 % intervals, by quantity with its unit, at which it ends early; of a plan
    that does."""
    precision: dict[str, float] = Field(default_factory=dict)
    """Half-widths that the captures so far give, by quantity with its unit, as far as they are
    known."""
    obstacle: str = ""
    """Why it must not end early by them, "" if it may."""
    t_ns: int = 0
    """Unix time at which the document was made; 0 in recordings."""

    @property
    def over(self) -> bool:
        """True once the plan is no longer under way, well or not."""
        return self.state in ("done", "aborted", "failed", "interrupted")


MESH_POINTS_MAX = 1024
"""Points in a published mesh."""


class MeshPoint(PublishedMessage):
    """An operating point of a plan, and what has become of it."""

    point: int
    """`plan_point` of its ticks."""
    torque_Nm: float
    """Its torque."""
    speed_Hz: float
    """Its speed, turns per second."""
    turns: int = 0
    """Turns to be captured."""
    aim: str = ""
    """What is done there, if that is no torque held at a speed."""
    induced: dict[str, Any] = Field(default_factory=dict)
    """Errors that are induced there on purpose."""
    state: Literal["planned", "taking", "done", "poor"] = "planned"
    """What has become of it."""
    takes: int = 0
    """How often it was taken."""
    quality: str = ""
    """"" before the first take, "ok", or what is wrong with the last one."""
    rms_error_percent: float | None = None
    """RMS of measured less set torque about its mean in the last take, percent of rated torque."""
    mean_error_percent: float | None = None
    """Mean of measured less set torque in the last take, percent of rated; null if not sensed."""


class MeshView(PublishedMessage):
    """`motord/<bench>/mesh`: the operating points of the plan under way, or of the last one.

    Of more than `MESH_POINTS_MAX` points, `points_total` in all, those about the one under way.
    """

    plan: str
    """Name of the plan."""
    run_id: str
    """Of its progress."""
    points_total: int
    """Operating points, all."""
    by_magnitude: bool = False
    """Whether magnitudes of torque and speed separate its points, those with induced errors aside:
    so a mesh in both directions is shown as one."""
    points: list[MeshPoint]
    """The points, in the order in which they are taken."""
