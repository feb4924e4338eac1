"""From the truth of a rig to the records that its kernels step."""

import cmath
import math

import numpy as np

from motord.cached_arrays import cached_arrays
from motord.config import SEQUENCE, DqConfig
from motord.config.devices import InverterConfig
from motord.rig.free_decay import add_bar
from motord.rig.noise import gaussian, random_state
from motord.rig.park import LATCHED, TURNING
from motord.rig.truth import SLOW_PERIOD_S, RigTruth, TorqueSensorTruth
from motord.rig.types import RIG_PARAMETERS, RIG_STATE
from motord.rig.waves import wave_values


def build(
    truth: RigTruth, seed: int, substep_s: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return (parameters, state) of a rig at rest, shapes (1,), RIG_PARAMETERS and RIG_STATE.

    `seed` starts its random numbers; `substep_s` overrides the step of the integration.
    """
    parameters, state = np.zeros(1, RIG_PARAMETERS), np.zeros(1, RIG_STATE)
    p, s = parameters[0], state[0]
    p.substep_s = substep_s or truth.simulation.substep_s
    p.slow_every = max(1, round(SLOW_PERIOD_S / p.substep_s))
    p.ambient_C = truth.simulation.ambient_C
    _fill_waves(p, truth)
    _fill_inverter(p, truth)
    _fill_thermal(p, truth)
    _fill_rotor_and_brake(p, truth)
    _fill_drive(p, truth)
    _fill_torque_sensor(p, truth.torque_sensor)
    p.counts = truth.encoder.counts
    p.encoder_offset_rad = truth.encoder.offset_rad
    p.encoder_direction = truth.encoder.direction
    _fill_departures(p, truth)
    if truth.swing is not None:
        add_bar(p, truth.swing)
    _fill_state(p, s, truth, seed)
    return parameters, state


def with_drive(truth: RigTruth, configured: InverterConfig) -> RigTruth:
    """Return the rig with the bench's kind of drive.

    A drive that takes d and q has the d axis of the rig file, or else that of the bench file.
    """
    dq = (truth.inverter.dq or configured.dq) if configured.driver == "can-dq" else None
    if dq == truth.inverter.dq:
        return truth
    inverter = truth.inverter.model_copy(update={"dq": dq})
    return truth.model_copy(update={"inverter": inverter})


def _decay(duration_s: float, time_constant_s: float) -> float:
    """Return the part of a first-order transient that remains; 0 for an instant one."""
    return math.exp(-duration_s / time_constant_s) if time_constant_s > 0 else 0.0


def _fill_waves(p: np.record, truth: RigTruth) -> None:
    """Tabulate back-EMF and cogging as cosines and sines of multiples of one base order."""
    motor = truth.motor
    lags_rad = [SEQUENCE[truth.inverter.phase_order] * n * 2 * math.pi / 3 for n in range(3)]
    terms = [
        (h.order * motor.pole_pairs, phase, h.amplitude_V_s_per_rad, h.phase_rad - h.order * lag)
        for h in motor.back_emf
        for phase, lag in enumerate(lags_rad)
    ]
    terms += [(h.order, 3, h.amplitude_Nm, h.phase_rad) for h in motor.cogging]
    orders = sorted({term[0] for term in terms})
    p.base_order = math.gcd(*orders)
    p.order_count = len(orders)
    for row, order in enumerate(orders):
        p.order[row] = order // int(p.base_order)
    for order, column, amplitude, phase_rad in terms:
        index = 4 * orders.index(order) + column
        p.wave_cos[index] += amplitude * math.sin(phase_rad)
        p.wave_sin[index] += amplitude * math.cos(phase_rad)


def _fill_inverter(p: np.record, truth: RigTruth) -> None:
    inverter, slow_s = truth.inverter, p.slow_every * p.substep_s
    p.star = truth.motor.connection == "star"
    p.resistance_ohm = truth.motor.resistance_ohm
    p.inductance_H = truth.motor.inductance_H
    p.bus_V = inverter.bus_V
    p.dead_steps = inverter.dead_time_s / p.substep_s
    p.loop_rate_per_s = 2 * math.pi * inverter.bandwidth_Hz
    p.loop_decay = math.exp(-p.loop_rate_per_s * p.substep_s)
    p.current_max_A = inverter.current_max_A
    p.ready_steps = round(inverter.ready_delay_s / p.substep_s)
    p.gain[:] = np.asarray(inverter.alpha) * inverter.epsilon
    p.beta_A[:] = inverter.beta_A
    if inverter.nonlinearity is not None:
        p.nonlinear = 1
        p.nonlinearity_A[:] = inverter.nonlinearity.amplitude_A
        p.nonlinearity_rad_per_A = 2 * math.pi / inverter.nonlinearity.period_A
        p.nonlinearity_phase_rad[:] = inverter.nonlinearity.phase_rad
        p.nonlinearity_per_A[:] = inverter.nonlinearity.linear_per_A
        p.nonlinearity_per_A2[:] = inverter.nonlinearity.quadratic_per_A2
    p.gain_drift_per_K[:] = inverter.gain_drift_per_K
    p.gain_drift_max = inverter.gain_drift_max
    p.reference_C = inverter.reference_C
    p.inverter_K_per_W = inverter.thermal_resistance_K_per_W
    p.inverter_decay = _decay(slow_s, inverter.thermal_time_constant_s)
    if inverter.dq is not None:
        _fill_axes(p, truth, inverter.dq)
    p.current_noise_A = inverter.current_noise_A
    p.inverter_fixed_W = inverter.fixed_loss_W
    p.inverter_loss_V, p.inverter_loss_ohm = inverter.loss_V, inverter.loss_ohm
    p.voltage_noise_V = inverter.voltage_noise_V


def _fill_thermal(p: np.record, truth: RigTruth) -> None:
    thermal = truth.thermal
    p.resistance_per_K = thermal.resistance_per_K
    p.winding_J_per_K = thermal.winding_J_per_K / 3
    p.winding_housing_W_per_K = 1 / (3 * thermal.winding_housing_K_per_W)
    p.winding_magnet_W_per_K = 1 / (3 * thermal.winding_magnet_K_per_W)
    p.magnet_J_per_K, p.housing_J_per_K = thermal.magnet_J_per_K, thermal.housing_J_per_K
    p.magnet_housing_W_per_K = 1 / thermal.magnet_housing_K_per_W
    p.housing_ambient_W_per_K = 1 / thermal.housing_ambient_K_per_W


def _fill_axes(p: np.record, truth: RigTruth, dq: DqConfig) -> None:
    motor = truth.motor
    first = sum(
        (cmath.rect(h.amplitude_V_s_per_rad, h.phase_rad) for h in motor.back_emf if h.order == 1),
        complex(0.0),
    )
    p.axes = TURNING if dq.angle == "turning" else LATCHED
    p.axes_pole_pairs, p.axes_sign = motor.pole_pairs, dq.direction
    p.axes_order = dq.direction * SEQUENCE[truth.inverter.phase_order]
    p.axes_rad = dq.direction * (cmath.phase(first) - math.pi) + dq.d_axis_rad
    p.axes_age_s, p.axes_scale = dq.angle_age_s, dq.scale


def _fill_rotor_and_brake(p: np.record, truth: RigTruth) -> None:
    rotor, brake = truth.rotor, truth.brake
    p.inertia_kg_m2 = rotor.inertia_kg_m2
    p.viscous_Nm_s_per_rad = rotor.viscous_Nm_s_per_rad
    p.coulomb_Nm, p.static_Nm = rotor.coulomb_Nm, rotor.static_Nm
    p.brake_torque_max_Nm = brake.torque_max_Nm
    p.brake_critical_rad_s = brake.critical_speed_rad_s
    p.brake_critical_per_K = brake.critical_speed_per_K
    p.brake_excitation_decay = _decay(p.substep_s, brake.excitation_time_constant_s)
    p.brake_K_per_W = brake.thermal_resistance_K_per_W
    p.brake_decay = _decay(p.slow_every * p.substep_s, brake.thermal_time_constant_s)


def _fill_drive(p: np.record, truth: RigTruth) -> None:
    drive = truth.drive
    p.drive_max_rad_s = drive.speed_max_rad_s
    p.drive_change_rad_s = drive.acceleration_rad_s2 * p.substep_s
    p.belt_Nm_per_rad = drive.belt_stiffness_Nm_per_rad
    p.belt_Nm_s_per_rad = drive.belt_damping_Nm_s_per_rad
    p.belt_slip_Nm = drive.slip_torque_Nm
    p.belt_lift_rad_s = drive.lift_speed_rad_s
    p.belt_creep_per_Nm = drive.creep_per_Nm


def _fill_departures(p: np.record, truth: RigTruth) -> None:
    motor, friction, crosstalk = (
        truth.motor,
        truth.rotor.friction_ripple,
        truth.torque_sensor.crosstalk,
    )
    p.back_emf_drop_per_A = motor.back_emf_drop_per_A
    p.cogging_rise_per_A = motor.cogging_rise_per_A
    p.back_emf_per_K = truth.thermal.back_emf_per_K
    p.loaded = any((p.back_emf_drop_per_A, p.cogging_rise_per_A, p.back_emf_per_K))
    p.sensor_has_friction = truth.torque_sensor.sees_friction
    p.sensor_departs = bool(friction or crosstalk or p.sensor_has_friction)
    _fill_harmonics(p.friction_ripple, [(h.order, h.amplitude_Nm, h.phase_rad) for h in friction])
    _fill_harmonics(p.torque_crosstalk, [(h.order, h.share, h.phase_rad) for h in crosstalk])
    errors = truth.encoder.errors
    _fill_harmonics(p.encoder_error, [(h.order, h.amplitude_rad, h.phase_rad) for h in errors])
    if truth.inverter.crosstalk is not None:
        mixed = np.eye(3) + np.array(truth.inverter.crosstalk)
        p.current_crosstalk = 1
        p.current_mixed[:] = mixed.ravel()
        p.current_unmixed[:] = np.linalg.inv(mixed).ravel()


def _fill_harmonics(record: np.record, harmonics: list[tuple[int, float, float]]) -> None:
    """Fill a HARMONICS record with (order, amplitude, phase_rad) each."""
    record.terms = len(harmonics)
    for n, (order, amplitude, phase_rad) in enumerate(harmonics):
        record.orders[n], record.amplitude[n], record.phase_rad[n] = order, amplitude, phase_rad


@cached_arrays()
def mount_matrices(
    resonance_Hz: float, damping_ratio: float, duration_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (A, B0, B1), shapes (2, 2), (2,), (2,): x1 = A x0 + B0 u0 + B1 u1 over `duration_s`.

    x is (output, its rate / natural frequency) of w^2 / (s^2 + 2 zeta w s + w^2); exact for an
    input that goes straight from u0 to u1 (first-order hold).
    """
    w_rad_s = 2 * math.pi * resonance_Hz
    block = np.zeros((4, 4))
    block[:2, :2] = [[0.0, w_rad_s], [-w_rad_s, -2 * damping_ratio * w_rad_s]]
    block[1, 2] = w_rad_s
    block[2, 3] = 1.0 / duration_s
    phi = matrix_exponential(block * duration_s)
    return phi[:2, :2], phi[:2, 2] - phi[:2, 3], phi[:2, 3]


def matrix_exponential(matrix: np.ndarray) -> np.ndarray:
    """Return exp(A) = exp(A / 2^s)^(2^s): Taylor series, norm below 2, and squarings.

    Moler and Van Loan 2003, method 3. To load scipy's takes each simulated bench 0.15 s.
    """
    _, exponent = math.frexp(float(np.abs(matrix).sum(axis=1).max()))
    squarings = max(0, exponent - 1)
    scaled = matrix / 2.0**squarings
    total = term = np.eye(len(matrix))
    for n in range(1, 26):  # 2^26 / 26! is below the rounding of 1
        term = term @ scaled / n
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def _fill_torque_sensor(p: np.record, sensor: TorqueSensorTruth) -> None:
    step_s, slow_s = p.substep_s, p.slow_every * p.substep_s
    p.mount_rigid = sensor.resonance_Hz == 0
    if not p.mount_rigid:
        a, b0, b1 = mount_matrices(sensor.resonance_Hz, sensor.damping_ratio, step_s)
        p.mount_a[:] = a.ravel()
        p.mount_b[:] = np.concatenate([b0, b1])
    tau_s = sensor.highpass_time_constant_s
    p.highpass = tau_s > 0
    if p.highpass:
        p.highpass_decay = _decay(step_s, tau_s)
        p.highpass_gain = tau_s / step_s * -math.expm1(-step_s / tau_s)
        p.drift_gain_s = tau_s * -math.expm1(-step_s / tau_s)
    p.drift_decay = _decay(slow_s, sensor.drift_correlation_s)
    p.drift_kick_Nm_per_s = sensor.drift_Nm_per_s * math.sqrt(1 - p.drift_decay**2)
    p.torque_Nm_per_count = sensor.gain_Nm_per_V * sensor.adc_V_per_count
    p.torque_counts_per_Nm = sensor.delta / p.torque_Nm_per_count
    p.torque_noise_counts = sensor.noise_Nm / p.torque_Nm_per_count
    p.torque_count_max = 2 ** (sensor.adc_bits - 1) - 1


def _fill_state(p: np.record, s: np.record, truth: RigTruth, seed: int) -> None:
    s.random = random_state(seed)
    s.gain[:] = p.gain
    s.temperature_C = s.brake_temperature_C = p.ambient_C
    s.magnet_C = s.housing_C = s.winding_C[:] = p.ambient_C
    s.resistance_ohm[:] = p.resistance_ohm
    s.angle_rad, s.speed_rad_s = truth.rotor.angle_rad, truth.rotor.speed_rad_s
    if truth.swing is not None:
        s.angle_rad, s.hand_s = truth.swing.rest_angle_rad, truth.swing.first_s
    k_a, k_b, k_c, cogging_Nm = wave_values(p, s.angle_rad)
    s.k_V_s_per_rad[:] = k_a, k_b, k_c
    s.torque_cog_Nm = cogging_Nm
    s.mount_Nm = s.load_Nm = cogging_Nm
    s.drift_Nm_per_s = truth.torque_sensor.drift_Nm_per_s * gaussian(s)
