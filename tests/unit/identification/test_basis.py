import numpy as np
import pytest
from scipy import signal

from motord.identification.basis import (
    Basis,
    add_products,
    cell_gain,
    cell_means,
    fill_columns,
    highpass,
)
from tests.unit.identification.synthetic_bench import motor


def test_columns_lie_where_they_should() -> None:
    basis = Basis.of(motor(counts=256), (16, 48))
    assert basis.cogging.shape == (256, 4)
    assert basis.command == slice(14, 17)
    assert basis.command_rate == slice(17, 20)
    assert basis.width == 21


def test_no_orders_is_no_cogging() -> None:
    assert Basis.of(motor(counts=256), ()).cogging.shape == (256, 0)


def test_a_cell_shows_its_mean() -> None:
    counts, order = 100, 20
    fine = np.linspace(-0.5, 0.5, 1001)
    n = 7
    mean = np.trapezoid(np.cos(2 * np.pi * order * (n + fine) / counts), fine)
    table = np.cos(2 * np.pi * order * np.arange(counts) / counts)[:, None]
    assert cell_means(table)[n, 0] == pytest.approx(mean, abs=1e-6)
    assert cell_gain(np.array([order]), counts)[0] == pytest.approx(np.sinc(0.2))


@pytest.mark.parametrize("counts", [100, 101])
def test_cell_means_keep_the_mean_of_any_count(counts: int) -> None:
    table = np.random.default_rng(1).normal(size=(counts, 3))
    assert np.allclose(cell_means(table).mean(axis=0), table.mean(axis=0))


@pytest.mark.kernel
def test_columns_hold_the_torque_of_each_parameter() -> None:
    basis = Basis.of(motor(counts=64), (16,))
    count = np.array([0, 5, 9, 12, 20])
    t_s = np.array([0.0, 0.1, 0.2, 0.3, 0.5])
    currents = np.random.default_rng(2).normal(size=(5, 6))
    rates = np.random.default_rng(3).normal(size=(64, 4))
    columns = np.full((3, basis.width - 1), np.nan)
    fill_columns(count, t_s, currents, 2, basis.back_emf, basis.cogging, rates, columns)
    k = basis.back_emf[count[2:]]
    assert np.allclose(columns[:, 0:3], currents[2:, :3] * k)
    assert np.allclose(columns[:, 3:6], k)
    assert np.allclose(columns[:, 10:12], basis.cogging[count[2:]])
    assert np.allclose(columns[:, basis.command], currents[2:, 3:] * k)
    rate = (currents[4] - currents[2]) / (t_s[4] - t_s[2])
    assert np.allclose(columns[1, 6:9], rate[:3] * k[1])
    assert np.allclose(columns[:, basis.command_rate], rates[count[2:], :3])
    assert np.allclose(columns[:, 9], rates[count[2:], 3])
    last = (currents[4] - currents[3]) / (t_s[4] - t_s[3])
    assert np.allclose(columns[2, 6:9], last[:3] * k[2])
    assert np.isfinite(columns).all()


@pytest.mark.kernel
def test_highpass_is_that_of_the_sensor_whatever_the_blocks() -> None:
    tau_s, dt_s, n = 0.05, 1e-3, 200
    t_s = np.arange(n) * dt_s
    wave = np.sin(2 * np.pi * 10 * t_s)
    columns = wave[:, None].copy()
    state = np.zeros((2, 1))
    steps = np.full(n, dt_s)
    steps[0] = 0.0
    highpass(columns[:70], steps[:70], tau_s, state)
    highpass(columns[70:], steps[70:], tau_s, state)
    wanted = signal.lsim(([tau_s, 0], [tau_s, 1]), wave, t_s)[1]
    assert np.abs(columns[:, 0] - wanted).max() < 1e-3


@pytest.mark.kernel
@pytest.mark.parametrize("samples", [0, 3, 9])
def test_products_are_those_of_the_matrix(samples: int) -> None:
    lanes = np.random.default_rng(samples).normal(size=(8, 10))
    products = np.ones((8, 8))
    add_products(lanes, samples, products)
    wanted = 1 + lanes[:, :samples] @ lanes[:, :samples].T
    assert np.allclose(np.triu(products), np.triu(wanted))
