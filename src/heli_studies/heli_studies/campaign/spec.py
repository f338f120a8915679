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
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from heli_dynamics_sim.aircraft_file import read_groups
from heli_dynamics_sim.parameters import find_aircraft
from heli_flight.loop.fault_file import fault_overrides
from heli_flight.loop.layers import GPS_PRESETS, TABLES
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.dispersion.distribution import Distribution, distribution_of
from heli_flight.studies.dispersion.sampling import GRID, SAMPLINGS, correlated, unit_points
from heli_parameters.parameters import Parameter, ParameterError
from heli_parameters.printable import printable

AIRCRAFT = "aircraft"
EACH = "each"
_FAULTS = "plant.faults"
_ELEMENT = re.compile(r"(.+)\[(\d+)\]")
_MOST_FLIGHTS = 1 << 24
_LEVELS = 5
_SHOWN = 40


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
        said = {key: value for key, value in asdict(self).items() if key != "chunk"}
        said["params"] = [Path(path).read_text(encoding="utf-8") for path in self.params]
        text = json.dumps(said, sort_keys=True, default=str)
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
        said = {**self.set, **{k: v for k, v in values.items() if not _of_aircraft(k)}}
        overrides = by_section(said, self.base)
        if aircraft is not None:
            overrides.setdefault("plant", {})["aircraft_file"] = str(aircraft)
        return resolve(
            self.scenario, self.gps, self.flight_seed(number), self.duration_s, params=self.params,
            overrides=overrides, world=self.world, laws=self.laws,
        )  # fmt: skip

    def aircraft(self, number: int) -> dict[str, Any] | None:
        """The aircraft file of a flight as {group.key: value}; None if none is dispersed."""
        values = dict(zip(self.names, self.inputs[number], strict=True))
        own = {key.partition(".")[2]: v for key, v in values.items() if _of_aircraft(key)}
        if not own:
            return None
        return {**read_groups(find_aircraft(self.base.nodes["plant"]["aircraft_file"])), **own}


def _of_aircraft(name: str) -> bool:
    return name.partition(".")[0] == AIRCRAFT


def by_section(said: Mapping[str, Any], base: Settings) -> dict[str, dict[str, Any]]:
    """{section.name: value} as overrides {section: {name: value}}; elements put into arrays."""
    found: dict[str, dict[str, Any]] = {}
    for name, value in said.items():
        section, _, key = name.partition(".")
        own = found.setdefault(section, {})
        element = _ELEMENT.fullmatch(key)
        if element is None:
            own[key] = value
            continue
        whole, place = element[1], int(element[2])
        array = np.array(own.get(whole, values_of(base, section)[whole]), dtype=float)
        if not _is_number(value):
            raise ParameterError(f"{name}: {value!r}; allowed: a number")
        array.flat[place] = value
        own[whole] = array.ravel().tolist()
    return found


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
        told = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise ParameterError(f"{path}: {' '.join(str(error).split())}") from None
    try:
        return _checked(told, path.parent)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def _checked(told: Any, folder: Path) -> Spec:
    if not isinstance(told, Mapping):
        raise ParameterError("holds no keys; allowed: " + ", ".join(f.name for f in fields(Spec)))
    known = [f.name for f in fields(Spec)]
    for key in told:
        if key not in known:
            raise ParameterError(_unknown("", str(key), known))
    _numbers(told)
    _words(told)
    values = dict(told)
    values["params"] = tuple(str(folder / name) for name in _list(told, "params"))
    values["set"] = {**_mapping(told, "set"), **_faults(told, folder)}
    bare = Spec(**{**values, "set": {}, "disperse": {}, "correlate": (), "flights": 1,
                   "sampling": "random"})  # fmt: skip
    for name in values["set"]:
        if _ELEMENT.fullmatch(name):
            _row_of(name, bare.base, "set")
    plain = Spec(**{**values, "disperse": {}, "correlate": (), "flights": 1, "sampling": "random"})
    base = plain.base
    values["disperse"] = _disperse(_mapping(told, "disperse"), base)
    values["correlate"] = _correlate(_list(told, "correlate"), values["disperse"])
    spec = Spec(**values)
    _check_count(spec)
    check_ends(spec, base)
    return spec


def _unknown(where: str, key: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(key, known, n=1)
    hint = f"did you mean {where}{near[0]}?" if near else f"allowed: {', '.join(known[:_SHOWN])}"
    return f"{where}{printable(key)}: unknown key; {hint}"


def _numbers(told: Mapping[str, Any]) -> None:
    for key, least, most in (
        ("flights", 0, _MOST_FLIGHTS), ("seed", 0, 1 << 62), ("levels", 2, 1000),
        ("chunk", 1, 10_000),
    ):  # fmt: skip
        value = told.get(key, least)
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
            raise ParameterError(f"{key}: {value!r}; allowed: an integer from {least} to {most}")
    own = told.get("flight_seeds", EACH)
    if own != EACH and (not isinstance(own, int) or isinstance(own, bool) or own < 0):
        raise ParameterError(f"flight_seeds: {own!r}; allowed: {EACH} or an integer from 0 on")
    length = told.get("duration_s")
    if length is not None and not _is_number(length):
        raise ParameterError(f"duration_s: {length!r}; allowed: a number")


def _words(told: Mapping[str, Any]) -> None:
    for key in ("scenario", "gps", "world", "laws", "faults"):
        if told.get(key) is not None and not isinstance(told[key], str):
            raise ParameterError(f"{key}: {told[key]!r}; allowed: a name")
    for key, known in (("sampling", SAMPLINGS), ("gps", GPS_PRESETS)):
        if told.get(key) is not None and told[key] not in known:
            raise ParameterError(f"{key}: {told[key]!r}; allowed: {', '.join(known)}")


def _mapping(told: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = told.get(key) or {}
    if not isinstance(value, Mapping):
        raise ParameterError(f"{key}: {value!r}; allowed: one line per parameter")
    return {str(name): v for name, v in value.items()}


def _faults(told: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """What a file of faults sets in every flight."""
    if not told.get("faults"):
        return {}
    if _FAULTS in _mapping(told, "set"):
        raise ParameterError(f"faults: {told['faults']}; allowed: one of faults and set: {_FAULTS}")
    over = fault_overrides(folder / told["faults"]) or {}
    return {f"{node}.{key}": list(v) for node, said in over.items() for key, v in said.items()}


def _list(told: Mapping[str, Any], key: str) -> Sequence[Any]:
    value = told.get(key) or []
    if not isinstance(value, list):
        raise ParameterError(f"{key}: {value!r}; allowed: a list")
    return value


def _disperse(told: Mapping[str, Any], base: Settings) -> dict[str, Distribution]:
    found = {}
    for name, how in told.items():
        section, _, key = name.partition(".")
        where = f"disperse: {name}"
        if section == AIRCRAFT:
            groups = read_groups(find_aircraft(base.nodes["plant"]["aircraft_file"]))
            if key not in groups:
                raise ParameterError(_unknown(f"disperse: {AIRCRAFT}.", key, list(groups)))
            kind = "string" if isinstance(groups[key], str) else "double"
            found[name] = distribution_of(how, kind, where)
            continue
        row = _row_of(name, base, "disperse")
        found[name] = distribution_of(how, row.kind.removesuffix("[]"), where)
    return found


def _row_of(name: str, base: Settings, key: str) -> Parameter:
    """The row of `section.name` or `section.name[place]`; ParameterError if there is none."""
    section, _, own = name.partition(".")
    sections = [node for node in TABLES if node in base.nodes or node == "scenario"]
    if section not in sections:
        raise ParameterError(_unknown(f"{key}: ", section, [*sections, AIRCRAFT]))
    element = _ELEMENT.fullmatch(own)
    bare = element[1] if element else own
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
    told: Sequence[Any], disperse: Mapping[str, Distribution]
) -> tuple[tuple[str, str, float], ...]:
    found = []
    for one in told:
        good = isinstance(one, list) and len(one) == 3
        rho = one[2] if good and _is_number(one[2]) else math.nan
        if not -1.0 < rho < 1.0 or one[0] == one[1]:
            raise ParameterError(
                f"correlate: {one!r}; allowed: [one name, another one, a number between -1 and 1]"
            )
        for name in one[:2]:
            if name not in disperse:
                raise ParameterError(_unknown("correlate: ", str(name), list(disperse)))
        found.append((one[0], one[1], float(rho)))
    return tuple(found)


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
