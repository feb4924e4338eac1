"""Figures and results of analyses, made up."""

from typing import Any

from motord.verdict.decision import Figure, FigureVerdict, Tolerance, decide

RISK = 0.025


def figure(
    value: float | None = 1.0,
    u: float | None = 0.1,
    freedom: float | None = None,
    doubt: str = "",
    name: str = "alpha, phase a",
) -> Figure:
    return Figure(name, "", value, u, freedom, doubt)


def decided(
    value: float | None,
    low: float | None = None,
    high: float | None = None,
    risk: float = RISK,
    **more: Any,
) -> FigureVerdict:
    return decide(figure(value, **more), Tolerance(low, high), risk)


def contribution(type_: str, alpha: float = 0.0, cogging_Nm: float = 0.0) -> dict[str, Any]:
    return {
        "source": "made up", "type": type_, "basis": "data" if type_ == "A" else "assumed",
        "alpha": [alpha] * 3, "beta_A": [0.0] * 3, "delta_epsilon": alpha,
        "cogging_Nm": cogging_Nm,
    }  # fmt: skip


def calibration(**changes: Any) -> dict[str, Any]:
    """Return the JSON result of a calibration with Type A 0.003 of alpha and Type B 0.004."""
    return {
        "alpha": [0.8, 1.0, 1.25],
        "alpha_stderr": [0.003, 0.003, 0.003],
        "beta_A": [0.0, 0.1, -0.1],
        "beta_stderr_A": [0.01, 0.01, 0.01],
        "delta_epsilon": 1.01,
        "degrees_of_freedom": {"alpha": [4.0, 5.0, 6.0], "beta_A": [4.0] * 3, "delta_epsilon": 4},
        "tau_cog_harmonics": [
            {"order": 48, "amplitude_Nm": 0.3, "stderr_Nm": 0.003, "degrees_of_freedom": 3.0},
            {"order": 96, "amplitude_Nm": 0.06, "stderr_Nm": None},
        ],
        "budget": [contribution("A", 0.003, 0.003), contribution("B", 0.004, 0.004)],
        "findings": [],
        **changes,
    }
