# SPDX-License-Identifier: Apache-2.0
"""`heli.design`: the loops of an aircraft with their proof, as systems of python-control."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli.arguments import in_python, refused
from heli.flight import as_dataframe, html_table
from heli.flying import split
from heli_analysis.identification.actuators import COMMANDS, sampled_rates
from heli_analysis.identification.model import measured_response
from heli_analysis.identification.spectra import CHANNELS, RATES, spectra_of
from heli_core.errors import InfeasibleGammaError, ParameterError
from heli_core.rows import ACTUATOR, ACTUATOR_NAMES, SETPOINT, STATE_NAMES
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import LinearModel, reduced_state
from heli_dynamics_sim.trim import TrimPoint as PlantTrim
from heli_dynamics_sim.trim import linearize as linearize_about
from heli_dynamics_sim.trim import trim as find_trim
from heli_flight.settings import resolve
from heli_flight.terminal import told_when_long
from heli_flight.worlds import HOVER_TEST_WORLD
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.state import collective_for_thrust as collective_of_map
from heli_studies.design.make import FinishedDesign as Made
from heli_studies.design.make import aircraft_basis, design_of, write_yaml
from heli_studies.identify import (
    ComparisonRow,
    IdentifyOrder,
    IdentifyOutcome,
    fast_of,
    misses,
    run,
)

if TYPE_CHECKING:
    import control
    import pyarrow

    from heli_analysis.identification.model import FastModel


# -------------------------------------------------------------------------------------------------
# Designing.
# -------------------------------------------------------------------------------------------------


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
        """The attitude controller that was designed, as the parameter `controller` names it."""
        return self.made.attitude.controller

    @property
    def gamma(self) -> float | None:
        """Bound on the H-infinity norm of the controller that flies; None of one without."""
        bound = self.made.attitude.bound
        return None if bound is None else float(bound.gamma)

    @property
    def gamma_star(self) -> float | None:
        """Infimum of the bounds that it can have, eq. (14)."""
        bound = self.made.attitude.bound
        return None if bound is None else float(bound.gamma_star.value)

    @property
    def norm(self) -> float | None:
        """Norm that was reached, below gamma: the certificate."""
        bound = self.made.attitude.bound
        return None if bound is None else float(bound.norm)

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
        """The linear aircraft, eq. (9): nine states; d_lat d_lon d_ped, wind_u wind_v wind_w in.

        The wind is in body axes: forward, right, down.
        """
        return self.made.basis.system

    @property
    def plant(self) -> control.StateSpace:
        """What the controller sees as it flies: sampled, with servos and delay; named signals."""
        return self.made.loops[-1].plant

    @property
    def law(self) -> control.StateSpace:
        """The controller in flight: measured states and commands in, d_lat d_lon d_ped out."""
        return self.made.loops[-1].controller

    @cached_property
    def closed_loop(self) -> control.StateSpace:
        """Plant and controller: wind and commands in, weighted output h and actuators out."""
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

    @in_python
    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the parameter file that flies it: `./hover_test.sh --params FILE`."""
        write_yaml(self.made, Path(path), "heli.design")
        return Path(path)

    def __repr__(self) -> str:
        flown, bound = self.made.reports[-1], self.made.attitude.bound
        certificate = "no bound on its norm"
        if bound is not None:
            star = bound.gamma_star.value
            certificate = f"gamma {bound.gamma:.5g}, gamma* {star:.5g}, norm {bound.norm:.5g}"
        return (
            f"Design: {self.controller}, {self.made.basis.source}\n"
            f"  {certificate}\n"
            f"  loop as flown: stability {flown.stability:.3g} rad/s, disk margin "
            f"{flown.disk_input.alpha:.3g} at the input, {flown.disk_output.alpha:.3g} at the "
            f"output, further delay {1e3 * self.made.further_delay_s:.0f} ms"
        )


@in_python
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
        Bound of the controller that flies (`hinf_output` or `hinf`; the others have none), or the
        same as a multiple of its gamma*. Default: the parameter `output.gamma` or `gamma`.
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
    >>> design = heli.design(gamma_factor=1.2)
    >>> heli.fly(params=design)
    """
    files, over = split(params)
    settings = resolve(params=files, overrides=over).at_100_hz("heli.design")
    air = resolve(params=files, overrides=over, world=HOVER_TEST_WORLD).nodes["plant"]
    with told_when_long("heli.design", quiet) as tell:
        tell("trim and linear model")
        basis = aircraft_basis(settings, aircraft)
        try:
            return Design(design_of(basis, settings, gamma, gamma_factor, air, tell=tell))
        except InfeasibleGammaError as error:
            if gamma is None:
                raise
            named = InfeasibleGammaError(error.gamma, error.gamma_star)
            named.argument = "gamma"
            raise named from None


# -------------------------------------------------------------------------------------------------
# `heli.trim` and `heli.linearize`: the aircraft at rest, and its linear model about that.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trim:
    """An equilibrium.

    Attributes
    ----------
    x : (9,) array
        phi theta p q a_s b_s r d_int psi, rad and rad/s (places `heli.NINE`).
    u : (4,) array
        d_lat d_lon d_ped d_col, -1 to 1.
    residual : float
        Largest derivative that should vanish, SI.
    wind_ned_mps : (3,) array
        Velocity of the air: north, east, down.
    speed_mps : float
        Over the ground, along the heading.
    full : heli_dynamics_sim Trim
        All states, in the frame that moves with the aircraft.
    """

    x: NDArray[np.float64]
    u: NDArray[np.float64]
    residual: float
    wind_ned_mps: NDArray[np.float64]
    speed_mps: float
    full: PlantTrim

    @property
    def d_col(self) -> float:
        """The collective that holds it, -1 to 1."""
        return float(self.u[ACTUATOR.col])

    def __repr__(self) -> str:
        wind = np.round(self.wind_ned_mps, 3).tolist()
        states = ", ".join(
            f"{name} {value:.5f}" for name, value in zip(STATE_NAMES, self.x, strict=True)
        )
        inputs = ", ".join(
            f"{name} {value:.5f}" for name, value in zip(ACTUATOR_NAMES, self.u, strict=True)
        )
        return (
            f"Trim at {self.speed_mps:g} m/s in wind {wind} m/s (NED)\n  {states} (rad, rad/s)\n"
            f"  {inputs}\n  residual {self.residual:.1e}"
        )


def aircraft_of(aircraft: Any) -> HelicopterParameters:
    """The aircraft of a name or a file; None: the one that flies unless another is named."""
    file = aircraft or resolve().nodes["plant"]["aircraft_file"]
    return HelicopterParameters.from_yaml(file)


@in_python
def trim(
    aircraft: Any = None,
    wind_ned_mps: ArrayLike = (0.0, 0.0, 0.0),
    speed_mps: float = 0.0,
    psi_rad: float = 0.0,
) -> Trim:
    """Find the equilibrium of hover, or of level flight at a speed, in steady wind.

    Level flight at a steady speed is hover in the opposite wind: the aircraft feels its motion
    through the air alone.

    Parameters
    ----------
    aircraft : str or path, optional
        A packaged aircraft's name, or an aircraft file; default: the packaged one.
    wind_ned_mps : (3,) array
        Velocity of the air: north, east, down.
    speed_mps : float
        Over the ground, along the heading.
    psi_rad : float
        Heading.

    Returns
    -------
    Trim

    Raises
    ------
    AircraftError, ParameterError, TrimError
        Each with one sentence.

    Examples
    --------
    >>> heli.trim(speed_mps=10.0).x[heli.NINE.theta]
    """
    wind = np.array(wind_ned_mps, dtype=np.float64)
    ahead = np.array([math.cos(psi_rad), math.sin(psi_rad), 0.0])
    at = find_trim(aircraft_of(aircraft), wind - speed_mps * ahead, psi_rad)
    return Trim(reduced_state(at.x), at.u, at.residual, wind, float(speed_mps), at)


@in_python
def linearize(
    aircraft: Any = None,
    wind_ned_mps: ArrayLike = (0.0, 0.0, 0.0),
    speed_mps: float = 0.0,
    psi_rad: float = 0.0,
    side: Literal["descent", "climb"] = "descent",
) -> LinearModel:
    """Linearise about a trim: x' = A x + B u + E w, deviations from it.

    Parameters
    ----------
    aircraft, wind_ned_mps, speed_mps, psi_rad
        As of `heli.trim`.
    side : {"descent", "climb"}
        The branch of the climb power where the air neither rises nor sinks.

    Returns
    -------
    LinearModel
        A (9, 9), B (9, 3), E (9, 3), x_trim, u_trim; `.system` is a control.StateSpace with named
        states, inputs and outputs. The wind w is in body axes: forward, right, down.

    Raises
    ------
    AircraftError, ParameterError, TrimError
        Each with one sentence.
    """
    if side not in ("descent", "climb"):
        raise refused("side", side, "descent, climb")
    at = trim(aircraft, wind_ned_mps, speed_mps, psi_rad)
    return linearize_about(aircraft_of(aircraft), at.full, side)


@in_python
def collective_for_thrust(thrust_n: float, climb_mps: float = 0.0, params: Any = None) -> float:
    """The collective that gives a thrust, by the map that the position controller flies with.

    Parameters
    ----------
    thrust_n : float
        Along the rotor's axis, upwards, N; mass times gravity holds hover.
    climb_mps : float
        Vertical speed through the air, **up**; negative in a descent.
    params : optional
        As of `heli.fly`: another aircraft's.

    Returns
    -------
    float
        -1 to 1; less is more thrust on the packaged aircraft.

    Raises
    ------
    ParameterError

    Examples
    --------
    >>> heli.collective_for_thrust(9.75 * 9.781)
    """
    files, over = split(params)
    outer = outer_params(resolve(params=files, overrides=over).nodes["outer_loop"])
    tilt = math.cos(outer.trim[SETPOINT.phi]) * math.cos(outer.trim[SETPOINT.theta])
    hover_n, d_col = outer.mass * outer.g / tilt, outer.trim[SETPOINT.col]
    # The map's speed is that of the hub through the air, down.
    return float(collective_of_map(thrust_n, -climb_mps, hover_n, d_col, outer.rotor))


# -------------------------------------------------------------------------------------------------
# `heli.identify`: an aircraft from two flights of it, as `heli identify --one-process`.
# -------------------------------------------------------------------------------------------------

_ACTUATORS = CHANNELS[: len(COMMANDS)]


@dataclass(frozen=True)
class Response:
    """Frequency response of a rate to an actuator, at the lines of the excitation.

    Attributes
    ----------
    hz : (L,) array
    measured : (L,) complex array
        rad/s, of a command of 1; delay and servo included.
    sigma : (L,) array
        Standard deviation of |measured|.
    coherence : (L,) array
        Share of what is periodic in the power: near 1 where the noise says little.
    fit, truth : (L,) complex arrays
        Of the identified aircraft, and of the linearised aircraft file.
    """

    hz: NDArray[np.float64]
    measured: NDArray[np.complex128]
    sigma: NDArray[np.float64]
    coherence: NDArray[np.float64]
    fit: NDArray[np.complex128]
    truth: NDArray[np.complex128]


class Identified:
    """What two flights tell of an aircraft; `heli.fly(params=identified)` flies what it gives.

    Attributes
    ----------
    parameters : mapping of node to mapping of parameter to value
        Model, observer and controllers from identified numbers.
    rows : sequence of ComparisonRow
        Every number: `name`, `value`, `sigma`, `truth`, `deviation`, `significant`, `met`.
    identification : heli_studies Identification
        Everything.
    """

    def __init__(self, outcome: IdentifyOutcome) -> None:
        self._outcome, self.identification = outcome, outcome.identification
        self.parameters: Mapping[str, Mapping[str, Any]] = self.identification.design.values
        self.rows: Sequence[ComparisonRow] = outcome.rows

    @property
    def A(self) -> NDArray[np.float64]:
        """(9, 9), eq. (10)."""
        return self.identification.ab.A

    @property
    def B(self) -> NDArray[np.float64]:
        """(9, 3): effect of d_lat d_lon d_ped."""
        return self.identification.ab.B

    @property
    def E(self) -> NDArray[np.float64]:
        """(9, 3): effect of the wind, body axes: forward, right, down."""
        return self.identification.wind.E

    @property
    def system(self) -> control.StateSpace:
        """The identified aircraft, eq. (9), with named signals."""
        return self.identification.design.basis.system

    @cached_property
    def design(self) -> Design:
        """Observer and controllers that were designed for it."""
        return Design(self.identification.design)

    @property
    def missed(self) -> list[str]:
        """Significant numbers further from the truth than 5 %, of E than 10 %."""
        return [row.name for row in misses(self.rows)]

    def response(self, rate: str, actuator: str) -> Response:
        """Measured frequency response, with that of the fit and of the truth.

        Parameters
        ----------
        rate : {"p", "q", "r"}
        actuator : {"d_lat", "d_lon", "d_ped", "d_col"}

        Raises
        ------
        ParameterError
        """
        for what, name, known in (("rate", rate, RATES), ("actuator", actuator, COMMANDS)):
            if name not in tuple(known):
                raise refused(what, name, ", ".join(known))
        channel = _ACTUATORS[COMMANDS.index(actuator)]
        data = measured_response(
            spectra_of(self.identification.actuators), self.identification.ab.fast, rate, channel
        )
        z = np.exp(1j * data.omega_radps * TICK_S)

        def of(model: FastModel) -> NDArray[np.complex128]:
            return np.asarray(sampled_rates(model)[rate, actuator](z), np.complex128)

        truth = self._outcome.truth
        assert truth is not None  # it was flown here
        return Response(
            data.omega_radps / (2.0 * np.pi),
            data.value,
            data.sigma,
            data.coherence,
            of(self.identification.ab.fast),
            of(fast_of(truth.basis)),
        )

    def to_arrow(self) -> pyarrow.Table:
        """The numbers as a table of pyarrow."""
        import pyarrow

        return pyarrow.table(
            {
                "name": [row.name for row in self.rows],
                "identified": [row.value for row in self.rows],
                "sigma": [row.sigma for row in self.rows],
                "truth": [row.truth for row in self.rows],
                "significant": [row.significant for row in self.rows],
                "met": [row.met for row in self.rows],
            }
        )

    def to_dataframe(self) -> Any:
        """The same as a DataFrame of pandas; ImportError with a sentence where there is none."""
        return as_dataframe(self.to_arrow())

    @in_python
    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the parameter file that flies it: `./hover_test.sh --params FILE`."""
        write_yaml(self.identification.design, Path(path), "heli.identify, from flight data")
        return Path(path)

    @property
    def _title(self) -> str:
        judged = [row for row in self.rows if row.met is not None]
        missed = f"; missed: {', '.join(self.missed)}" if self.missed else ""
        return (
            f"Identified from two flights: {len(judged) - len(self.missed)} of {len(judged)} "
            f"significant numbers within 5 % (E: 10 %) of the linearised truth{missed}"
        )

    def _table(self) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
        return ("", "identified", "+-2 sigma", "truth", "deviation"), [
            (
                row.name,
                f"{row.value:.4g}",
                f"{2.0 * row.sigma:.2g}" if row.sigma > 0.0 else "",
                f"{row.truth:.4g}",
                row.deviation_text,
            )
            for row in self.rows
            if row.significant
        ]

    def __repr__(self) -> str:
        head, rows = self._table()
        widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
        lines = (
            "  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True)).rstrip()
            for row in (head, *rows)
        )
        return "\n".join([self._title, *lines])

    def _repr_html_(self) -> str:
        return html_table(*self._table(), self._title)


@in_python
def identify(
    aircraft: str | None = None,
    *,
    seed: int | None = None,
    gps: str | None = None,
    params: Any = None,
    gamma_factor: float | None = None,
    quiet: bool = False,
) -> Identified:
    """Fly two experiments in this process, fit A, B, E, servos, delay and trims, design from them.

    First the actuators are moved by multisines, then gusts blow, with sensor noise and a calm day's
    turbulence; what is fitted is what the aircraft's own sensors told. Bags: `heli identify`.

    Parameters
    ----------
    aircraft : str, optional
        A packaged aircraft's name, or an aircraft file: what is flown, and compared with.
    seed : int, optional
        Of turbulence and sensors.
    gps : {"standalone", "rtk"}, optional
    params : path, or list of paths, optional
        Parameter files, with constants measured on the ground in the section `identify`.
    gamma_factor : float, optional
        Bound of state feedback as a multiple of gamma*.
    quiet : bool
        True: no progress on stderr.

    Returns
    -------
    Identified

    Raises
    ------
    ParameterError, AircraftError, FlightError, IdentificationError, SynthesisError
        Each with one sentence.

    Examples
    --------
    >>> found = heli.identify(seed=3)
    >>> found.response("p", "d_lat").measured
    >>> heli.fly(params=found, seed=3)
    """
    files, over = split(params)
    if over:
        raise ParameterError("params: of an identification; allowed: files")
    wanted = IdentifyOrder(
        aircraft=aircraft, params=files, seed=seed, gps=gps,
        gamma_factor=gamma_factor, one_process=True, quiet=quiet,
    )  # fmt: skip
    return Identified(run(wanted, None))
