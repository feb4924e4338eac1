"""The unit of a quantity, by the end of its name: torque_Nm, speed_rad_s, ripple_percent."""

UNITS = {
    "A": "A", "mA": "mA", "V": "V", "W": "W", "J": "J", "ohm": "ohm", "Hz": "Hz", "C": "degC",
    "s": "s", "ms": "ms", "us": "us", "ns": "ns", "per_s": "1/s", "MB": "MB", "ppm": "ppm",
    "rad": "rad", "rad_s": "rad/s", "rad_s2": "rad/s2", "per_rad2": "1/rad2",
    "Nm": "Nm", "mNm": "mNm", "Nm_per_rad": "Nm/rad", "Nm_s_per_rad": "Nm s/rad",
    "Nm_per_s": "Nm/s", "Nm_per_V": "Nm/V", "V_s_per_rad": "V s/rad", "V_per_count": "V/count",
    "m": "m", "kg": "kg", "kg_m2": "kg m2", "N_per_m": "N/m",
    "K": "K", "K_per_W": "K/W", "W_per_K": "W/K", "J_per_K": "J/K", "K_per_min": "K/min",
    "K_per_A2": "K/A2", "per_K": "1/K", "percent_per_K": "%/K", "percent": "%",
    "points": "encoder points", "counts": "counts",
}  # fmt: skip
"""Unit by suffix; the longest counts."""

_LONGEST_FIRST = sorted(UNITS, key=len, reverse=True)


def split_unit(name: str) -> tuple[str, str]:
    """Return a name without its suffix, and the suffix, "" if it has none."""
    suffix = next((end for end in _LONGEST_FIRST if name.endswith(f"_{end}")), "")
    return name.removesuffix(f"_{suffix}") if suffix else name, suffix


def unit_of(name: str) -> str:
    """Return the unit of a quantity, "" for none."""
    return UNITS.get(split_unit(name)[1], "")
