# SPDX-License-Identifier: Apache-2.0
"""Aircraft files: where they lie, what a value may be, and how a bad one is refused."""

import math
from collections.abc import Mapping
from dataclasses import Field, field, fields
from pathlib import Path
from typing import Any

import yaml

from heli_parameters.printable import printable

# libyaml where it is built in, ten times faster.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_LONGEST = 80
COUPLINGS = ("identified", "eq7")


class AircraftError(ValueError):
    """An aircraft file that cannot be used; the message names file, key and bounds."""


def number(
    key: str, symbol: str, unit: str, lower: float, upper: float, meaning: str, closed: bool = False
) -> Any:
    """A field of the file: bounds are open unless `closed` (then the lower one may be met)."""
    return field(
        metadata={
            "key": key,
            "symbol": symbol,
            "unit": unit,
            "lower": lower,
            "upper": upper,
            "closed": closed,
            "meaning": meaning,
        }
    )


def file_fields(aircraft: Any) -> list[Field[Any]]:
    """Fields of the dataclass of an aircraft, or of one, that stand in its file."""
    return [item for item in fields(aircraft) if "key" in item.metadata]


def allowed(rule: Mapping[str, Any]) -> str:
    """What a key may be, in words."""
    if "lower" not in rule:
        return "one of " + ", ".join(rule["choices"])
    left = "[" if rule["closed"] else "("
    unit = "" if rule["unit"] == "1" else f" {rule['unit']}"
    return f"a number in {left}{rule['lower']:g}, {rule['upper']:g}){unit} ({rule['meaning']})"


def check(rule: Mapping[str, Any], value: Any) -> None:
    """Refuse a value that its rule does not allow."""
    if "lower" not in rule:
        good = value in rule["choices"]
    else:
        good = (
            isinstance(value, (int, float))
            and not isinstance(value, bool)
            and abs(value) < math.inf
            and (value >= rule["lower"] if rule["closed"] else value > rule["lower"])
            and value < rule["upper"]
        )
    if not good:
        said = f"{rule['key']}: {_shown(value)} is not allowed"
        raise AircraftError(f"{said}; allowed: {allowed(rule)}")


def _shown(value: Any) -> str:
    """A value for a sentence, its beginning if it is long."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def flatten(tree: Any) -> dict[str, Any]:
    """`{group: {key: value}}` as `{group.key: value}`."""
    if not isinstance(tree, dict):
        raise AircraftError("expected groups of keys (body:, main_rotor:, ...)")
    flat: dict[str, Any] = {}
    for group, content in tree.items():
        if not isinstance(content, dict):
            said = f"expected a group of keys, found {_shown(content)}"
            raise AircraftError(f"{printable(str(group))}: {said}")
        for key, value in content.items():
            flat[printable(f"{group}.{key}")] = value
    return flat


def config_folders() -> list[Path]:
    """Where the packaged YAML may lie: beside the sources, or in an install space's share/."""
    here = Path(__file__).resolve()
    share = Path("share") / "heli_dynamics_sim" / "config"
    return [here.parents[1] / "config", *(parent / share for parent in here.parents)]


def find_aircraft(path: str | Path) -> Path:
    """The file of an aircraft: a bare name in the packaged folder, else a path that exists.

    A packaged name, with or without `.yaml`, means the packaged file, whatever lies in the working
    directory; `./name` is the way to one there.

    Raises
    ------
    AircraftError
        Names the packaged aircraft if there is none of that name.
    """
    bare = Path(path).name == str(path)
    known: set[str] = set()
    for folder in config_folders() if bare else ():
        for candidate in sorted((folder / "aircraft").glob("*.yaml")):
            if str(path) in (candidate.name, candidate.stem):
                return candidate
            known.add(candidate.name)
    if Path(path).is_file():
        return Path(path)
    hint = f"; packaged: {', '.join(sorted(known)) or 'none'}" if bare else ""
    raise AircraftError(f"{path}: no such aircraft file{hint}")


def read_groups(file: Path) -> dict[str, Any]:
    """Values of an aircraft file as `{group.key: value}`; raises AircraftError."""
    try:
        tree = yaml.load(file.read_text(encoding="utf-8"), Loader=_LOADER)
    except (OSError, UnicodeDecodeError) as error:
        raise AircraftError(f"cannot be read: {error}") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        # A date that is none, an integer of thousands of digits, a thousand brackets.
        reason = " ".join(str(error).split())
        raise AircraftError(f"is not valid YAML: {reason}") from error
    return flatten(tree)
