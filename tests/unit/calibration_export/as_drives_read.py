"""Exported files read as the drives do, a number at a time, without motord's own code."""

import csv
import json
import math
import re
from collections.abc import Callable

Reader = Callable[[float], float]
"""From the drive's angle in turns to what it adds."""


def linear(entries: list[float], turns: float) -> float:
    """moteus' fw/bldc_servo_control.h, and what the header for C says."""
    left = min(len(entries) - 1, math.floor(len(entries) * turns))
    right = (left + 1) % len(entries)
    fraction = (turns - left / len(entries)) * len(entries)
    return entries[left] + (entries[right] - entries[left]) * fraction


def moteus(text: str) -> Reader:
    """As `moteus_tool --restore-config` takes the lines."""
    config = {}
    for line in text.splitlines():
        stripped = line.split("#")[0].rstrip()
        if stripped:
            name, value = stripped.split()
            assert name not in config
            config[name] = value
    scale = float(config.pop("motor.cogging_dq_scale"))
    integers = [int(config.pop(f"motor.cogging_dq_comp.{i}")) for i in range(1024)]
    assert not config
    assert all(-128 <= each <= 127 for each in integers)
    entries = [scale * each for each in integers]
    return lambda turns: linear(entries, turns)


def odrive(text: str) -> Reader:
    """cogging_map[mod((int)(pos_estimate * 3600), 3600)] of positions from 0 on."""
    entries = json.loads(text)["cogging_map_Nm"]
    assert len(entries) == 3600
    return lambda turns: entries[int(turns * 3600) % 3600]


def table_of_csv(text: str, column: str) -> Reader:
    """By the angles that it names."""
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    assert [float(row["angle_rad"]) for row in rows] == [
        float(f"{math.tau * i / len(rows):.9g}") for i in range(len(rows))
    ]
    entries = [float(row[column]) for row in rows]
    return lambda turns: linear(entries, turns)


def table_of_c(text: str, quantity: str) -> Reader:
    """By its own scale."""
    scale = re.search(rf"{quantity.upper()}_SCALE_\w+ (\S+)f$", text, re.MULTILINE)
    body = re.search(rf"motord_compensation_{quantity}\[.*?\{{(.*?)\}}", text, re.DOTALL)
    assert scale is not None
    assert body is not None
    entries = [float(scale[1]) * int(each) for each in body[1].split(",") if each.strip()]
    return lambda turns: linear(entries, turns)


def beckhoff(text: str) -> Reader:
    """r sin(n angle + phi) of ten coefficients."""
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    assert [row["object"] for row in rows] == [f"32CB:{i:02X}" for i in range(0x07, 0x25)]
    values = [float(row["value"]) for row in rows]
    terms = [values[i : i + 3] for i in range(0, 30, 3)]
    assert all(0 <= n <= 200 and 0 <= phi <= 360 and r >= 0 for n, phi, r in terms)
    return lambda turns: sum(
        r * math.sin(math.tau * n * turns + math.radians(phi)) for n, phi, r in terms
    )


READERS: dict[tuple[str, str], Callable[[str], Reader]] = {
    ("moteus", "current"): moteus,
    ("odrive", "torque"): odrive,
    ("csv", "torque"): lambda text: table_of_csv(text, "torque_Nm"),
    ("csv", "current"): lambda text: table_of_csv(text, "current_A"),
    ("c-header", "torque"): lambda text: table_of_c(text, "torque"),
    ("c-header", "current"): lambda text: table_of_c(text, "current"),
    ("beckhoff-harmonics", "torque"): beckhoff,
}
"""Of each format and quantity."""
