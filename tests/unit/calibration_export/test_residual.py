"""What a drive's table leaves is what the file, read as the drive does, leaves."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motord.calibration.export import FORMATS, DriveFrame, TorqueConstant, exported
from motord.calibration.export.drive_frame import refined
from motord.calibration.export.exported import Exported
from motord.calibration.export.layouts import TableLayout
from motord.calibration.export.residual import ANGLES_AN_ENTRY, ResidualRipple, residual_Nm
from tests.unit.calibration_export.as_drives_read import READERS
from tests.unit.calibration_export.cases import (
    CONSTANT,
    COUNTS,
    HARMONICS,
    NM_PER_A,
    calibration,
    cogging_Nm,
)

ROUNDING = 5e-5
"""By what a residual may differ, of the largest: it is compared at some angles, not at all."""
FRAMES = [DriveFrame(), DriveFrame(1.234), DriveFrame(-0.7, backwards=True)]


def by_hand(made: Exported, quantity: str, gain: float, angles: int) -> list[float]:
    """The torque that is left at so many of motord's angles, from the file's text alone."""
    read = READERS[made.format.name, quantity](made.text())
    sign = -1 if made.frame.backwards else 1
    left = []
    for i in range(angles):
        angle_rad = 2 * math.pi * i / angles
        turns = (made.frame.zero_rad + sign * angle_rad) / (2 * math.pi) % 1.0
        left.append(-cogging_Nm(angle_rad) - sign * gain * read(turns))
    return left


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("name", "quantity"), READERS)
def test_the_residual_is_that_of_the_file(name: str, quantity: str, frame: DriveFrame) -> None:
    made = exported(calibration(), FORMATS[name], frame, CONSTANT)
    (column,) = [one for one in made.columns if one.quantity == quantity]
    factor = math.ceil(ANGLES_AN_ENTRY * made.format.layout.resolution / COUNTS)
    gain = NM_PER_A if quantity == "current" else 1.0
    left = by_hand(made, quantity, gain, COUNTS * factor)
    rms_Nm = math.sqrt(sum(each**2 for each in left) / len(left))
    assert column.left.rms_Nm == pytest.approx(rms_Nm, rel=1e-5, abs=3e-8)
    assert column.left.worst_Nm == pytest.approx(max(map(abs, left)), rel=1e-4, abs=1e-7)
    assert rms_Nm < 0.03 * made.uncompensated.rms_Nm
    assert column.left.content()["rms_percent"] == pytest.approx(
        100 * rms_Nm / 6.0, rel=1e-4, abs=1e-6
    )


@given(
    orders=st.lists(st.integers(1, 120), min_size=1, max_size=4, unique=True),
    seed=st.integers(0, 1000),
    interpolation=st.sampled_from(["linear", "hold"]),
)
@settings(max_examples=30, deadline=None)
def test_more_entries_and_more_bits_are_never_worse(orders, seed, interpolation) -> None:
    rng = np.random.default_rng(seed)
    angles_rad = 2 * np.pi * np.arange(COUNTS) / COUNTS
    wave = sum(rng.uniform(0.1, 1) * np.sin(n * angles_rad + rng.uniform(0, 7)) for n in orders)

    def left(layout: TableLayout) -> float:
        made = layout.fit(wave)
        ones = np.ones(COUNTS)
        return ResidualRipple.of(
            residual_Nm(made, wave, ones, DriveFrame(), layout.resolution), 1
        ).rms_Nm

    lengths = (32, 64, 128, 256, 512, 1024)
    by_length = [left(TableLayout(length, interpolation)) for length in lengths]
    assert np.all(np.diff(by_length) < ROUNDING * by_length[0])
    by_bits = [left(TableLayout(512, interpolation, bits)) for bits in (4, 6, 8, 10, 12, 16)]
    assert np.all(np.diff(by_bits) < ROUNDING * by_bits[0])
    assert by_bits[-1] == pytest.approx(left(TableLayout(512, interpolation)), rel=1e-2, abs=1e-4)


def test_a_fit_leaves_less_than_the_wave_at_the_entries() -> None:
    wave = -np.array(calibration().tau_cog_Nm)
    layout = TableLayout(512, "linear")
    ones = np.ones(COUNTS)
    fitted = layout.fit(wave)
    sampled = type(fitted)(wave[:: COUNTS // 512], 1.0, "linear")
    rms = [
        ResidualRipple.of(residual_Nm(each, wave, ones, DriveFrame(), 512), 1).rms_Nm
        for each in (fitted, sampled)
    ]
    assert rms[0] < 0.6 * rms[1]


def test_a_table_with_few_counts_is_compared_between_them() -> None:
    """Steps of a table of 3600 do not show at the counts of an encoder with fewer."""
    few = exported(calibration(counts=512), FORMATS["odrive"], DriveFrame(), None)
    many = exported(calibration(counts=32 * 1024), FORMATS["odrive"], DriveFrame(), None)
    assert few.columns[0].left.rms_Nm == pytest.approx(many.columns[0].left.rms_Nm, rel=1e-2)
    wave = np.array(calibration(counts=512).tau_cog_Nm)
    assert refined(wave, 8) == pytest.approx(np.array(calibration(counts=4096).tau_cog_Nm))


@pytest.mark.parametrize("counts", [64, 63])
def test_refined_keeps_what_is_at_the_counts(counts: int) -> None:
    """Noise has all orders, that of half the counts among them."""
    wave = np.random.default_rng(3).normal(size=counts)
    assert refined(wave, 4)[::4] == pytest.approx(wave)


def test_an_order_beyond_nyquist_is_left_out_and_named() -> None:
    """64 entries have orders below 32: 96 would show as order 32, 48 as order 16."""
    made = exported(calibration(), FORMATS["csv"].resized(64, None), DriveFrame(), CONSTANT)
    assert [order for order, _ in made.left_out] == [48, 96]
    assert made.left_out[0][1] == pytest.approx(0.3)
    spectrum = np.abs(np.fft.rfft(made.columns[0].table.values)) / 32
    assert spectrum[16] == pytest.approx(0.09, rel=0.25)
    assert np.delete(spectrum, 16).max() < 1e-6
    assert "order 48 (300 mNm), 96" in "\n".join(made.lines())
    assert not exported(calibration(), FORMATS["csv"], DriveFrame(), CONSTANT).left_out


def test_harmonics_beyond_ten_and_beyond_200_are_named() -> None:
    harmonics = (*((n, 0.1 + 0.001 * n, 0.0) for n in range(1, 12)), (240, 0.2, 0.0))
    made = exported(calibration(harmonics), FORMATS["beckhoff-harmonics"], DriveFrame(), None)
    assert [order for order, _ in made.left_out] == [240, 1]


@pytest.mark.parametrize("entries", [1, 7, 1000])
def test_another_zero_rotates_the_table(entries: int) -> None:
    layout = TableLayout(1024, "linear")
    wave = np.array(calibration().tau_cog_Nm)
    own = layout.fit(DriveFrame().seen(wave)).values
    turned = layout.fit(DriveFrame(2 * math.pi * entries / 1024).seen(wave)).values
    assert turned == pytest.approx(np.roll(own, entries), abs=1e-6)
    mirrored = layout.fit(DriveFrame(backwards=True).seen(wave)).values
    assert mirrored == pytest.approx(-np.roll(own[::-1], 1), abs=1e-6)


@pytest.mark.parametrize("name", FORMATS)
def test_a_drives_wrong_constant_is_in_the_residual(name: str) -> None:
    """A constant 10 % too large makes currents 10 % too small, whoever divides by it."""
    constant = TorqueConstant(CONSTANT.motor_Nm_per_A, 1.1 * NM_PER_A)
    made = exported(calibration(), FORMATS[name], DriveFrame(), constant)
    for one in made.columns:
        assert one.left.rms_Nm == pytest.approx(made.uncompensated.rms_Nm * 0.1 / 1.1, rel=0.05)


def test_a_back_emf_with_harmonics_is_in_a_table_of_currents_not_of_torques() -> None:
    angles_rad = 2 * np.pi * np.arange(COUNTS) / COUNTS
    constant = TorqueConstant(NM_PER_A * (1 + 0.05 * np.sin(48 * angles_rad)))
    made = exported(calibration(), FORMATS["csv"].resized(4096, None), DriveFrame(), constant)
    torque, current = made.columns
    assert current.left.rms_Nm < 0.002 * made.uncompensated.rms_Nm
    expected = np.sqrt(np.mean((0.05 * np.sin(48 * angles_rad) * calibration().tau_cog_Nm) ** 2))
    assert torque.left.rms_Nm == pytest.approx(expected, rel=0.02)


def test_the_harmonics_are_those_of_the_calibration() -> None:
    made = exported(calibration(), FORMATS["beckhoff-harmonics"], DriveFrame(), None)
    terms = made.columns[0].stored.terms
    assert [one.order for one in terms] == [48, 96, 16]
    by_order = {n: (a, phi) for n, a, phi in HARMONICS}
    for one in terms:
        amplitude_Nm, phase_rad = by_order[one.order]
        assert one.amplitude == pytest.approx(amplitude_Nm)
        assert math.remainder(math.radians(one.phase_deg) - phase_rad - math.pi, math.tau) == (
            pytest.approx(0, abs=1e-6)
        )
