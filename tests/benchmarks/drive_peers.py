"""A PMSM drive under current control in other libraries; runs in an environment that has them.

    python drive_peers.py motulator|gym-electric-motor SECONDS

Simulates the motor of the packaged rig under a viscous load, with a step of torque, and prints
JSON: ticks of the control, wall and processor time, mean torque, version. Averaged converter, no
carrier, ideal sensors, nothing drawn; solver and record of what happened as the library has them.
"""

import json
import math
import sys
import time
from collections.abc import Callable
from importlib.metadata import version

PERIOD_S = 1e-4
SPEED_RAD_S = 2 * math.pi * 0.7
TORQUE_NM = 3.0
POLE_PAIRS = 8
BACK_EMF_V_S_PER_RAD = 0.206
RESISTANCE_OHM, INDUCTANCE_H, INERTIA_KG_M2, BUS_V = 0.1, 2e-4, 0.0105, 24.0
FLUX_V_S = BACK_EMF_V_S_PER_RAD / POLE_PAIRS
CURRENT_A = TORQUE_NM / (1.5 * BACK_EMF_V_S_PER_RAD)
BANDWIDTH_RAD_S = 2 * math.pi * 200
LOAD_NM_S_PER_RAD = TORQUE_NM / SPEED_RAD_S
STEP_S = 0.05

Run = Callable[[], tuple[int, float]]
"""Simulates; returns control ticks and mean torque of the second half (Nm)."""


def motulator(seconds: float) -> Run:
    """Return a run of motulator's current-vector control, with position sensor."""
    from motulator.drive import model
    from motulator.drive.control import sm
    from motulator.drive.utils import SynchronousMachinePars

    machine = SynchronousMachinePars(
        n_p=POLE_PAIRS, R_s=RESISTANCE_OHM, L_d=INDUCTANCE_H, L_q=INDUCTANCE_H, psi_f=FLUX_V_S
    )
    drive = model.Drive(
        model.VoltageSourceConverter(u_dc=BUS_V),
        model.SynchronousMachine(machine),
        model.StiffMechanicalSystem(J=INERTIA_KG_M2, B_L=LOAD_NM_S_PER_RAD),
    )
    reference = sm.CurrentReferenceCfg(
        machine, max_i_s=30.0, nom_w_m=POLE_PAIRS * 2 * math.pi, min_psi_s=FLUX_V_S
    )
    control = sm.CurrentVectorControl(
        machine, reference, T_s=PERIOD_S, alpha_c=BANDWIDTH_RAD_S, sensorless=False
    )
    control.ref.tau_M = lambda t: TORQUE_NM * (t > STEP_S)
    simulation = model.Simulation(drive, control)

    def run() -> tuple[int, float]:
        simulation.simulate(t_stop=seconds)
        ticks = len(control.data.ref.t)
        torque = drive.machine.data.tau_M
        return ticks, float(torque[torque.size // 2 :].mean())

    return run


def gym_electric_motor(seconds: float) -> Run:
    """Return a run of gym-electric-motor's PMSM with a PI controller in rotor coordinates."""
    import gym_electric_motor
    import numpy as np
    from gym_electric_motor.physical_systems import PolynomialStaticLoad
    from gym_electric_motor.reference_generators import (
        ConstReferenceGenerator,
        MultipleReferenceGenerator,
    )

    limits = {"i": 40.0, "omega": 20.0, "u": BUS_V}
    environment = gym_electric_motor.make(
        "Cont-CC-PMSM-v0",
        tau=PERIOD_S,
        supply={"u_nominal": BUS_V},
        motor={
            "motor_parameter": {
                "p": POLE_PAIRS,
                "r_s": RESISTANCE_OHM,
                "l_d": INDUCTANCE_H,
                "l_q": INDUCTANCE_H,
                "psi_p": FLUX_V_S,
                "j_rotor": INERTIA_KG_M2,
            },
            "limit_values": limits,
            "nominal_values": limits,
        },
        load=PolynomialStaticLoad(
            load_parameter={"a": 0.0, "b": LOAD_NM_S_PER_RAD, "c": 0.0, "j_load": 1e-6}
        ),
        reference_generator=MultipleReferenceGenerator(
            [ConstReferenceGenerator(name, 0.0) for name in ("i_sd", "i_sq")]
        ),
    ).unwrapped
    system = environment.physical_system
    names = list(system.state_names)
    d, q, angle = (names.index(name) for name in ("i_sd", "i_sq", "epsilon"))
    torque = names.index("torque")
    scale = system.limits
    gain_ohm, rate_per_s = BANDWIDTH_RAD_S * INDUCTANCE_H, RESISTANCE_OHM / INDUCTANCE_H
    ahead_rad = 0.5 * POLE_PAIRS * SPEED_RAD_S * PERIOD_S

    def run() -> tuple[int, float]:
        (state, _), _ = environment.reset()
        u_d = u_q = total_Nm = 0.0
        ticks = round(seconds / PERIOD_S)
        for tick in range(ticks):
            wanted_A = CURRENT_A if tick * PERIOD_S > STEP_S else 0.0
            e_d, e_q = -state[d] * scale[d], wanted_A - state[q] * scale[q]
            u_d += gain_ohm * rate_per_s * PERIOD_S * e_d
            u_q += gain_ohm * rate_per_s * PERIOD_S * e_q
            v_d, v_q = u_d + gain_ohm * e_d, u_q + gain_ohm * e_q
            theta = state[angle] * scale[angle] + ahead_rad
            cosine, sine = math.cos(theta), math.sin(theta)
            a, b = v_d * cosine - v_q * sine, v_d * sine + v_q * cosine
            b *= math.sqrt(3) / 2
            action = np.array([a, b - a / 2, -b - a / 2]) / (BUS_V / 2)
            (state, _), _, terminated, _, _ = environment.step(np.clip(action, -1, 1))
            if terminated:
                raise RuntimeError(f"gym-electric-motor ended the episode at tick {tick}")
            if 2 * tick >= ticks:
                total_Nm += state[torque] * scale[torque]
        return ticks, float(total_Nm / (ticks - (ticks + 1) // 2))

    return run


PEERS: dict[str, Callable[[float], Run]] = {
    "motulator": motulator,
    "gym-electric-motor": gym_electric_motor,
}


def main(name: str, seconds: float) -> None:
    """Run one library once and print what it took."""
    run = PEERS[name](seconds)
    begun_s, begun_cpu_s = time.perf_counter(), time.process_time()
    ticks, torque_Nm = run()
    result = {
        "ticks": ticks,
        "wall_s": time.perf_counter() - begun_s,
        "cpu_s": time.process_time() - begun_cpu_s,
        "torque_Nm": torque_Nm,
        "version": version(name),
    }
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
