# SPDX-License-Identifier: Apache-2.0
"""One flight of a campaign: its inputs in, one row with its figures and its end out."""

import tempfile
import traceback
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any

import yaml

from heli_dynamics_sim.aircraft_file import AircraftError
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.result import Result
from heli_flight.loop.scoring import score
from heli_flight.loop.settings import Settings
from heli_flight.studies.dispersion.spec import Spec
from heli_parameters.parameters import ParameterError


class Cause(StrEnum):
    """How a flight ended."""

    FLOWN = "flown"
    LOST = "lost"
    NO_TRIM = "no trim holds it"
    REFUSED = "parameters refused"
    THREW = "threw"
    KILLED = "killed its process"


NUMBER, SEED, CAUSE, SENTENCE, EXIT_CODE = "flight", "seed", "cause", "sentence", "exit_code"
FIXED = (NUMBER, SEED, CAUSE, SENTENCE, EXIT_CODE)
"""Columns of every campaign; `in.` and `max.` begin those of inputs and of figures."""
INPUT, FIGURE, WHOLE = "in.", "max.", "max_whole."


def fly_rows(spec: Spec, numbers: Sequence[int]) -> list[dict[str, Any]]:
    """Fly these flights; whatever one of them does, there is a row of it.

    Parameters
    ----------
    spec : Spec
    numbers : sequence of int
        Flights, counted from 0.

    Returns
    -------
    list of dict
        Column name to value. They depend on the spec and the number alone.
    """
    with tempfile.TemporaryDirectory(prefix="heli_campaign_") as folder:
        return [_row(spec, number, Path(folder)) for number in numbers]


def settings_of(spec: Spec, number: int, folder: Path) -> Settings:
    """A flight's parameters; its aircraft, if it has one of its own, is written to the folder.

    Raises
    ------
    ParameterError, AircraftError
    """
    flat, file = spec.aircraft(number), None
    if flat is not None:
        groups: dict[str, dict[str, Any]] = {}
        for name, value in flat.items():
            group, _, key = name.partition(".")
            groups.setdefault(group, {})[key] = value
        file = folder / f"aircraft_{number}.yaml"
        file.write_text(yaml.safe_dump(groups, sort_keys=False), encoding="utf-8")
    return spec.settings(number, file)


def _row(spec: Spec, number: int, folder: Path) -> dict[str, Any]:
    row = _begun(spec, number)
    try:
        settings = settings_of(spec, number, folder)
        flight = simulate(settings)
    except TrimError as error:
        return row | _end(Cause.NO_TRIM, str(error))
    except (ParameterError, AircraftError) as error:
        return row | _end(Cause.REFUSED, str(error))
    except Exception as error:
        # The campaign goes on; what it was stands in the row.
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(at.filename).name}:{at.lineno}"
        return row | _end(Cause.THREW, f"{type(error).__name__}: {error} ({where})")
    if flight.sentence:
        return row | _end(Cause.LOST, flight.sentence)
    figures = score(flight.record, settings.scenario)
    code = Result(figures, "", 0.0, 0.0).exit_code(settings.gps)
    row |= _end(Cause.FLOWN, "", code)
    row |= {f"{WHOLE}{s.name}": float(s.max) for s in figures.whole}
    return row | {f"{FIGURE}{s.name}": float(s.max) for s in figures.windows}


def killed(spec: Spec, number: int) -> dict[str, Any]:
    """The row of a flight that took its process along, again and again."""
    return _begun(spec, number) | _end(Cause.KILLED, "the process that flew it ended each time")


def _begun(spec: Spec, number: int) -> dict[str, Any]:
    inputs = dict(zip(spec.names, spec.inputs[number], strict=True))
    row: dict[str, Any] = {NUMBER: number, SEED: spec.flight_seed(number)}
    return row | {f"{INPUT}{name}": value for name, value in inputs.items()}


def _end(cause: Cause, sentence: str, code: int = 1) -> dict[str, Any]:
    return {CAUSE: cause.value, SENTENCE: sentence, EXIT_CODE: code}
