# SPDX-License-Identifier: Apache-2.0
"""What a design is made from that begins with an identified model: `heli design --identified`.

The file is the one that `heli identify` writes: A, B, E, trim, servos and delay as found in flight,
mass and rotor as measured on the ground. No aircraft file is read.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from heli_core.linear import hover_system
from heli_core.rcl_yaml import ParameterError, read
from heli_core.ticks import TICK_S
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation
from heli_studies.design.make import Basis, FinishedDesign, design_of

IDENTIFIED = "identified.yaml"
_NEEDED = ("model.A", "model.B", "model.E", "trim.x", "trim.u", "servo.frequency_radps",
           "servo.damping", "delay_ticks")  # fmt: skip
_GROUND = ("mass", "gravity", "rotor.rho", "rotor.omega", "rotor.radius", "rotor.lift_slope",
           "rotor.blades", "rotor.chord", "rotor.K_col")  # fmt: skip


def identified_file(path: Path) -> Path:
    """The file of a model, or of a folder that `heli identify` wrote.

    Raises
    ------
    ParameterError
        It holds no model; the sentence names the first parameter that is missing.
    """
    file = path / IDENTIFIED if path.is_dir() else path
    said = {entry.key for entry in read(file).entries}
    lacking = [name for name in (*_NEEDED, *_GROUND) if name not in said]
    if lacking:
        raise ParameterError(
            f"{file}: {lacking[0]} is missing: this is no model that `heli identify` wrote"
        )
    return file


def design_of_identified(
    path: Path,
    params: Sequence[Path] = (),
    gamma: float | None = None,
    gamma_factor: float | None = None,
    controller: str | None = None,
) -> FinishedDesign:
    """Controller, observer and PID for an identified model, with certificate and margins.

    Parameters
    ----------
    path : Path
        `identified.yaml`, or the folder with it.
    params : sequence of path
        rcl parameter files over it: weights, gamma.
    gamma, gamma_factor, controller
        As of `make.make_design`.

    Raises
    ------
    ParameterError, SynthesisError
    """
    file = identified_file(path)
    settings = resolve(params=[file, *params], controller=controller).at_100_hz("heli design")
    inner, outer = settings.nodes["inner_loop"], settings.nodes["outer_loop"]
    shape = (len(inner["trim.x"]), -1)
    A, B, E = (inner[f"model.{name}"].reshape(shape) for name in "ABE")
    basis = Basis(
        source=f"identified in flight, {file}",
        system=hover_system(A, B, E, "identified"),
        x_trim=inner["trim.x"],
        u_trim=inner["trim.u"],
        actuation=Actuation(
            inner["servo.frequency_radps"], inner["servo.damping"], inner["delay_ticks"] * TICK_S
        ),
        outer={name: outer[name] for name in _GROUND},
        plant={},
        residual=float("nan"),
    )
    made = design_of(basis, settings, gamma, gamma_factor)
    return replace(made, remarks=settings.remarks)
