"""The same voltages on motulator's synchronous machine: an independent model of the same motor."""

import math

import numpy as np
from motulator.common.utils import abc2complex, complex2abc
from motulator.drive.model import StiffMechanicalSystem, SynchronousMachine
from motulator.drive.utils import SynchronousMachinePars
from scipy.integrate import solve_ivp

from tests.unit.rig.probe import Probe, plain

POLE_PAIRS, K_PEAK, R_OHM, L_H, J_KG_M2, B_NM_S = 8, 0.2, 0.1, 0.2e-3, 0.0105, 0.05
SUBSTEP_S, STEPS = 2e-6, 50_000


def motulator_answer(
    time_s: np.ndarray, u_V: np.ndarray, angle_rad: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return currents (n, 3), torque and speed of motulator's machine under u_V (n, 3)."""
    pars = SynchronousMachinePars(
        n_p=POLE_PAIRS, R_s=R_OHM, L_d=L_H, L_q=L_H, psi_f=K_PEAK / POLE_PAIRS
    )
    machine = SynchronousMachine(pars)
    mechanics = StiffMechanicalSystem(J=J_KG_M2, B_L=B_NM_S)
    # its flux lies on phase a at angle 0; here the back-EMF of a rises through 0 at angle 0
    start = np.exp(1j * (POLE_PAIRS * angle_rad + math.pi))
    u_ss = abc2complex(u_V.T)

    def load_state(t_s: float, x: np.ndarray) -> None:
        machine.state.psi_s, machine.state.exp_j_theta_m = x[0], x[1]
        mechanics.state.w_M, mechanics.state.exp_j_theta_M = x[2].real, x[3]
        machine.set_outputs(t_s)
        mechanics.set_outputs(t_s)

    def slope(t_s: float, x: np.ndarray) -> np.ndarray:
        load_state(t_s, x)
        machine.inp.u_ss = np.interp(t_s, time_s, u_ss.real) + 1j * np.interp(
            t_s, time_s, u_ss.imag
        )
        machine.inp.w_M = mechanics.out.w_M
        mechanics.inp.tau_M = machine.out.tau_M
        return np.array([*machine.rhs(), *mechanics.rhs()], dtype=complex)

    at_s = time_s[::500]
    x0 = np.array([machine.state.psi_s, start, 0.0, np.exp(1j * angle_rad)], dtype=complex)
    solution = solve_ivp(
        slope, (0.0, at_s[-1]), x0, t_eval=at_s, rtol=1e-7, atol=1e-9, max_step=5e-5
    )
    currents, torque_Nm, speed_rad_s = [], [], []
    for t_s, x in zip(solution.t, solution.y.T, strict=True):
        load_state(t_s, x)
        currents.append(complex2abc(machine.out.i_ss))
        torque_Nm.append(machine.out.tau_M)
        speed_rad_s.append(mechanics.out.w_M)
    return np.array(currents), np.array(torque_Nm), np.array(speed_rad_s)


def test_currents_torque_and_speed_agree_with_motulator() -> None:
    truth = plain(
        motor={"connection": "star"},
        rotor={"angle_rad": 0.1, "viscous_Nm_s_per_rad": B_NM_S},
    )
    probe = Probe(truth, substep_s=SUBSTEP_S).enable()
    time_s, outputs, truths = probe.trace(STEPS, 10.0)
    i_A, torque_Nm, speed_rad_s = motulator_answer(time_s, outputs["u_V"], 0.1)
    rows = truths[::500]
    ours_A = np.stack([rows["i_a_A"], rows["i_b_A"], rows["i_c_A"]], axis=1)
    np.testing.assert_allclose(i_A, ours_A, atol=0.04)  # of 10 A
    np.testing.assert_allclose(torque_Nm, rows["torque_em_Nm"], atol=0.012)  # of 3 Nm
    np.testing.assert_allclose(speed_rad_s, rows["speed_rad_s"], atol=0.01)  # of 22 rad/s
    assert rows["speed_rad_s"][-1] > 20.0
    assert np.abs(ours_A).max() > 9.9
