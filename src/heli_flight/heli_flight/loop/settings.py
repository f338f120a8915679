# SPDX-License-Identifier: Apache-2.0
"""Layers of a flight's parameters: packaged defaults < GPS preset < scenario < the user's files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import heli_dynamics_sim.parameter_table as plant_table
import heli_inner_hinf.parameter_table as inner_table
import heli_observer.parameter_table as observer_table
import heli_outer_pd.parameter_table as outer_table
from heli_bags import parameter_table as recorder_table
from heli_flight.loop import scenario as scenario_table
from heli_parameters.common_table import with_common
from heli_parameters.locate import config_folder
from heli_parameters.parameters import Parameter, ParameterError, check_node_names, load

GPS_PRESETS = ("standalone", "rtk")


@dataclass(frozen=True)
class NodeKind:
    """One node of the graph: where it comes from and what it can be told."""

    name: str
    package: str
    executable: str
    table: tuple[Parameter, ...]


NODES = (
    NodeKind("plant", "heli_dynamics_sim", "plant", with_common(plant_table.TABLE)),
    NodeKind("observer", "heli_observer", "observer", with_common(observer_table.TABLE)),
    NodeKind("inner_loop", "heli_inner_hinf", "inner_loop", with_common(inner_table.TABLE)),
    NodeKind("outer_loop", "heli_outer_pd", "outer_loop", with_common(outer_table.TABLE)),
)
SCENARIO_PACKAGE = "heli_flight"


@dataclass(frozen=True)
class Settings:
    """Resolved parameters of every node and of the scenario.

    Attributes
    ----------
    nodes : dict
        Node name to its parameters (dotted name to value).
    scenario : Scenario
    scenario_name, gps : str
    seed : int
    files : tuple of Path
        Every file that was read, weakest first.
    recorder : dict
        The recorder's parameters; they change nothing in the flight.
    """

    nodes: Mapping[str, Mapping[str, Any]]
    scenario: scenario_table.Scenario
    scenario_parameters: Mapping[str, Any]
    scenario_name: str
    gps: str
    seed: int
    files: tuple[Path, ...]
    recorder: Mapping[str, Any] = field(default_factory=dict)


def scenario_names() -> list[str]:
    """Names of the packaged scenarios."""
    folder = config_folder(SCENARIO_PACKAGE) / "scenarios"
    return sorted(path.stem for path in folder.glob("*.yaml"))


def _scenario_file(name: str) -> Path:
    path = config_folder(SCENARIO_PACKAGE) / "scenarios" / f"{name}.yaml"
    if not path.is_file():
        raise ParameterError(
            f"--scenario {name}: unknown scenario; known: {', '.join(scenario_names())}"
        )
    return path


def _initial_state_rules(p: Mapping[str, Any]) -> dict[str, Any]:
    """What the scenario decides for the plant: where, how long."""
    return {
        "initial.pos_ned_m": p["start_pos_ned_m"],
        "initial.psi_deg": p["heading_deg"],
        "duration_s": p["duration_s"],
    }


def resolve(
    scenario_name: str = "hover",
    gps: str = "standalone",
    seed: int | None = None,
    duration_s: float | None = None,
    lockstep: bool = True,
    params: Sequence[str | Path] = (),
    overrides: Mapping[str, Mapping[str, Any]] | None = None,
) -> Settings:
    """Read, layer and check the parameters of a flight.

    Parameters
    ----------
    scenario_name : str
        A packaged scenario.
    gps : str
        One of GPS_PRESETS.
    seed : int, optional
        Overrides the plant's seed.
    duration_s : float, optional
        Overrides the scenario's length.
    lockstep : bool
        False for real time.
    params : sequence of path
        The user's rcl parameter files; a later one overrides an earlier one.
    overrides : mapping of node name to mapping of parameter name to value, optional
        Strongest layer, for campaigns and tests; checked like a file.

    Returns
    -------
    Settings

    Raises
    ------
    ParameterError
        One line that names the file or option, the key, its value and what is allowed.
    """
    if gps not in GPS_PRESETS:
        raise ParameterError(f"--gps {gps}: unknown preset; known: {', '.join(GPS_PRESETS)}")
    scenario_file = _scenario_file(scenario_name)
    user_files = [Path(path) for path in params]
    others = [scenario_table.NODE_NAME, recorder_table.NODE_NAME, "live_view", "identify"]
    known = [node.name for node in NODES] + others
    check_node_names([scenario_file, *user_files], known)
    common = [scenario_file, *user_files]
    scenario_parameters = load(scenario_table.TABLE, common, scenario_table.NODE_NAME)
    strongest = {name: dict(values) for name, values in (overrides or {}).items()}
    if duration_s is not None:
        _set(scenario_table.TABLE, scenario_parameters, "duration_s", duration_s, "--duration")
    scenario_parameters |= strongest.pop(scenario_table.NODE_NAME, {})
    nodes: dict[str, dict[str, Any]] = {}
    files: list[Path] = []
    for node in NODES:
        folder = config_folder(node.package)
        layers = [config_folder("heli_parameters") / "common.yaml", folder / f"{node.name}.yaml"]
        preset = folder / f"gps_{gps}.yaml"
        if preset.is_file():
            layers.append(preset)
        files += layers
        values = load(node.table, [*layers, *common], node.name)
        for key, value in strongest.pop(node.name, {}).items():
            _set(node.table, values, key, value, f"override of {node.name}")
        values["lockstep"] = lockstep
        nodes[node.name] = values
    _check_agreement(nodes)
    if strongest:
        raise ParameterError(f"override of unknown node {next(iter(strongest))}")
    plant = nodes["plant"]
    for key, value in _initial_state_rules(scenario_parameters).items():
        plant[key] = value
    if seed is not None:
        _set(NODES[0].table, plant, "seed", seed, "--seed")
    return Settings(
        nodes,
        scenario_table.Scenario.from_parameters(scenario_parameters),
        scenario_parameters,
        scenario_name,
        gps,
        plant["seed"],
        (*files, *common),
        _recorder(common),
    )


def _recorder(files: Sequence[Path]) -> dict[str, Any]:
    """The recorder's parameters: the packaged ones and what the files say of it."""
    common = config_folder("heli_parameters") / "common.yaml"
    own = config_folder("heli_bags") / f"{recorder_table.NODE_NAME}.yaml"
    layers = [common, own, *files]
    return load(with_common(recorder_table.TABLE), layers, recorder_table.NODE_NAME)


# Pairs that two nodes must agree on: what one sends is what the other waits for.
_AGREEMENTS = (
    ("outer_loop", "period_ticks", "inner_loop", "outer_period_ticks"),
    ("plant", "sensors.mag.period_ticks", "observer", "schedule.mag_period_ticks"),
    ("plant", "sensors.baro.period_ticks", "observer", "schedule.baro_period_ticks"),
    ("plant", "sensors.gps.period_ticks", "observer", "schedule.gps_period_ticks"),
    ("plant", "sensors.gps.latency_ticks", "observer", "schedule.gps_latency_ticks"),
    *(
        ("plant", key, name, key)
        for name in ("observer", "inner_loop", "outer_loop")
        for key in ("start_time_s", "origin.latitude_deg", "origin.longitude_deg",
                    "origin.altitude_m")
    ),
)  # fmt: skip


def _check_agreement(nodes: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ParameterError, naming both sides, where two nodes would wait for different things."""
    for first, key, second, other in _AGREEMENTS:
        a, b = nodes[first][key], nodes[second][other]
        if a != b:
            raise ParameterError(
                f"{first}: {key}: {a} does not agree with {second}: {other}: {b}; "
                "change both together"
            )


def _set(
    table: Sequence[Parameter], values: dict[str, Any], key: str, value: Any, where: str
) -> None:
    """Put one checked value over a loaded one."""
    row = next((row for row in table if row.name == key), None)
    if row is None:
        raise ParameterError(f"{where}: unknown parameter {key}")
    try:
        values[key] = row.check(value)
    except ParameterError as error:
        raise ParameterError(f"{where}: {key}: {error}") from None
