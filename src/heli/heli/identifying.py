# SPDX-License-Identifier: Apache-2.0
"""`heli.identify`: an aircraft from two flights of it, as `heli identify --one-process`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from heli.designing import Design
from heli.flight import as_dataframe
from heli.options import split
from heli.signals import html_table
from heli_flight.studies.design.make import write_yaml
from heli_flight.studies.identify.command import Outcome, Wanted, misses, run
from heli_flight.studies.identify.compare import Row, fast_of
from heli_identification.experiment import CHANNELS, RATES
from heli_identification.measured import measured_response
from heli_identification.spectra import spectra_of
from heli_identification.system import COMMANDS, sampled_rates
from heli_math.ticks import TICK_S
from heli_parameters.parameters import ParameterError

if TYPE_CHECKING:
    import control
    import pyarrow

    from heli_identification.response import FastModel

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
        Model, observer and laws from identified numbers.
    rows : sequence of Row
        Every number: `name`, `value`, `sigma`, `truth`, `deviation`, `significant`, `met`.
    found : heli_flight Identification
        Everything.
    """

    def __init__(self, outcome: Outcome) -> None:
        self._outcome, self.found = outcome, outcome.found
        self.parameters: Mapping[str, Mapping[str, Any]] = self.found.design.values
        self.rows: Sequence[Row] = outcome.rows

    @property
    def A(self) -> NDArray[np.float64]:
        """(9, 9), eq. (10)."""
        return self.found.ab.A

    @property
    def B(self) -> NDArray[np.float64]:
        """(9, 3): effect of d_lat d_lon d_ped."""
        return self.found.ab.B

    @property
    def E(self) -> NDArray[np.float64]:
        """(9, 3): effect of the wind."""
        return self.found.wind.E

    @property
    def system(self) -> control.StateSpace:
        """The identified aircraft, eq. (9), with named signals."""
        return self.found.design.basis.system

    @cached_property
    def design(self) -> Design:
        """Observer and laws that were designed for it."""
        return Design(self.found.design)

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
        for what, given, known in (("rate", rate, RATES), ("actuator", actuator, COMMANDS)):
            if given not in known:
                raise ParameterError(
                    f"{what} {given!r} is not allowed; allowed: {', '.join(known)}"
                )
        channel = _ACTUATORS[COMMANDS.index(actuator)]
        data = measured_response(
            spectra_of(self.found.actuators), self.found.ab.fast, rate, channel
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
            of(self.found.ab.fast),
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

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the parameter file that flies it: `./hover_test.sh --params FILE`."""
        write_yaml(self.found.design, Path(path), "heli.identify, from flight data")
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
    wanted = Wanted(
        aircraft=aircraft, params=files, seed=None if seed is None else int(seed), gps=gps,
        gamma_factor=gamma_factor, one_process=True, quiet=quiet,
    )  # fmt: skip
    return Identified(run(wanted, None))
