# SPDX-License-Identifier: Apache-2.0
"""A file of faults, as `--faults` takes it, and the faults of a flight."""

from pathlib import Path
from typing import NamedTuple

import yaml

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import NONE, Fault, fault_of, faults_of
from heli_flight.loop.process_fault import (
    PROCESS,
    ProcessFault,
    is_of_process,
    process_fault_of,
    process_faults_of,
)
from heli_flight.loop.settings import Settings
from heli_parameters.parameters import ParameterError

_KEY = "faults"
NO_PROCESSES = "needs the ROS graph with a process for each node, of one aircraft"
_FORM = f"'{_KEY}:' and a list of mappings"


class FaultsRead(NamedTuple):
    """Parameters out of a file: `faults` of the plant, `process_faults` of the flight."""

    plant: tuple[str, ...]
    process: tuple[str, ...]


def read_faults(path: Path) -> tuple[str, ...]:
    """The plant's parameter `faults` of a file, for a flight without processes.

    Raises
    ------
    ParameterError
        One sentence: file and line, key, value, and what is allowed.
    """
    read = read_all_faults(path)
    if read.process != (NONE,):
        raise ParameterError(f"{path}: what: {PROCESS}: {NO_PROCESSES}")
    return read.plant


def read_all_faults(path: Path) -> FaultsRead:
    """All faults of a file; raises as `read_faults`."""
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), Loader=yaml.SafeLoader)
    except OSError as error:
        raise ParameterError(f"{path}: cannot read faults: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ParameterError(f"{path}: cannot read faults: it is not UTF-8") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark is not None else ""
        raise ParameterError(f"{path}{line}: not valid YAML; expected {_FORM}") from None
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    entries = pairs[0][1] if [key.value for key, _ in pairs] == [_KEY] else None
    if not isinstance(entries, yaml.SequenceNode):
        raise ParameterError(f"{path}: expected {_FORM}")
    try:
        where = {id(e): f"{path}:{e.start_mark.line + 1}" for e in entries.value}
        mine = [e for e in entries.value if is_of_process(e)]
        process = tuple(process_fault_of(e, where[id(e)]).text for e in mine) or (NONE,)
        found = [fault_of(e, where[id(e)]) for e in entries.value if e not in mine]
        # Together they may be too many.
        faults_of(texts := tuple(fault.text for fault in found) or (NONE,))
        process_faults_of(process)
    except PlantConfigError as error:
        raise ParameterError(str(error)) from None
    return FaultsRead(texts, process)


def flown_faults(settings: Settings) -> tuple[Fault | ProcessFault, ...]:
    """The faults that a flight is to have."""
    return (*faults_of(settings.nodes["plant"][_KEY]), *process_faults_of(settings.process_faults))
