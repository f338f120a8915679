# SPDX-License-Identifier: Apache-2.0
"""A file of faults, as `--faults` takes it, and the faults of a flight."""

from pathlib import Path

import yaml

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import NONE, Fault, fault_of, faults_of
from heli_flight.loop.settings import Settings
from heli_parameters.parameters import ParameterError

_KEY = "faults"
_FORM = f"'{_KEY}:' and a list of mappings"


def read_faults(path: Path) -> tuple[str, ...]:
    """The plant's parameter `faults` of a file.

    Raises
    ------
    ParameterError
        One sentence: file and line, key, value, and what is allowed.
    """
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
        found = [fault_of(e, f"{path}:{e.start_mark.line + 1}") for e in entries.value]
        # Together they may be too many.
        faults_of(texts := tuple(fault.text for fault in found) or (NONE,))
    except PlantConfigError as error:
        raise ParameterError(str(error)) from None
    return texts


def flown_faults(settings: Settings) -> tuple[Fault, ...]:
    """The faults that a flight is to have."""
    return faults_of(settings.nodes["plant"][_KEY])
