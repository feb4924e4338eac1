"""The figures of a result, from its JSON: one way for the results of all experiments.

Names say what is what, as everywhere: `x_Nm` is a quantity in Nm, of which `x_stderr_Nm` or
`x_uncertainty_Nm` is the standard error, `x_half_width_Nm` half of the 95 % interval, `x_low_Nm`
and `x_high_Nm` its ends, and `interval_95_Nm` both; where they differ the larger error and the
outermost ends count. Where one of them can be no error (infinite, negative, text, ends the wrong
way round) none of them counts: null alone says that it is not known. `stderr_Nm` without a name is
that of the only quantity in Nm, of several the one that a `FigureKind` says is leading, else the
one that stands before it, `stderr` that of `value`, whose unit is in `unit`.
`degrees_of_freedom` holds for the object that it is in and all in it, `x_degrees_of_freedom` for
the quantity `x_Nm` alone, instead; what is no number there, or below one, counts as one.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

from motord.config.unit_suffixes import UNITS, split_unit
from motord.intervals import coverage_factor
from motord.results.field_names import label_elements, number_elements

NOT_RESULTS = frozenset(
    {
        *("motor", "told", "left_out", "unreached", "learned", "degrees_of_freedom", "freedom"),
        *("repetitions", "time_series", "leakage_percent"),
    }
)
"""Keys of what an analysis was given, did not use, or states of its errors, and of curves."""

OWN_FREEDOM = "_degrees_of_freedom"
"""End of the key of the degrees of freedom of one quantity, after its name without its unit."""

UNREADABLE = ""
"""Degrees of freedom of a place that a list of them does not reach."""

UNIT_STATED = ("value", "limit", "detectable", "bound")
"""Keys whose unit is the one that the object states in `unit`."""

ROLES = ("stderr", "uncertainty", "half_width", "low", "high", "interval_95")
"""What a key states of another one, by the end of its name."""


@dataclass(frozen=True)
class ResultFigure:
    """A quantity of a result with its standard error and 95 % interval; None: not stated."""

    field: str
    unit: str
    value: float
    stderr: float | None = None
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class StatedQuantity:
    """What an object states of a quantity by the names of its keys; None: nothing, or no number.

    low, high: ends of the 95 % interval, both or none. freedom: its own degrees of freedom, else
    those of the object, else those around it. of_error: whether any key is of its error, also one
    that states by null that it is not known, or that can be no error.
    """

    value: float | None
    stderr: float | None
    low: float | None
    high: float | None
    freedom: float | None
    of_error: bool


@dataclass(frozen=True)
class _Around:
    """What holds for an object by where it is: path, suffix of a unit, `freedoms`."""

    path: tuple[str, ...] = ()
    suffix: str = ""
    freedom: tuple[Any, ...] = ()

    def within(self, key: str, suffix: str, freedom: tuple[Any, ...]) -> "_Around":
        return _Around((*self.path, key), suffix or self.suffix, freedom)


def figures(content: Mapping[str, Any], leading: Collection[str] = ()) -> list[ResultFigure]:
    """Return all finite figures of a result, in its order; leading: as of `error_keys`."""
    return list(_of_object(content, _Around(), leading))


def _of_object(
    content: Mapping[str, Any], around: _Around, leading: Collection[str]
) -> Iterator[ResultFigure]:
    freedom = freedoms(content, around.freedom)
    errors = error_keys(content, leading)
    stated = {key for known in errors.values() for key in known.values()}
    for key, part in content.items():
        if key in NOT_RESULTS or key in stated or key.endswith(OWN_FREEDOM):
            continue
        inner = around.within(key, split_unit(key)[1], freedom)
        if isinstance(part, Mapping):
            yield from _of_object(part, inner, leading)
        elif isinstance(part, Sequence) and part and all(isinstance(o, Mapping) for o in part):
            for label, element, used in label_elements(part):
                rest = {name: value for name, value in element.items() if name not in used}
                yield from _of_object(rest, inner.within(label, "", inner.freedom), leading)
        else:
            yield from _of_numbers(key, errors.get(key, {}), content, inner)


def _of_numbers(
    key: str, errors: Mapping[str, str], content: Mapping[str, Any], around: _Around
) -> Iterator[ResultFigure]:
    """Yield the figure of a number, or those of a short list of numbers."""
    path = around.path[:-1] if key == "value" else around.path
    unit = UNITS.get(around.suffix, "")
    if key in UNIT_STATED and isinstance(content.get("unit"), str):
        unit = content["unit"]
    if finite_number(content[key]) is not None:
        places: list[tuple[int | None, str]] = [(None, ".".join(path) or key)]
    else:
        elements = number_elements(key, content[key])
        places = [(place, ".".join((*path, label))) for place, label in elements]
    for place, field in places:
        stated = stated_quantity(content, key, errors, around.freedom, place)
        if stated.value is not None:
            yield _figure(field, unit, stated.value, stated)


def _figure(field: str, unit: str, value: float, stated: StatedQuantity) -> ResultFigure:
    low, high = stated.low, stated.high
    if low is None and stated.stderr is not None:
        half = coverage_factor(stated.freedom) * stated.stderr
        low, high = value - half, value + half
    return ResultFigure(field, unit, value, stated.stderr, low, high)


def stated_quantity(
    content: Mapping[str, Any],
    key: str,
    errors: Mapping[str, str],
    around: tuple[Any, ...] = (),
    place: int | None = None,
) -> StatedQuantity:
    """Return what an object states of the quantity of a key, or of an element of its list.

    errors: of that key, from `error_keys`; around: `freedoms` of what holds the object.
    """
    parts = {"value": content.get(key)} | {role: content[name] for role, name in errors.items()}
    if place is not None:
        parts = {role: element_of(part, place) for role, part in parts.items()}
    stderrs = (finite_number(parts.get(role)) for role in ("stderr", "uncertainty"))
    stderr = max((one for one in stderrs if one is not None), default=None)
    value, ends = finite_number(parts["value"]), list(_intervals(parts, stderr is not None))
    freedom = _freedom(_stated_freedom(content, key, around, place), stderr is not None)
    if any(low > high for low, high in ends) or not all(map(_is_readable, parts, parts.values())):
        return StatedQuantity(value, None, None, None, freedom, True)
    low = min((low for low, _ in ends), default=None)
    high = max((high for _, high in ends), default=None)
    return StatedQuantity(value, stderr, low, high, freedom, bool(errors))


def _is_readable(role: str, part: Any) -> bool:
    """Return whether what is stated by a role can be an error, or is not known (None)."""
    if role == "value" or part is None:
        return True
    if role == "interval_95":
        pair = isinstance(part, Sequence) and not isinstance(part, str) and len(part) == 2
        return pair and all(one is None or finite_number(one) is not None for one in part)
    number = finite_number(part)
    return number is not None and (number >= 0 or role in ("low", "high"))


def _intervals(parts: Mapping[str, Any], has_stderr: bool) -> Iterator[tuple[float, float]]:
    """Yield the ends of each 95 % interval, by role.

    Beside a standard error one end is enough, the other counts as far from the value.
    """
    value, half = finite_number(parts["value"]), finite_number(parts.get("half_width"))
    around = () if value is None or half is None else (value - half, value + half)
    for ends in ((parts.get("low"), parts.get("high")), parts.get("interval_95"), around):
        low, high = (finite_number(element_of(ends, end)) for end in (0, 1))
        if has_stderr and value is not None:
            if low is None and high is not None:
                low = 2 * value - high
            elif high is None and low is not None:
                high = 2 * value - low
        if low is not None and high is not None:
            yield low, high


def _stated_freedom(
    content: Mapping[str, Any], key: str, around: tuple[Any, ...], place: int | None
) -> Any:
    """Return the nearest degrees of freedom that are stated of a quantity; None: none are."""
    stated = content.get(split_unit(key)[0] + OWN_FREEDOM)
    if stated is None:
        by_key = (
            one.get(key) if isinstance(one, Mapping) else one for one in freedoms(content, around)
        )
        stated = next((one for one in by_key if one is not None), None)
    if place is None or isinstance(stated, str) or not isinstance(stated, Sequence):
        return stated
    return stated[place] if place < len(stated) else UNREADABLE


def _freedom(stated: Any, has_stderr: bool) -> float | None:
    """Return degrees of freedom, None for many or none stated.

    What is no number, or below one, counts as one; of an interval alone, which that would make a
    standard error of a sixth, as not stated.
    """
    if stated is None or stated == inf:
        return None
    number = finite_number(stated)
    if number is None or number < 1:
        return 1.0 if has_stderr else None
    return number


def freedoms(content: Mapping[str, Any], around: tuple[Any, ...] = ()) -> tuple[Any, ...]:
    """Return the degrees of freedom that hold in an object, the nearest first.

    Each is one number, a list, or those of each key. around: those of what holds the object.
    """
    return (content.get("degrees_of_freedom"), content.get("freedom"), *around)


def error_keys(
    content: Mapping[str, Any], leading: Collection[str] = ()
) -> dict[str, dict[str, str]]:
    """Return which keys state what of which, by the key of the quantity: {quantity: {role: key}}

    leading: quantities that errors without a name are of, before others in their unit.
    """
    names = {key: split_unit(key) for key in content}
    errors = [
        (name == role, ROLES.index(role), name.removesuffix(role).removesuffix("_"), key, role)
        for key, (name, _) in names.items()
        for role in ROLES
        if name == role or name.endswith(f"_{role}")
    ]
    found: dict[str, dict[str, str]] = {}
    for _, _, name, key, role in sorted(errors):  # those with a name first
        suffix = names[key][1]
        if name or not suffix:
            quantity = "_".join(filter(None, (name or "value", suffix)))
        else:
            stated = {one for known in found.values() for one in known.values()}
            same = [k for k, (of, end) in names.items() if end == suffix and of not in ROLES]
            quantity = _nameless([k for k in same if k not in stated], list(names), key, leading)
        if quantity in content and role not in found.get(quantity, {}):
            found.setdefault(quantity, {})[role] = key
    return found


def _nameless(
    quantities: Sequence[str], keys: Sequence[str], key: str, leading: Collection[str]
) -> str:
    """Return which of the quantities in its unit an error without a name is of, "" for none."""
    quantities = [one for one in quantities if one in leading] or quantities
    if len(quantities) == 1:
        return quantities[0]
    before = [one for one in quantities if keys.index(one) < keys.index(key)]
    return before[-1] if before else ""


def element_of(values: Any, place: int) -> Any:
    """Return an element of what is stated of a list; None where it is not stated of each."""
    if isinstance(values, Sequence) and not isinstance(values, str):
        return values[place] if place < len(values) else None
    return None


def finite_number(value: Any) -> float | None:
    """Return a finite number, None for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if isfinite(value) else None
    except OverflowError:
        return None
