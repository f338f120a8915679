# SPDX-License-Identifier: Apache-2.0
"""Trim of hover beside the paper's Table 1, and what makes the difference; JSON.

Usage: ./heli python -m evidence.experiments.trim_table

The paper's b_s and phi say how large its tail rotor's thrust is: in hover the side forces add up to
nothing, thrust of the tail = m g (phi + b_s) to first order. Ours is read from the model.
"""

import json
import sys

import numpy as np

from evidence.files import Results
from evidence.registry import produces, table
from evidence.tables import grid
from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import trim

PAPER = {
    "phi": 0.0287, "theta": 0.0011, "a_s": -0.0011, "b_s": 0.0042,
    "d_lat": 0.0075, "d_lon": -0.0060, "d_col": -0.1793,
}  # fmt: skip
"""Table 1, rad and shares of the travel; all else there is 0."""


def trim_of(aircraft: HelicopterParameters) -> dict[str, float]:
    """Trim of still-air hover in the terms of Table 1."""
    point = trim(aircraft)
    phi, theta, _ = euler_from_quat(point.x[PLANT.quat])
    values = (
        phi, theta, point.x[PLANT.a_s], point.x[PLANT.b_s],
        point.u[ACTUATOR.lat], point.u[ACTUATOR.lon], point.u[ACTUATOR.col],
    )  # fmt: skip
    return dict(zip(PAPER, (float(value) for value in values), strict=True))


def tail_share(values: dict[str, float]) -> float:
    """The tail rotor's thrust over the weight that a trim takes, to first order."""
    return values["phi"] + values["b_s"]


def experiment() -> dict[str, object]:
    """Ours, the paper's, the tail's thrusts, and the lever at which phi would be the paper's."""
    aircraft = HelicopterParameters.from_yaml("helion.yaml")
    ours = trim_of(aircraft)
    share = tail_share(PAPER) / tail_share(ours)
    return {
        "ours": ours,
        "paper": PAPER,
        "tail_over_weight": {"ours": tail_share(ours), "paper": tail_share(PAPER)},
        "torque_share": share,
        "lever_m": {"ours": aircraft.tail_arm_m, "paper": aircraft.tail_arm_m / share},
        "mass_kg": aircraft.mass_kg,
    }


def main() -> int:
    """Print the figures."""
    print(json.dumps(experiment()))
    return 0


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "trim_table",
    "./heli python -m evidence.experiments.trim_table",
    "Trim of hover beside the paper's Table 1.",
)


@table("trim_table")
def trim_table(results: Results) -> str:
    """Table 1, entry by entry."""
    record = results["trim_table"]
    rows = [
        [name, f"{theirs:.4f}", f"{ours:.4f}", f"{ours - theirs:+.4f}"]
        for (name, ours), theirs in zip(
            record["ours"].items(), record["paper"].values(), strict=True
        )
    ]
    tail, lever = record["tail_over_weight"], record["lever_m"]
    return (
        f"{grid(['', 'the paper, Table 1', 'ours', 'difference'], rows)}\n\nAngles in rad, "
        "actuators as shares of their travel; all else is 0 in both. phi + b_s is the tail rotor's "
        f"thrust over the weight: {tail['paper']:.4f} there, {tail['ours']:.4f} here, "
        f"{np.round(100 * record['torque_share']):.0f} % of it. So that aircraft has less torque "
        "for its weight or a longer tail: at our torque and weight a lever of "
        f"{lever['paper']:.2f} m in place of {lever['ours']:.2f} m."
    )


if __name__ == "__main__":
    sys.exit(main())
