# SPDX-License-Identifier: Apache-2.0
"""Trim and linearise an aircraft and write model, trim and PID gains into an inner-loop YAML.

Usage: ./heli python scripts/write_inner_loop_yaml.py [AIRCRAFT.yaml] [INNER_LOOP.yaml]

Only those numbers change; comments and everything else in the file stay. Prints the observer gain K
that the margins of the loop as flown choose, for the observer's YAML.
"""

import sys
from pathlib import Path

import numpy as np

from heli_core.parameters import load
from heli_core.rows import NINE
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import linearize, trim
from heli_inner_hinf.design import AttitudeConfig, flow_array, write_model_yaml
from heli_inner_hinf.loops import Model
from heli_inner_hinf.parameters import NODE_NAME, TABLE
from heli_inner_hinf.tuning import choose_observer_gain, gains_of, tune_pid

SOURCES = Path(__file__).resolve().parent.parent / "src"


def main() -> int:
    """Write the file; 0 on success."""
    given = [Path(a) for a in sys.argv[1:3]]
    default = [
        SOURCES / "heli_dynamics_sim/config/aircraft/helion.yaml",
        SOURCES / "heli_inner_hinf/config/inner_loop.yaml",
    ]
    aircraft, target = given + default[len(given) :]
    params = HelicopterParameters.from_yaml(aircraft)
    at = trim(params)
    linear = linearize(params, at)
    x_trim, u_trim = linear.x_trim.copy(), at.u
    x_trim[NINE.psi] = 0.0
    write_model_yaml(target, linear.A, linear.B, linear.E, x_trim, u_trim)
    config = AttitudeConfig.from_parameters(load(TABLE, [target], NODE_NAME))
    gains = config.synthesis
    model = Model(config.A, config.B, config.E, config.C, config.D, gains.F, gains.G)
    axes = tune_pid(model)
    write_model_yaml(target, linear.A, linear.B, linear.E, x_trim, u_trim, gains_of(axes))
    best, _ = choose_observer_gain(model, config.prediction_s)
    np.set_printoptions(precision=4, suppress=True)
    print(f"gamma* = {config.synthesis.gamma_star.value:.6f}, gamma = {config.gamma:g}")
    for axis in axes:
        print(axis)
    print(f"observer poles {best.poles}, K: {flow_array(best.K, 4, 6)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
