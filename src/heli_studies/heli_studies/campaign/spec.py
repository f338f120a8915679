# SPDX-License-Identifier: Apache-2.0
"""What a campaign flies: a YAML file, read and checked before anything flies.

`SPEC.yaml` holds the keys of `Spec`; each dispersed parameter is one key of `disperse`: a node's
section and the parameter's name (`plant.scale.mass`), with an index for an element of an array
(`plant.wind.profile_speed_mps[1]`), or `aircraft.` and a key of the aircraft's file that the plant
flies (`aircraft.body.mass_kg`; the controllers keep their own).
"""

import difflib
import hashlib
import itertools
import json
import math
import os
import re
import shutil
import tempfile
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from heli_core.folders import write_whole
from heli_core.foreign_files import FileError, read_text, read_yaml
from heli_core.parameters import Parameter
from heli_core.rcl_yaml import ParameterError, file_refusal, printable
from heli_dynamics_sim.aircraft import AircraftError, find_aircraft, read_groups
from heli_dynamics_sim.trim import TrimError
from heli_flight.flight_file import fault_overrides, write_parameters
from heli_flight.layers import GPS_PRESETS, TABLES
from heli_flight.loop import simulate
from heli_flight.result import Result
from heli_flight.scoring import score
from heli_flight.settings import Settings, resolve

# -------------------------------------------------------------------------------------------------
# How one parameter is dispersed: from a number in the unit interval to a value.
# -------------------------------------------------------------------------------------------------

CHOICE = "choice"
_TINY = 1e-12


@dataclass(frozen=True)
class _Kind:
    """A continuous distribution: its numbers in order, what they must be, its quantiles."""

    numbers: tuple[str, ...]
    allowed: str
    fits: Callable[..., bool]
    quantile: Callable[..., NDArray[np.float64]]


def _truncated(
    share: NDArray[np.float64], mean: float, sigma: float, low: float, high: float
) -> NDArray[np.float64]:
    ends = (low - mean) / sigma, (high - mean) / sigma
    return np.asarray(stats.truncnorm.ppf(share, *ends, loc=mean, scale=sigma))


KINDS: Mapping[str, _Kind] = {
    "uniform": _Kind(
        ("low", "high"), "low < high", lambda low, high: low < high,
        lambda share, low, high: low + (high - low) * share,
    ),
    "normal": _Kind(
        ("mean", "sigma"), "sigma > 0", lambda mean, sigma: sigma > 0.0,
        lambda share, mean, sigma: np.asarray(stats.norm.ppf(share, mean, sigma)),
    ),
    "truncated_normal": _Kind(
        ("mean", "sigma", "low", "high"), "sigma > 0 and low < high",
        lambda mean, sigma, low, high: sigma > 0.0 and low < high, _truncated,
    ),
}  # fmt: skip
NAMES = (*KINDS, CHOICE)


@dataclass(frozen=True)
class Distribution:
    """The distribution of one parameter.

    Attributes
    ----------
    kind : str
        One of `NAMES`.
    numbers : tuple
        What `KINDS` calls for, or the choices.
    whole : bool
        The parameter is an integer: uniform is then over the integers from low to high, both
        among them.
    """

    kind: str
    numbers: tuple[Any, ...]
    whole: bool = False

    def __str__(self) -> str:
        return f"{self.kind} {', '.join(map(str, self.numbers))}"

    def values(self, share: NDArray[np.float64]) -> list[Any]:
        """Quantiles at shares (N,) of the unit interval, as parameters hold them."""
        if self.kind == CHOICE:
            places = np.minimum((share * len(self.numbers)).astype(int), len(self.numbers) - 1)
            return [self.numbers[place] for place in places]
        if self.whole:
            low, high = self.numbers
            return [int(low + min(math.floor(s * (high - low + 1)), high - low)) for s in share]
        inside = np.clip(share, _TINY, 1.0 - _TINY)
        return [float(v) for v in KINDS[self.kind].quantile(inside, *self.numbers)]

    def levels(self, count: int) -> list[Any]:
        """Values of a grid: all choices or integers; else `count`, of uniform with both ends."""
        if self.kind == CHOICE:
            return list(self.numbers)
        if self.whole:
            return list(range(self.numbers[0], self.numbers[1] + 1))
        if self.kind == "uniform":
            return [float(v) for v in np.linspace(self.numbers[0], self.numbers[1], count)]
        return self.values((np.arange(count) + 0.5) / count)


def distribution_of(entry: Any, parameter_kind: str, where: str) -> Distribution:
    """Read one from a spec, such as {uniform: [0.8, 1.2]}.

    Parameters
    ----------
    entry : object
        What stands in the YAML.
    parameter_kind : str
        Kind of the parameter's row: double, int, string or bool.
    where : str
        Names the place, for sentences.

    Raises
    ------
    ParameterError
    """
    if not isinstance(entry, Mapping) or len(entry) != 1 or next(iter(entry)) not in NAMES:
        raise ParameterError(f"{where}: {entry!r}; allowed: one of {', '.join(NAMES)}")
    ((kind, numbers),) = entry.items()
    if not isinstance(numbers, Sequence) or isinstance(numbers, str) or not numbers:
        raise ParameterError(f"{where}: {kind}: {numbers!r}; allowed: a list")
    if kind == CHOICE:
        return Distribution(CHOICE, tuple(numbers))
    if parameter_kind not in ("double", "int"):
        raise ParameterError(f"{where}: {kind}: the parameter is no number; allowed: {CHOICE}")
    whole = parameter_kind == "int"
    return Distribution(kind, _distribution_numbers(kind, numbers, whole, where), whole)


def _distribution_numbers(
    kind: str, numbers: Sequence[Any], whole: bool, where: str
) -> tuple[Any, ...]:
    """The numbers of a continuous distribution, checked."""
    form, values = KINDS[kind], list(numbers)
    if whole and kind != "uniform":
        raise ParameterError(f"{where}: {kind}: the parameter is whole; allowed: uniform, {CHOICE}")
    number = (int,) if whole else (int, float)
    good = len(values) == len(form.numbers) and all(
        isinstance(n, number) and not isinstance(n, bool) and math.isfinite(n) for n in values
    )
    if not good or not form.fits(*values):
        what = "whole numbers" if whole else "numbers"
        names = ", ".join(form.numbers)
        raise ParameterError(
            f"{where}: {kind}: {values}; allowed: {what} [{names}] with {form.allowed}"
        )
    return tuple(values) if whole else tuple(map(float, values))


# -------------------------------------------------------------------------------------------------
# Which points of the unit cube a campaign flies.
# -------------------------------------------------------------------------------------------------

GRID = "grid"
SAMPLINGS = ("random", "latin_hypercube", "sobol", GRID)
SEARCH = "search"
"""Points that were looked for: no sample, which nobody may take quantiles or shares of."""
# Child of the seed's sequence: far from those of wind, sensors and worlds.
_STREAM = 1 << 21


def unit_points(sampling: str, count: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Points (N, d) in the unit cube.

    Parameters
    ----------
    sampling : str
        One of `SAMPLINGS` but the grid.
    count, dimensions : int
    seed : int
        Of the sampling alone; the flights have their own.

    Raises
    ------
    ParameterError
        Sobol points that are no power of two have no balance.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_STREAM,)))
    if dimensions == 0:
        return np.zeros((count, 0))
    if sampling == "random":
        return rng.random((count, dimensions))
    if sampling == "latin_hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=rng).random(count))
    power = count.bit_length() - 1
    if count != 1 << power:
        raise ParameterError(
            f"flights: {count}: sobol needs a power of two; allowed: {1 << power}, {2 << power}"
        )
    return np.asarray(qmc.Sobol(dimensions, seed=rng).random_base2(power))


def correlated(
    points: NDArray[np.float64], pairs: Sequence[tuple[int, int, float]]
) -> NDArray[np.float64]:
    """Points (N, d) with a Gaussian copula: each column stays uniform.

    Parameters
    ----------
    points : (N, d) array
    pairs : sequence of (int, int, float)
        Columns and the correlation of their normal scores; rank correlations are
        6/pi asin(rho/2) (Pearson 1907).

    Raises
    ------
    ParameterError
        There are no variables that correlate so.
    """
    if not pairs:
        return points
    matrix = np.eye(points.shape[1])
    for i, j, rho in pairs:
        matrix[i, j] = matrix[j, i] = rho
    try:
        factor = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        least = float(np.linalg.eigvalsh(matrix)[0])
        raise ParameterError(
            f"correlate: no variables correlate so (least eigenvalue {least:.3g}); allowed: a "
            "positive definite matrix"
        ) from None
    scores = stats.norm.ppf(np.clip(points, _TINY, 1.0 - _TINY))
    return np.asarray(stats.norm.cdf(scores @ factor.T))


# -------------------------------------------------------------------------------------------------
# Spec.
# -------------------------------------------------------------------------------------------------

AIRCRAFT = "aircraft"
EACH = "each"
_FAULTS = "plant.faults"
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")
_MOST_FLIGHTS = 1 << 24
_LEVELS = 5
_SHOWN = 40
_LONGEST = 600


@dataclass(frozen=True)
class Spec:
    """A campaign.

    Attributes
    ----------
    flights : int
        How many; of a grid: left out, it follows from the levels.
    sampling : str
        One of `SAMPLINGS`.
    seed : int
        Of the sampling.
    flight_seeds : "each" or int
        Seed of wind and sensors: a flight's own number from 1 on, or the same for all.
    levels : int
        Of a grid, of each parameter that is no integer and no choice.
    chunk : int
        Flights of a task; results do not depend on it.
    scenario, gps, world, laws : str or None
        As the options of `heli hover`; None: its defaults.
    duration_s : float or None
    params : sequence of str
        Parameter files, relative to the spec.
    faults : str or None
        File of faults (`heli hover --faults`), relative to the spec; each flight has them.
    set : mapping
        By `section.name` what is the same in every flight.
    disperse : mapping
        By `section.name` a distribution.
    correlate : sequence
        [one name, another one, correlation of their normal scores].
    """

    flights: int = 0
    sampling: str = "latin_hypercube"
    seed: int = 1
    flight_seeds: str | int = EACH
    levels: int = _LEVELS
    chunk: int = 16
    scenario: str | None = None
    gps: str | None = None
    world: str | None = None
    laws: str | None = None
    duration_s: float | None = None
    params: tuple[str, ...] = ()
    faults: str | None = None
    set: Mapping[str, Any] = field(default_factory=dict)
    disperse: Mapping[str, Distribution] = field(default_factory=dict)
    correlate: tuple[tuple[str, str, float], ...] = ()

    @cached_property
    def identity(self) -> str:
        """What tells this campaign from others: all that decides its rows, SHA-256."""
        content = {key: value for key, value in asdict(self).items() if key != "chunk"}
        content["params"] = [read_text(path) for path in self.params]
        text = json.dumps(content, sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the dispersed parameters, in the order of the spec."""
        return tuple(self.disperse)

    @cached_property
    def inputs(self) -> list[list[Any]]:
        """Per flight the values of the dispersed parameters, in the order of `names`."""
        if self.sampling == GRID:
            axes = [d.levels(self.levels) for d in self.disperse.values()]
            return [list(row) for row in itertools.product(*axes)]
        points = unit_points(self.sampling, self.flights, len(self.names), self.seed)
        at = {name: i for i, name in enumerate(self.names)}
        points = correlated(points, [(at[a], at[b], rho) for a, b, rho in self.correlate])
        columns = [d.values(points[:, i]) for i, d in enumerate(self.disperse.values())]
        return [list(row) for row in zip(*columns, strict=True)] or [
            [] for _ in range(self.flights)
        ]

    @property
    def count(self) -> int:
        """Flights of it."""
        return len(self.inputs)

    def fly(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """Rows of these flights, as of `fly_rows`."""
        return fly_rows(self, numbers)

    def killed(self, number: int) -> dict[str, Any]:
        """The row of a flight that took its process along, again and again."""
        return _begun(self, number) | _end(
            FlightEnding.KILLED, "the process that flew it ended each time"
        )

    def flight_seed(self, number: int) -> int:
        """Seed of wind and sensors of a flight, counted from 0."""
        return number + 1 if self.flight_seeds == EACH else int(self.flight_seeds)

    @cached_property
    def base(self) -> Settings:
        """The flight without dispersions; raises ParameterError."""
        return resolve(
            self.scenario, self.gps, duration_s=self.duration_s, params=self.params,
            overrides=by_section(self.set, _resolved(self)), world=self.world, laws=self.laws,
        )  # fmt: skip

    def settings(self, number: int, aircraft: Path | None = None) -> Settings:
        """A flight's parameters; `aircraft` is the file of its aircraft if that is dispersed."""
        values = dict(zip(self.names, self.inputs[number], strict=True))
        parameters = {**self.set, **{k: v for k, v in values.items() if not _of_aircraft(k)}}
        overrides = by_section(parameters, self.base)
        if aircraft is not None:
            overrides.setdefault("plant", {})["aircraft_file"] = str(aircraft)
        flown = resolve(
            self.scenario, self.gps, self.flight_seed(number), self.duration_s, params=self.params,
            overrides=overrides, world=self.world, laws=self.laws,
        )  # fmt: skip
        # A dispersed aircraft has a file of its own, and the bounds of that which it varies.
        metrics = self.base.scenario.metrics
        return replace(flown, scenario=replace(flown.scenario, metrics=metrics))

    def aircraft(self, number: int) -> dict[str, Any] | None:
        """The aircraft file of a flight as {group.key: value}; None if none is dispersed."""
        values = dict(zip(self.names, self.inputs[number], strict=True))
        dispersed = {key.partition(".")[2]: v for key, v in values.items() if _of_aircraft(key)}
        if not dispersed:
            return None
        return {
            **read_groups(find_aircraft(self.base.nodes["plant"]["aircraft_file"])),
            **dispersed,
        }


def _of_aircraft(name: str) -> bool:
    return name.partition(".")[0] == AIRCRAFT


def by_section(parameters: Mapping[str, Any], base: Settings) -> dict[str, dict[str, Any]]:
    """{section.name: value} as overrides {section: {name: value}}; elements put into arrays."""
    overrides: dict[str, dict[str, Any]] = {}
    for name, value in parameters.items():
        section, _, key = name.partition(".")
        section_values = overrides.setdefault(section, {})
        element = _ELEMENT.fullmatch(key)
        if element is None:
            section_values[key] = value
            continue
        whole, place = element[1], int(element[2])
        array = np.array(section_values.get(whole, values_of(base, section)[whole]), dtype=float)
        if not _is_number(value):
            raise ParameterError(f"{name}: {value!r}; allowed: a number")
        array.flat[place] = value
        section_values[whole] = array.ravel().tolist()
    return overrides


def values_of(base: Settings, section: str) -> Mapping[str, Any]:
    """Resolved parameters of a section."""
    return base.scenario_parameters if section == "scenario" else base.nodes[section]


def _resolved(spec: Spec) -> Settings:
    """The flight without `set`, for elements of arrays."""
    return resolve(spec.scenario, spec.gps, duration_s=spec.duration_s, params=spec.params,
                   world=spec.world, laws=spec.laws)  # fmt: skip


# --- reading -------------------------------------------------------------------------------------


def spec_of(path: Path) -> Spec:
    """Read and check a spec.

    Raises
    ------
    ParameterError
        One line that names the file, the key, its value and what is allowed.
    """
    try:
        content = read_yaml(path)
    except FileError as error:
        raise file_refusal(error, path, "campaign") from None
    try:
        return _checked(content, path.parent)
    except ParameterError as error:
        raise ParameterError(f"{path}: {printable(str(error), _LONGEST)}") from None


def _checked(content: Any, folder: Path) -> Spec:
    if not isinstance(content, Mapping):
        raise ParameterError("holds no keys; allowed: " + ", ".join(f.name for f in fields(Spec)))
    known = [f.name for f in fields(Spec)]
    for key in content:
        if key not in known:
            raise ParameterError(_unknown("", str(key), known))
    _numbers(content)
    _words(content)
    values = dict(content)
    values["params"] = tuple(str(folder / name) for name in _list(content, "params"))
    values["set"] = {**_mapping(content, "set"), **_faults(content, folder)}
    bare = Spec(**{**values, "set": {}, "disperse": {}, "correlate": (), "flights": 1,
                   "sampling": "random"})  # fmt: skip
    for name in values["set"]:
        if _ELEMENT.fullmatch(name):
            _row_of(name, bare.base, "set")
    plain = Spec(**{**values, "disperse": {}, "correlate": (), "flights": 1, "sampling": "random"})
    base = plain.base
    values["disperse"] = _disperse(_mapping(content, "disperse"), base)
    values["correlate"] = _correlate(_list(content, "correlate"), values["disperse"])
    spec = Spec(**values)
    _check_count(spec)
    check_ends(spec, base)
    return spec


def _unknown(where: str, key: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {where}{near[0]}?" if near else f"allowed: {', '.join(known[:_SHOWN])}"
    return f"{where}{printable(key)}: unknown key; {hint}"


def _numbers(content: Mapping[str, Any]) -> None:
    for key, least, most in (
        ("flights", 0, _MOST_FLIGHTS), ("seed", 0, 1 << 62), ("levels", 2, 1000),
        ("chunk", 1, 10_000),
    ):  # fmt: skip
        value = content.get(key, least)
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            raise ParameterError(f"{key}: {value!r}; allowed: an integer from {least} to {most}")
    flight_seeds = content.get("flight_seeds", EACH)
    if flight_seeds != EACH and (
        not isinstance(flight_seeds, int) or isinstance(flight_seeds, bool) or flight_seeds < 0
    ):
        raise ParameterError(
            f"flight_seeds: {flight_seeds!r}; allowed: {EACH} or an integer from 0 on"
        )
    length = content.get("duration_s")
    if length is not None and not _is_number(length):
        raise ParameterError(f"duration_s: {length!r}; allowed: a number")


def _words(content: Mapping[str, Any]) -> None:
    for key in ("scenario", "gps", "world", "laws", "faults"):
        if content.get(key) is not None and not isinstance(content[key], str):
            raise ParameterError(f"{key}: {content[key]!r}; allowed: a name")
    for key, known in (("sampling", SAMPLINGS), ("gps", GPS_PRESETS)):
        if content.get(key) is not None and content[key] not in known:
            raise ParameterError(f"{key}: {content[key]!r}; allowed: {', '.join(known)}")


def _mapping(content: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = content.get(key) or {}
    if not isinstance(value, Mapping):
        raise ParameterError(f"{key}: {value!r}; allowed: one line per parameter")
    return {str(name): v for name, v in value.items()}


def _faults(content: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What a file of faults sets in every flight."""
    if not content.get("faults"):
        return {}
    if _FAULTS in _mapping(content, "set"):
        raise ParameterError(
            f"faults: {content['faults']}; allowed: one of faults and set: {_FAULTS}"
        )
    over = fault_overrides(folder / content["faults"]) or {}
    return {
        f"{node}.{key}": list(v)
        for node, parameters in over.items()
        for key, v in parameters.items()
    }


def _list(content: Mapping[str, Any], key: str) -> Sequence[Any]:
    value = content.get(key) or []
    if not isinstance(value, list):
        raise ParameterError(f"{key}: {value!r}; allowed: a list")
    return value


def _disperse(entries: Mapping[str, Any], base: Settings) -> dict[str, Distribution]:
    distributions = {}
    for name, how in entries.items():
        section, _, key = name.partition(".")
        where = f"disperse: {name}"
        if section == AIRCRAFT:
            groups = read_groups(find_aircraft(base.nodes["plant"]["aircraft_file"]))
            if key not in groups:
                raise ParameterError(_unknown(f"disperse: {AIRCRAFT}.", key, list(groups)))
            kind = "string" if isinstance(groups[key], str) else "double"
            distributions[name] = distribution_of(how, kind, where)
            continue
        row = _row_of(name, base, "disperse")
        distributions[name] = distribution_of(how, row.kind.removesuffix("[]"), where)
    return distributions


def _row_of(name: str, base: Settings, key: str) -> Parameter:
    """The row of `section.name` or `section.name[place]`; ParameterError if there is none."""
    section, _, parameter = name.partition(".")
    sections = [node for node in TABLES if node in base.nodes or node == "scenario"]
    if section not in sections:
        raise ParameterError(_unknown(f"{key}: ", section, [*sections, AIRCRAFT]))
    element = _ELEMENT.fullmatch(parameter)
    bare = element[1] if element else parameter
    row = next((row for row in TABLES[section] if row.name == bare), None)
    if row is None:
        rows = [row.name for row in TABLES[section]]
        raise ParameterError(_unknown(f"{key}: {section}.", bare, rows))
    if row.kind.endswith("[]") != bool(element):
        such = f"{name}[0]" if row.kind.endswith("[]") else f"{section}.{bare}"
        raise ParameterError(f"{key}: {name}: allowed: {such}")
    if element:
        size = np.size(values_of(base, section)[bare])
        if int(element[2]) >= size:
            raise ParameterError(
                f"{key}: {name}: it has {size} elements; allowed: [0] to [{size - 1}]"
            )
    return row


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _correlate(
    entries: Sequence[Any], disperse: Mapping[str, Distribution]
) -> tuple[tuple[str, str, float], ...]:
    correlations = []
    for one in entries:
        good = isinstance(one, list) and len(one) == 3
        rho = one[2] if good and _is_number(one[2]) else math.nan
        if not -1.0 < rho < 1.0 or one[0] == one[1]:
            raise ParameterError(
                f"correlate: {one!r}; allowed: [one name, another one, a number between -1 and 1]"
            )
        for name in one[:2]:
            if name not in disperse:
                raise ParameterError(_unknown("correlate: ", str(name), list(disperse)))
        correlations.append((one[0], one[1], float(rho)))
    return tuple(correlations)


def _check_count(spec: Spec) -> None:
    if spec.sampling == GRID:
        if spec.correlate:
            raise ParameterError("correlate: a grid has none; allowed: another sampling")
        sizes = [len(d.levels(spec.levels)) for d in spec.disperse.values()]
        count = math.prod(sizes)
        if not sizes or count > _MOST_FLIGHTS or spec.flights not in (0, count):
            raise ParameterError(
                f"flights: {spec.flights}; allowed: none, as the grid has {count} "
                f"({' x '.join(map(str, sizes))}), at most {_MOST_FLIGHTS}"
            )
    elif spec.flights == 0:
        raise ParameterError(f"flights: missing; allowed: an integer from 1 to {_MOST_FLIGHTS}")


def check_ends(spec: Spec, base: Settings) -> None:
    """Let each parameter be checked by its row at the smallest and largest value that is flown."""
    for i, name in enumerate(spec.names):
        if _of_aircraft(name):
            continue
        flown = [row[i] for row in spec.inputs]
        ends = {min(flown), max(flown)} if not isinstance(flown[0], str) else set(flown)
        for value in sorted(ends):
            try:
                resolve(
                    spec.scenario, spec.gps, duration_s=spec.duration_s, params=spec.params,
                    overrides=by_section({**spec.set, name: value}, base), world=spec.world,
                    laws=spec.laws,
                )  # fmt: skip
            except ParameterError as error:
                raise ParameterError(f"disperse: {name}: {value}: {error}") from None


# -------------------------------------------------------------------------------------------------
# One flight of a campaign: its inputs in, one row with its figures and its end out.
# -------------------------------------------------------------------------------------------------


class FlightEnding(StrEnum):
    """How a flight ended."""

    FLOWN = "flown"
    PARTIAL = "partial"
    LOST = "lost"
    NO_TRIM = "no trim holds it"
    REFUSED = "parameters refused"
    THREW = "threw"
    KILLED = "killed its process"


NUMBER, SEED, CAUSE, SENTENCE, EXIT_CODE = "flight", "seed", "cause", "sentence", "exit_code"
COVERAGE = "coverage"
"""Share of what is judged that is in the record, 0 to 1; 0 of a flight of which nothing is."""
FIXED = (NUMBER, SEED, CAUSE, SENTENCE, EXIT_CODE, COVERAGE)
"""Columns of every campaign; `in.` and `max.` begin those of inputs and of figures."""
INPUT, FIGURE, WHOLE = "in.", "max.", "max_whole."
FILES_IN = "HELI_CAMPAIGN_FOLDER"
"""Environment variable of processes that may be killed: where flights write, cleared up by who
started them (default: the temporary folder)."""


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
    with tempfile.TemporaryDirectory(prefix="heli_flights_", dir=os.getenv(FILES_IN)) as folder:
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
        write_whole(file, yaml.safe_dump(groups, sort_keys=False))
    return spec.settings(number, file)


def _row(spec: Spec, number: int, folder: Path) -> dict[str, Any]:
    row = _begun(spec, number)
    try:
        settings = settings_of(spec, number, folder)
        flight = simulate(settings)
    except TrimError as error:
        return row | _end(FlightEnding.NO_TRIM, str(error))
    except (ParameterError, AircraftError) as error:
        return row | _end(FlightEnding.REFUSED, str(error))
    except Exception as error:
        # The campaign goes on; what it was stands in the row.
        at = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(at.filename).name}:{at.lineno}"
        return row | _end(FlightEnding.THREW, f"{type(error).__name__}: {error} ({where})")
    if flight.sentence:
        return row | _end(FlightEnding.LOST, flight.sentence)
    result = Result(score(flight.record, settings.scenario, settings.rate), "", 0.0, 0.0)
    lacking, figures = result.partial(settings.gps), result.figures
    ending = FlightEnding.PARTIAL if lacking else FlightEnding.FLOWN
    share = result.coverage(settings.gps).share
    row |= _end(ending, lacking, result.exit_code(settings.gps), share)
    if lacking:
        return row
    row |= {f"{WHOLE}{s.name}": float(s.max) for s in figures.whole}
    return row | {f"{FIGURE}{s.name}": float(s.max) for s in figures.windows}


def _begun(spec: Spec, number: int) -> dict[str, Any]:
    inputs = dict(zip(spec.names, spec.inputs[number], strict=True))
    row: dict[str, Any] = {NUMBER: number, SEED: spec.flight_seed(number)}
    return row | {f"{INPUT}{name}": value for name, value in inputs.items()}


def _end(cause: FlightEnding, sentence: str, code: int = 1, share: float = 0.0) -> dict[str, Any]:
    return {CAUSE: cause.value, SENTENCE: sentence, EXIT_CODE: code, COVERAGE: share}


# -------------------------------------------------------------------------------------------------
# Parameter files with which flights of a campaign are flown again, alone.
# -------------------------------------------------------------------------------------------------


def write_rerun_files(spec: Spec, numbers: Sequence[int], folder: Path) -> list[Path]:
    """Write a folder `flight_N` for each, and give the files for `heli hover --params`.

    Those whose parameters were refused have none.

    Raises
    ------
    ParameterError
        The folder cannot be written.
    """
    written = []
    for number in numbers:
        flight_folder = folder / f"flight_{number}"
        try:
            flight_folder.mkdir(parents=True, exist_ok=True)
            settings = settings_of(spec, number, flight_folder.resolve())
        except OSError as error:
            raise ParameterError(f"{flight_folder}: {error.strerror or error}") from None
        except (ParameterError, AircraftError):
            shutil.rmtree(flight_folder)
            continue
        write_parameters(settings, flight_folder / "params.yaml")
        written.append(flight_folder / "params.yaml")
    return written
