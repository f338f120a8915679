# SPDX-License-Identifier: Apache-2.0
"""`heli.design`: the loops of an aircraft with their proof, as systems of python-control."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heli.options import split
from heli.waiting import told_when_long
from heli_flight.loop.settings import resolve
from heli_flight.loop.worlds import HOVER_TEST_WORLD
from heli_flight.studies.design.make import Design as Made
from heli_flight.studies.design.make import aircraft_basis, design_of, write_yaml
from heli_parameters.parameters import ParameterError

if TYPE_CHECKING:
    import control


class Design:
    """A design: its numbers, its loops, and the parameters that fly it.

    Attributes
    ----------
    parameters : mapping of node to mapping of parameter to value
        What it decides: `heli.fly(params=design)` flies it.
    made : heli_flight Design
        Everything, as `heli design` prints it.
    """

    def __init__(self, made: Made) -> None:
        self.made = made
        self.parameters: Mapping[str, Mapping[str, Any]] = made.values

    @property
    def controller(self) -> str:
        """The attitude law that was designed, as the parameter `controller` names it."""
        return self.made.attitude.controller

    @property
    def gamma(self) -> float:
        """Bound on the H-infinity norm, of the law that flies."""
        return float(self._bound.gamma)

    @property
    def gamma_star(self) -> float:
        """Infimum of the bounds that can be had, eq. (14)."""
        return float(self._bound.gamma_star.value)

    @property
    def norm(self) -> float:
        """Norm that was reached, below gamma: the certificate."""
        return float(self._bound.norm)

    @property
    def _bound(self) -> Any:
        return self.made.attitude.output or self.made.attitude.synthesis

    @property
    def F(self) -> NDArray[np.float64]:
        """(3, 9): state feedback of eq. (17)."""
        return self.made.attitude.synthesis.F

    @property
    def G(self) -> NDArray[np.float64]:
        """(3, 3): feedforward of eq. (17)."""
        return self.made.attitude.synthesis.G

    @property
    def model(self) -> control.StateSpace:
        """The linear aircraft, eq. (9): nine states; d_lat d_lon d_ped, wind_u wind_v wind_w in."""
        return self.made.basis.system

    @property
    def plant(self) -> control.StateSpace:
        """What the law sees as it flies: sampled, with servos and delay; named signals."""
        return self.made.loops[-1].plant

    @property
    def law(self) -> control.StateSpace:
        """The law as it flies: the measured states and commands in, d_lat d_lon d_ped out."""
        return self.made.loops[-1].controller

    @cached_property
    def closed_loop(self) -> control.StateSpace:
        """Plant and law: wind and commands in, the weighted output h and the actuators out."""
        return self.made.loops[-1].closed

    @property
    def margins(self) -> dict[str, Any]:
        """Of the loop as flown: disk margins at input and output, each channel, further delay."""
        flown = self.made.reports[-1]
        return {
            "disk_input": flown.disk_input,
            "disk_output": flown.disk_output,
            "channels_input": flown.channels_input,
            "further_delay_s": self.made.further_delay_s,
        }

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the parameter file that flies it: `./hover_test.sh --params FILE`."""
        write_yaml(self.made, Path(path), "heli.design")
        return Path(path)

    def __repr__(self) -> str:
        flown = self.made.reports[-1]
        return (
            f"Design: {self.controller}, {self.made.basis.source}\n"
            f"  gamma {self.gamma:.5g}, gamma* {self.gamma_star:.5g}, norm {self.norm:.5g}\n"
            f"  loop as flown: stability {flown.stability:.3g} rad/s, disk margin "
            f"{flown.disk_input.alpha:.3g} at the input, {flown.disk_output.alpha:.3g} at the "
            f"output, further delay {1e3 * self.made.further_delay_s:.0f} ms"
        )


def design(
    params: Any = None,
    *,
    aircraft: str | None = None,
    gamma: float | None = None,
    gamma_factor: float | None = None,
    quiet: bool = False,
) -> Design:
    """Trim, linearise, synthesise, choose the observer, analyse: as `heli design`.

    Parameters
    ----------
    params : optional
        As of `heli.fly`: weights (`{"inner_loop": {"C11": ...}}`), or files.
    aircraft : str, optional
        A packaged aircraft's name, or an aircraft file.
    gamma, gamma_factor : float, optional
        Bound of state feedback (`controller: hinf`), or the same as a multiple of gamma*; that of
        the packaged law is the parameter `output.gamma`.
    quiet : bool
        True: nothing is printed. Else what is being worked out goes to stderr from 2 s on.

    Returns
    -------
    Design

    Raises
    ------
    ParameterError, AircraftError, TrimError, SynthesisError
        Each with one sentence.

    Examples
    --------
    >>> design = heli.design({"inner_loop": {"controller": "hinf"}}, gamma_factor=1.2)
    >>> heli.fly(params=design, controller="hinf")
    """
    files, over = split(params)
    if gamma is not None and gamma_factor is not None:
        raise ParameterError("gamma and gamma_factor: give one of them, not both")
    settings = resolve(params=files, overrides=over).at_100_hz("heli.design")
    air = resolve(params=files, overrides=over, world=HOVER_TEST_WORLD).nodes["plant"]
    with told_when_long("heli.design", quiet) as tell:
        tell("trim and linear model")
        basis = aircraft_basis(settings, aircraft)
        return Design(design_of(basis, settings, gamma, gamma_factor, air, tell=tell))
