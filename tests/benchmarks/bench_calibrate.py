"""From the file of a mesh to its calibration: time, memory, and against a stacked matrix.

Each round is a process of its own, as `motord analyse calibrate` is one: it has loaded its modules
when the clock starts, and nothing else. Its memory is what the kernel says was the most of it that
was resident at once, modules included (VmHWM; `ru_maxrss` would give that of its parent, too).

The same answer by a pseudo-inverse is made in two ways. `joint` adds up products of the columns
turn by turn; instead, the columns of all samples can be stacked in one matrix, and numpy's `pinv`
applied to it. `residual` averages at the encoder points first, as the report does; then the stacked
matrix has 4096 rows a trial, however long the trials were. From these averages, its sums are
compared with the matrix; from the samples, most of the time of either goes into averaging.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from motord import config
from motord.experiments.calibration.estimate.calibrator import Calibrator
from motord.experiments.calibration.estimate.current_tables import (
    instruments_by_parity,
    velocity_over_turn,
)
from motord.experiments.calibration.estimate.residual import ResidualEstimator, Trial
from motord.experiments.calibration.estimate.turn_products import (
    BAND_MARGIN,
    accumulate,
    settled,
    without_decay,
)
from motord.experiments.subject import Subject
from motord.identification.basis import FIRST_WAVE, Basis, fill_columns, highpass
from motord.identification.operating_points import Samples, prepare
from motord.identification.orders import allowed_orders
from motord.identification.torque.torque_sensor import MountInverse
from motord.recording.captures import captures
from motord.recording.metadata import describe
from motord.recording.reader import open_run
from motord.recording.writer import RunWriter
from motord.virtual import processors, run_points
from tests.benchmarks.bench_mesh import MESH_HZ, at_rate, the_mesh
from tests.benchmarks.figure import Figure

SECONDS_WANTED = 3.0
MEMORY_WANTED_MB = 400.0
PINV_RATIO_WANTED = 10.0
SAME = 1e-6
STACKED_POINTS = 6
"""Operating points whose samples are stacked: all 30 would need some gigabytes."""


def write_mesh(path: Path, quick: bool) -> int:
    """Write the mesh at MESH_HZ with ticks, truth and points; return the number of ticks."""
    bench = at_rate(MESH_HZ)
    metadata = describe(bench, config.packaged("sim.toml").read_text())
    with processors() as pool, RunWriter(path, metadata) as writer:
        for piece in run_points(bench, the_mesh(bench, quick), seed=1, pool=pool):
            for first in range(0, piece.ticks.size, MESH_HZ):
                writer.ticks(piece.ticks[first : first + MESH_HZ])
                writer.truth(piece.truth[first : first + MESH_HZ])
            writer.operating_point(int(piece.point["t_end_ns"]), piece.point)
        return writer.tick_count


def child(path: Path) -> dict[str, float]:
    """Calibrate from `path` in this process; return what it took."""
    begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
    run = open_run(path)
    result = Calibrator.of_runs([run], Subject.of_runs([run])).joint()
    took = {"wall_s": time.perf_counter() - begun_s, "cpu_s": time.process_time() - begun_cpu_s}
    status = Path("/proc/self/status").read_text()
    peak_kB = next(int(line.split()[1]) for line in status.splitlines() if "VmHWM" in line)
    return {**took, "peak_MB": peak_kB / 1024, "alpha_a": float(result.alpha[0])}


def file_figures(path: Path, ticks: int, rounds: int) -> list[Figure]:
    """Return time and memory from the file to alpha, beta and cogging torque."""
    results = [in_a_process(path) for _ in range(rounds + 1)][1:]  # the first may compile
    middle = {key: statistics.median(r[key] for r in results) for key in results[0]}
    command = [Path(sys.executable).with_name("motord"), "analyse", "calibrate", path, "--json"]
    whole_s = []
    for _ in range(rounds):
        begun_s = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        whole_s.append(time.perf_counter() - begun_s)
    size_MB = path.stat().st_size / 1e6
    return [
        Figure(
            "file to alpha, beta, tau_cog",
            middle["wall_s"],
            "s",
            SECONDS_WANTED,
            note=f"{ticks} ticks, {size_MB:.0f} MB; {middle['cpu_s']:.2f} s of processor time",
        ),
        Figure(
            "memory that this takes at most",
            max(result["peak_MB"] for result in results),
            "MB",
            MEMORY_WANTED_MB,
            note="Python with all modules included",
        ),
        Figure(
            "the whole command, `motord analyse calibrate`",
            statistics.median(whole_s),
            "s",
            note="with the start of Python and all that it imports",
        ),
    ]


def in_a_process(path: Path) -> dict[str, float]:
    """Return what `child` found in a process of its own."""
    command = [sys.executable, "-m", __spec__.name if __spec__ else __name__, str(path)]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, float] = json.loads(found.stdout.splitlines()[-1])
    return result


class Matrices:
    """Both estimators' least squares, by sums and by the pseudo-inverse of a stacked matrix."""

    def __init__(self, path: Path) -> None:
        run = open_run(path)
        subject = Subject.of_runs([run])
        self.motor, self.sensor = subject.motor, subject.sensor
        self.samples = [prepare(point, self.motor.counts) for point in captures(run)]
        self.trials = [Trial.of(samples, self.motor.counts) for samples in self.samples]
        every = max(len(self.samples) // STACKED_POINTS, 1)
        self.some = self.samples[::every]
        orders = allowed_orders(self.motor.slots, 2 * self.motor.pole_pairs, self.motor.counts // 4)
        self.orders = orders
        self.basis = Basis.of(self.motor, orders)
        self.chosen = np.r_[0:6, FIRST_WAVE : FIRST_WAVE + 2 * len(orders)]

    def joint_sums(self) -> np.ndarray:
        """Solve for alpha, beta and cogging from the sums over turns."""
        sums = np.zeros((self.basis.width, self.basis.width))
        for samples in self.some:
            sums += accumulate(samples, self.basis, self.sensor).torque.sum(axis=0)
        normal = sums[np.ix_(self.chosen, self.chosen)]
        inverse = np.linalg.pinv(normal, rcond=1e-13, hermitian=True)
        answer: np.ndarray = inverse @ sums[self.chosen, -1]
        return answer

    def joint_stacked(self) -> np.ndarray:
        """Solve for the same from the stacked columns of all samples."""
        stacked = np.concatenate([self._columns(samples) for samples in self.some])
        answer: np.ndarray = np.linalg.pinv(stacked[:, :-1]) @ stacked[:, -1]
        return answer

    def trial_sums(self) -> np.ndarray:
        """Return alpha - 1, beta and cogging torque of the residual estimator, from averages."""
        estimator = ResidualEstimator(self.motor, self.orders)
        for trial in self.trials:
            estimator.take(trial)
        y, left_Nm = estimator.least_squares()
        return np.concatenate([y, left_Nm - left_Nm.mean()])

    def trials_stacked(self) -> np.ndarray:
        """Return the same from the same averages as the report does it: X (4.6) of all trials."""
        k = self.motor.back_emf_table()
        tables = [trial.table for trial in self.trials]
        x = np.concatenate([np.column_stack([table[:3].T * k, k]) for table in tables])
        return self._by_pinv(x, np.concatenate([table[3] for table in tables]))

    def residual_sums(self) -> np.ndarray:
        """Return the same from the samples, averages included."""
        estimator = ResidualEstimator(self.motor, self.orders)
        for samples in self.samples:
            estimator.add(samples)
        y, left_Nm = estimator.least_squares()
        return np.concatenate([y, left_Nm - left_Nm.mean()])

    def residual_stacked(self) -> np.ndarray:
        """Return the same from the samples with numpy's averages, stacked."""
        k, counts = self.motor.back_emf_table(), self.motor.counts
        xs, torques_Nm = [], []
        for samples in self.samples:
            count = samples.count[samples.whole]
            columns = [samples.torque_Nm[samples.whole], *samples.i_A[samples.whole].T]
            hits = np.bincount(count, minlength=counts)
            means = [np.bincount(count, c, minlength=counts) / hits for c in columns]
            xs.append(np.column_stack([np.column_stack(means[1:]) * k, k]))
            torques_Nm.append(means[0] - means[0].mean())
        return self._by_pinv(np.concatenate(xs), np.concatenate(torques_Nm))

    def _by_pinv(self, x: np.ndarray, torque_Nm: np.ndarray) -> np.ndarray:
        """Return y = pinv(X) tau (4.9) and what is left, averaged over the trials (4.14)."""
        y = np.linalg.pinv(x, rcond=1e-9) @ torque_Nm
        left_Nm = (torque_Nm - x @ y).reshape(-1, self.motor.counts).mean(axis=0)
        return np.concatenate([y, left_Nm - left_Nm.mean()])

    def _columns(self, samples: Samples) -> np.ndarray:
        """Return columns and torque of all whole turns, freed of mean and slope over each."""
        basis, turns = self.basis.at(samples.back_emf_factor), samples.turns
        band_Hz = BAND_MARGIN * max(self.orders) * samples.speed_Hz
        mount = MountInverse.of(self.sensor, samples.period_s, band_Hz)
        y_Nm = mount.apply(samples.t_s, samples.torque_Nm - samples.torque_Nm.mean())
        y_Nm = without_decay(samples, y_Nm, self.sensor.highpass_time_constant_s)
        velocity_rad_s = velocity_over_turn(samples, self.motor.counts)
        tables_A, rates = instruments_by_parity(samples, basis, velocity_rad_s)
        columns = np.zeros((samples.t_s.size, basis.width - 1))
        before = (0, turns[0][0], 0, 1)  # it settles the high-pass
        within = ((first, end, turn % 2, turn % 2) for turn, (first, end) in enumerate(turns))
        for first, end, of_currents, of_rates in (before, *within):
            count = samples.count[first:end]
            commands_A = tables_A[of_currents][count]
            currents_A = np.concatenate([samples.i_A[first:end], commands_A], axis=1)
            tables = basis.back_emf, basis.cogging, rates[of_rates]
            fill_columns(count, samples.t_s[first:end], currents_A, 0, *tables, columns[first:end])
        dt_s = np.diff(samples.t_s, prepend=samples.t_s[0])
        state = settled(samples, basis)
        highpass(columns, dt_s, self.sensor.highpass_time_constant_s, state)
        pieces = []
        for first, end in turns:
            rows = np.column_stack([columns[first:end][:, self.chosen], y_Nm[first:end]])
            t_s = samples.t_s[first:end]
            trend = np.column_stack([np.ones(t_s.size), t_s - t_s.mean()])
            pieces.append(rows - trend @ (np.linalg.pinv(trend) @ rows))
        return np.concatenate(pieces)


def ratio(
    what: str,
    ways: tuple[Callable[[], np.ndarray], Callable[[], np.ndarray]],
    rounds: int,
    bound: float | None,
    note: str,
) -> Figure:
    """Return how many times faster the first way is than the second, the answers being the same.

    Raises RuntimeError if they are not.
    """
    times_s: tuple[list[float], list[float]] = ([], [])
    answers = [way() for way in ways]
    difference = float(np.abs(answers[0] - answers[1]).max())
    if not difference <= SAME:
        raise RuntimeError(f"{what}: the answers differ by {difference:.1e}")
    for _ in range(rounds):
        for way, times in zip(ways, times_s, strict=True):
            begun_s = time.perf_counter()
            way()
            times.append(time.perf_counter() - begun_s)
    mine_s, other_s = (statistics.median(times) for times in times_s)
    note_text = (
        f"{1e3 * mine_s:.0f} and {1e3 * other_s:.0f} ms, answers within {difference:.0e}; {note}"
    )
    return Figure(what, other_s / mine_s, "x", bound, "at least", note_text)


def matrix_figures(path: Path, rounds: int) -> list[Figure]:
    """Return ratios to pseudo-inverses of stacked matrices, from the same samples in memory."""
    matrices = Matrices(path)
    rows = sum(samples.turns[-1][1] - samples.turns[0][0] for samples in matrices.some)
    every = sum(samples.turns[-1][1] - samples.turns[0][0] for samples in matrices.samples)
    return [
        ratio(
            "joint, to `pinv` of all samples stacked",
            (matrices.joint_sums, matrices.joint_stacked),
            rounds,
            None,
            f"{rows} samples of {len(matrices.some)} points by {matrices.chosen.size} columns",
        ),
        ratio(
            "residual from averages, to `pinv` of the stacked matrix of the report",
            (matrices.trial_sums, matrices.trials_stacked),
            5 * rounds,
            PINV_RATIO_WANTED,
            f"{len(matrices.trials)} trials by {matrices.motor.counts} encoder points, 6 columns",
        ),
        ratio(
            "residual from samples, averages included, to the same with numpy",
            (matrices.residual_sums, matrices.residual_stacked),
            rounds,
            None,
            f"{every} samples: to average them takes most of the time, at the speed of memory",
        ),
    ]


def figures(quick: bool) -> list[Figure]:
    """Return everything about calibration from a file."""
    rounds = 2 if quick else 5
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "mesh.mcap"
        ticks = write_mesh(path, quick)
        return [*file_figures(path, ticks, rounds), *matrix_figures(path, rounds)]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(child(Path(sys.argv[1]))) + "\n")
