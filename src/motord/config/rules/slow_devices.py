"""What must hold of brake and drive: rules of a bench, as those of `config.rules.interlocks`."""

from collections.abc import Iterator

from motord.config.bounds import SettingBound, is_below
from motord.config.devices.slow_devices import BRAKE_MARGIN_K, register_counts, shares_line
from motord.config.sections import Sections
from motord.config.timing import DRIVE_FALLS_S, DRIVE_REACTS_S, INTERVALS_MIN, SLOW_SILENCE_MAX_S

STEP_MAX = 0.02
"""Of the largest set-point, between two that can be written: they are rounded."""


def drive_stops_without_the_daemon(config: Sections) -> Iterator[str]:
    """Whatever of the daemon hangs, the drive's speed falls within DRIVE_FALLS_S.

    Its last set-point is written at most a timeout after the order's end; then its watchdog
    runs. A brake on the same serial line may keep it waiting besides.
    """
    modbus, brake, poll_s = config.drive.modbus, config.brake.modbus, config.drive.poll_s
    if config.drive.driver != "modbus" or modbus is None:
        return
    watchdog_s = modbus.watchdog_s
    if watchdog_s == 0.0:
        yield (
            "[drive.modbus] has no watchdog_s: a drive that nobody writes to any more would "
            "turn the rotor for ever. Set a watchdog (communication timeout) in the drive and "
            "say here what it is, such as watchdog_s = 0.2; one without cannot be used"
        )
        return
    wait_s, waits = modbus.timeout_s, "timeout_s"
    if config.brake.driver == "modbus" and brake is not None and shares_line(modbus, brake):
        wait_s, waits = wait_s + brake.timeout_s, "timeout_s, and that of the brake on its line"
    most_s = DRIVE_FALLS_S - DRIVE_REACTS_S - config.setpoint_valid_s
    if is_below(most_s, watchdog_s + wait_s):
        yield (
            f"[drive.modbus] watchdog_s = {watchdog_s:g} and {waits} ({wait_s:g} s) are "
            f"too long: the rotor's speed has to fall within {DRIVE_FALLS_S:g} s if the daemon "
            f"hangs. Together they may be {most_s:g} s, such as 0.2 and 0.1"
        )
        return  # of poll_s nothing can be said before watchdog_s is known
    yield from SettingBound(
        "[drive] poll_s", poll_s, "at most", watchdog_s / 2, "too long",
        f"with [drive.modbus] watchdog_s = {watchdog_s:g} one failed exchange would stop the drive",
    ).refusal()  # fmt: skip


def a_lost_answer_is_no_silence(config: Sections) -> Iterator[str]:
    """A request without an answer takes its timeout, and on a shared line the other device's."""
    brake, drive = config.brake, config.drive
    for name, section, other in (("brake", brake, drive), ("drive", drive, brake)):
        wait_s, waits, remedy = 0.0, "", "lower poll_s"
        if section.driver == "modbus" and section.modbus is not None:
            wait_s, remedy = section.modbus.timeout_s, "lower poll_s or timeout_s"
            if other.driver == "modbus" and other.modbus:
                wait_s += other.modbus.timeout_s * shares_line(section.modbus, other.modbus)
            waits = (
                f", and that is waited for {wait_s:g} s ([{name}.modbus] timeout_s, and that of "
                "another device on its line)"
            )
        yield from SettingBound(
            f"[{name}] stale_after_s", section.stale_after_s, "at least",
            INTERVALS_MIN * section.poll_s + wait_s, "too short",
            f"it is read every {section.poll_s:g} s, one answer may be lost{waits}",
            remedy, SLOW_SILENCE_MAX_S,
        ).refusal()  # fmt: skip


def registers_reach_the_limits(config: Sections) -> Iterator[str]:
    """Set-points as large as the limits can be written, finely, and a hot brake can be read."""
    brake, drive = config.brake, config.drive
    for name, section, low, high in (
        ("brake", brake, 0.0, 1.0),
        ("drive", drive, drive.speed_min_rad_s, drive.speed_max_rad_s),
    ):
        modbus = section.modbus
        if section.driver != "modbus" or modbus is None:
            continue
        step, kind = modbus.setpoint_scale, modbus.setpoint_kind
        least, greatest = (step * count for count in register_counts(kind))
        within = least <= low < high and not is_below(greatest, high)
        if not within or step > STEP_MAX * high:
            yield (
                f'[{name}.modbus] setpoint_kind = "{kind}" with setpoint_scale = {step:g} holds '
                f"{least:g} to {greatest:g} in steps of {step:g}; it takes {low:g} to {high:g} in "
                f"steps of {STEP_MAX * high:g} at most: give what its manual says"
                + (", or another [drive] speed_max_rad_s" if section is drive else "")
            )
    modbus, trip_C = brake.modbus, brake.trip_temperature_C
    if brake.driver == "modbus" and modbus is not None:
        hottest_C = modbus.value_scale * register_counts(modbus.value_kind)[1]
        if hottest_C <= trip_C:
            yield (
                f'[brake.modbus] value_kind = "{modbus.value_kind}" with value_scale = '
                f"{modbus.value_scale:g} says {hottest_C:g} degC at most, and the brake trips "
                f"above {trip_C:g}, [brake] temperature_max_C and {BRAKE_MARGIN_K:g}: it never "
                "would; give what its manual says, or a lower temperature_max_C"
            )
