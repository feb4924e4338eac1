"""The back-EMF of a motor: harmonics, or a measured table over the encoder."""

from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, Field, ValidationError

from motord.config.base import ConfigError, Section
from motord.section.complaints import complaints, message
from motord.section.quantities import AngleSigned, BackEmfConstant
from motord.untrusted import parse_json, read_text


class BackEmfHarmonic(Section):
    """One order h of the back-EMF of phase a: k_a = A sin(h pole_pairs theta + phase)."""

    order: Annotated[int, Field(ge=1, le=1000)]
    """Electrical order."""
    amplitude_V_s_per_rad: BackEmfConstant
    """Peak voltage over mechanical speed."""
    phase_rad: AngleSigned = 0.0
    """Phase, in the electrical angle of that order."""


class BackEmfTable(Section):
    """Back-EMF over speed of phases a, b, c at encoder angles 2 pi n / counts, as measured.

    It holds over the encoder's counts: no encoder offset is added. file: where it was read from.
    A recording holds the whole table, not the file's name.
    """

    file: str = ""
    """Where it was read from."""
    k_V_s_per_rad: Annotated[
        tuple[tuple[BackEmfConstant, BackEmfConstant, BackEmfConstant], ...], Field(min_length=1)
    ]
    """Of phases a, b, c at each encoder count."""

    @property
    def values(self) -> np.ndarray:
        """k, shape (counts, 3), V s/rad."""
        return np.asarray(self.k_V_s_per_rad)


def read_back_emf_table(path: Path) -> BackEmfTable:
    """Read a table that `analyse back-emf` wrote. Raises ConfigError.

    Only `k_V_s_per_rad`, shape (counts, 3), is needed of it.
    """
    try:
        content = parse_json(read_text(path))
        return BackEmfTable(file=str(path), k_V_s_per_rad=content["k_V_s_per_rad"])
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the back-EMF table: {error.strerror}") from error
    except ValidationError as error:
        first = complaints(error)[0]
        where = "".join(f"[{part}]" for part in first["loc"][1:])
        raise ConfigError(
            f"{path}: not a back-EMF table: k_V_s_per_rad{where}: {message(first)}"
        ) from None
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{path}: not a back-EMF table: it has no k_V_s_per_rad ({type(error).__name__}); "
            "name a file that `analyse back-emf -o` wrote"
        ) from error


def _read_if_named(value: Any) -> Any:
    return read_back_emf_table(Path(value)) if isinstance(value, str | Path) else value


BackEmf = Annotated[
    Annotated[tuple[BackEmfHarmonic, ...], Field(min_length=1)] | BackEmfTable,
    BeforeValidator(_read_if_named),
]
"""Harmonics, a table, or the name of a file with a table, which is read at once."""
