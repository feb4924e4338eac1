"""Draw how a bench is wired: `python tools/wiring.py [FILE]` writes docs/images/wiring.svg."""

import sys
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

WIDTH, HEIGHT = 1080, 700
INK, SOFT, PAPER, FILL = "#20242b", "#626b78", "#ffffff", "#f3f5f8"
SIGNAL, POWER, SAFETY = "#1670a8", "#c2502f", "#3c8a4b"


@dataclass(frozen=True)
class Box:
    """A device: where it is, its name, and what is worth knowing of it."""

    x: int
    y: int
    width: int
    height: int
    name: str
    lines: tuple[str, ...] = ()


@dataclass(frozen=True)
class Wire:
    """A wire through points, with a label at its `labelled` stretch; colour says what it is."""

    points: tuple[tuple[int, int], ...]
    label: str = ""
    colour: str = SIGNAL
    at: tuple[int, int] | None = None
    ends: tuple[str, str] = field(default=("", ""))


BOXES = (
    Box(20, 50, 130, 600, "PC", ("motord run", "", "/dev/ttyUSB0", "", "can0", "", "/dev/ttyUSB1")),
    Box(215, 60, 150, 66, "USB to serial", ("3.3 V, 2 Mbaud", "latency timer 1 ms")),
    Box(215, 292, 150, 66, "CAN FD adapter", ("1 / 5 Mbit/s", "120 ohm at both ends")),
    Box(215, 560, 150, 66, "USB to RS-485", ("one for each device,", "or one for both")),
    Box(450, 50, 200, 190, "Bridge board", ("STM32F405",)),
    Box(450, 282, 200, 120, "Inverter", ("its own command timeout set",)),
    Box(450, 440, 200, 66, "DC supply", ("24 V, fuse, contactor,", "braking resistor")),
    Box(450, 545, 200, 40, "Brake's current source"),
    Box(450, 610, 200, 40, "Drive's converter"),
    Box(830, 58, 230, 50, "Line receivers, encoder", ("12 Gray tracks",)),
    Box(
        830, 118, 230, 66, "Charge amplifier", ("divider, 1.65 V offset and filter:", "0 to 3.3 V")
    ),
    Box(
        830, 204, 230, 62, "Enable switch", ("opto or relay, in series with", "the emergency stop")
    ),
    Box(830, 292, 230, 92, "Motor", ("rotor on the brake's shaft,", "stator on the torque sensor")),
    Box(830, 545, 230, 40, "Eddy-current brake"),
    Box(830, 610, 230, 40, "External drive, belt"),
)

WIRES = (
    Wire(((150, 93), (215, 93)), "USB"),
    Wire(((365, 84), (450, 84)), "RX", at=(400, 78), ends=("", "PA9")),
    Wire(((365, 108), (450, 108)), "TX", at=(400, 122), ends=("", "PA10")),
    Wire(((150, 325), (215, 325)), "USB"),
    Wire(((365, 325), (450, 325)), "CAN"),
    Wire(((150, 593), (215, 593)), "USB"),
    Wire(((365, 580), (410, 580), (410, 565), (450, 565)), "Modbus RTU", at=(408, 548)),
    Wire(((365, 606), (410, 606), (410, 630), (450, 630))),
    Wire(((650, 100), (830, 100)), "12 lines", ends=("PB0, PB1, PB5 to PB14", "")),
    Wire(((650, 150), (830, 150)), "1.65 V = 0 Nm", ends=("PA1", "")),
    Wire(((650, 214), (830, 214)), "high = closed", SAFETY, at=(702, 208), ends=("PC6", "")),
    Wire(((830, 232), (650, 232)), "as it truly is", SAFETY, at=(740, 246), ends=("", "PC7")),
    Wire(((760, 214), (760, 184)), colour=SAFETY),
    Wire(((945, 266), (945, 279), (690, 279), (690, 306), (650, 306)), "enable input", SAFETY,
         at=(760, 273)),
    Wire(((650, 338), (830, 338)), "phases a, b, c", POWER),
    Wire(((550, 440), (550, 402)), "24 V", POWER, at=(578, 425)),
    Wire(((650, 565), (830, 565)), "current", POWER),
    Wire(((650, 630), (830, 630)), "motor cable", POWER),
    Wire(((945, 384), (945, 545)), "shaft", SOFT, at=(970, 470)),
    Wire(((1040, 610), (1040, 384)), "belt", SOFT, at=(1020, 440)),
)  # fmt: skip


def _box(box: Box) -> str:
    middle = box.x + box.width / 2
    parts = [
        f'<rect x="{box.x}" y="{box.y}" width="{box.width}" height="{box.height}" rx="5" '
        f'fill="{FILL}" stroke="{INK}"/>',
        _text(middle, box.y + 20, box.name, "middle", weight="bold"),
    ]
    parts += [
        _text(middle, box.y + 38 + 16 * row, line, "middle", SOFT, 12)
        for row, line in enumerate(box.lines)
        if line and box.name != "PC"
    ]
    return "".join(parts)


def _text(
    x: float, y: float, text: str, anchor: str, colour: str = INK, size: int = 13,
    weight: str = "normal",
) -> str:  # fmt: skip
    return (
        f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" fill="{colour}" font-size="{size}" '
        f'font-weight="{weight}">{escape(text)}</text>'
    )


def _wire(wire: Wire) -> str:
    path = " ".join(f"{x},{y}" for x, y in wire.points)
    parts = [f'<polyline points="{path}" fill="none" stroke="{wire.colour}" stroke-width="2"/>']
    (x0, y0), (x1, _) = wire.points[:2]
    place = wire.at or ((x0 + x1) // 2, y0 - 6)
    if wire.label:
        parts.append(_text(*place, wire.label, "middle", wire.colour, 12))
    for end, (x, y), other in zip(
        wire.ends, (wire.points[0], wire.points[-1]), (wire.points[1], wire.points[-2]), strict=True
    ):
        if end:  # inside the box that the wire ends at
            inwards = -1 if other[0] > x else 1
            anchor = "end" if inwards < 0 else "start"
            parts.append(_text(x + 6 * inwards, y + 4, end, anchor, SOFT, 11))
    return "".join(parts)


def drawing() -> str:
    """Return the drawing, SVG."""
    body = "".join(map(_wire, WIRES)) + "".join(map(_box, BOXES)) + "".join(map(_ends, WIRES))
    body += _text(85, 97, "/dev/ttyUSB0", "middle", SOFT, 12)
    body += _text(85, 329, "can0", "middle", SOFT, 12)
    body += _text(85, 597, "/dev/ttyUSB1", "middle", SOFT, 12)
    body += _text(766, 197, "10 kohm to ground", "start", SAFETY, 12)
    body += f'<circle cx="760" cy="214" r="4" fill="{SAFETY}"/>'
    body += f'<rect x="754" y="184" width="12" height="16" fill="{PAPER}" stroke="{SAFETY}"/>'
    legend = (("signals", SIGNAL), ("power", POWER), ("enable", SAFETY))
    for number, (label, colour) in enumerate(legend):
        x = 20 + 90 * number
        body += f'<rect x="{x}" y="18" width="22" height="4" fill="{colour}"/>'
        body += _text(x + 28, 25, label, "start", colour, 12)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'font-family="system-ui,DejaVu Sans,sans-serif" role="img" '
        f'aria-label="Wiring of a bench: PC, bridge board, inverter, motor, brake and drive">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="{PAPER}"/>{body}</svg>\n'
    )


def _ends(wire: Wire) -> str:
    return _wire(Wire(wire.points, "", "none", None, wire.ends)) if any(wire.ends) else ""


if __name__ == "__main__":
    default = Path(__file__).parents[1] / "docs" / "images" / "wiring.svg"
    (Path(sys.argv[1]) if len(sys.argv) > 1 else default).write_text(drawing(), encoding="utf-8")
