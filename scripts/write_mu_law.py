# SPDX-License-Identifier: Apache-2.0
"""Write the controller `mu`: output feedback by D-K iteration for the packaged aircraft.

Usage: ./heli python scripts/write_mu_law.py [FILE]
       ./heli python scripts/write_mu_law.py --check    exit code 1 if what is shipped is another

The set and the weights are those of `MuWeights`; a minute. Fly it by
`./hover_test.sh --control-preset mu`.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from heli_core.errors import RobustError
from heli_core.rcl_yaml import dump_all
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import OutputLaw, output_law
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import sampled_response
from heli_studies.design.rivals import MuDesign, MuWeights, mu_design

FILE = Path(__file__).resolve().parent.parent / "src/heli_flight/config/laws/mu.yaml"
_DIGITS = 9
_SAME = 1e-3
"""An iteration ends within this share of the controller's largest gain, at every frequency."""
_OMEGA = np.geomspace(0.01, 300.0, 200)


_POSITION = ("attitude_lead.lead_s", "disturbance.attitude_lag_s")
"""Of the position loop, as those of the controller `hinf`."""
_HEADING_LEAD_S = 1.05
"""As this attitude loop lags behind a turning heading."""


def write(design: MuDesign, weights: MuWeights, path: Path) -> None:
    """The controller as a control preset, with what is proved of it in the head."""
    law = {
        f"law.{name}": [float(f"{value:.{_DIGITS}g}") for value in matrix.ravel()]
        for name, matrix in design.law._asdict().items()
    }
    outer = resolve(laws="hinf").nodes["outer_loop"]
    position = {key: outer[key] for key in _POSITION} | {"heading_lead_s": _HEADING_LEAD_S}
    dump_all({"inner_loop": {"controller": "matrices", **law}, "outer_loop": position}, path)
    rounds = ", ".join(f"{peak:.3g}" for peak in design.peaks)
    head = (
        "# Control preset `mu`: output feedback for a set of aircraft, by D-K iteration, written "
        "by scripts/write_mu_law.py.\n"
        f"# The set: roll and pitch stiffness +-{weights.stiffness:.0%}, flapping rate "
        f"+-{weights.flapping:.0%}, yaw +-{weights.yaw:.0%}; each servo\n"
        f"# +-{weights.input_low:.0%} (slow) to {weights.input_high:.0%} (fast), 100 % at about "
        f"{1.0 / weights.input_s:.0f} rad/s.\n"
        f"# mu with performance {design.mu:.4g} (round by round {rounds});\n"
        f"# for stability alone {design.mu_stability:.4g}: every member is stable up to "
        f"1 / {design.mu_stability:.4g} of the set's size.\n"
        f"# {design.law.A.shape[0]} states of {design.full_order}. Units and order of the "
        "matrices: config/inner_loop.yaml of heli_inner_hinf.\n"
    )
    path.write_text(head + path.read_text(encoding="utf-8"), encoding="utf-8")


def difference(inner: Mapping[str, Any], yielded: OutputLaw) -> str:
    """A sentence if the controller of the inner loop's parameters is not what the iteration yields.

    Controllers are held against each other by their responses: which states they are written in,
    and the last digits, hang on the machine.
    """
    shipped = output_law(*(inner[f"law.{part}"] for part in OutputLaw._fields))
    orders = shipped.A.shape[0], yielded.A.shape[0]
    if orders[0] != orders[1]:
        return f"controller mu: shipped with {orders[0]} states, the iteration yields {orders[1]}"
    ours, theirs = (_response(law) for law in (shipped, yielded))
    off = float(np.max(np.abs(ours - theirs)) / np.max(np.abs(theirs)))
    return f"controller mu: off by {off:.2g} of what the iteration yields" if off > _SAME else ""


def _response(law: OutputLaw) -> np.ndarray:
    """(m, 3, 8 + 3), measured states and commands, then what is cut off -> u."""
    inputs, direct = np.hstack([law.B, law.L]), np.pad(law.D, ((0, 0), (0, law.L.shape[1])))
    return law.C @ sampled_response(law.A, inputs, _OMEGA) + direct


def main() -> int:
    """Exit code 2, with a sentence, where the iteration finds no controller."""
    arguments = sys.argv[1:]
    weights = MuWeights()
    try:
        design = mu_design(AttitudeConfig.from_parameters(resolve().nodes["inner_loop"]), weights)
    except RobustError as exc:
        print(f"error: {exc}", file=sys.stderr)
        return 2
    if arguments == ["--check"]:
        told = difference(resolve(laws="mu").nodes["inner_loop"], design.law)
        print(told or "controller mu: shipped is what the iteration yields")
        return 1 if told else 0
    write(design, weights, Path(arguments[0]) if arguments else FILE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
