# SPDX-License-Identifier: Apache-2.0
"""The command `heli list`: what is packaged, one line each, with the option that names it."""

import re
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.common import Json, beginning

LIST_EPILOG = "\b\nexample:\n  heli list scenarios\n  heli list controllers --json"

CONTROLLERS = {
    "hinf_output": "H-infinity output feedback with integral action: the default",
    "hinf": "H-infinity state feedback, eq. (17) of the paper, on the predicted state",
    "lqg": "LQG output feedback with integral action",
    "lqr": "LQR state feedback on the predicted state",
    "pid": "three PID loops: the paper's baseline",
    "matrices": "a linear controller from matrices in your parameter file (law.A to law.D)",
    "indi": "incremental nonlinear dynamic inversion of the body rates",
}
"""Attitude controllers in a few words."""
_OPTIONS = {
    "scenarios": "--scenario",
    "worlds": "--world",
    "aircraft": "--aircraft",
    "controllers": "--attitude-controller",
    "presets": "--control-preset",
}
PUBLISHED = "published"
"""Linear aircraft, which `heli design` takes as it takes the others; listed behind them."""
_END_OF_SENTENCE = re.compile(r"(?<!\b[A-Z])\.(?= [A-Z`]|$)|;(?= )")


def kinds(incomplete: str) -> list[str]:
    """What can be listed."""
    return beginning(incomplete, _OPTIONS)


def packaged(kind: str) -> dict[str, str]:
    """Name to one line of everything packaged of a kind.

    Parameters
    ----------
    kind : str
        scenarios, worlds, aircraft, `PUBLISHED`, controllers or presets.

    Raises
    ------
    ParameterError
        There is no such kind.
    """
    from heli_core.command_line import config_folder
    from heli_core.rcl_yaml import ParameterError

    if kind == "controllers":
        return dict(CONTROLLERS)
    folders = {
        "scenarios": ("heli_flight", "scenarios"),
        "worlds": ("heli_flight", "worlds"),
        "aircraft": ("heli_dynamics_sim", "aircraft"),
        PUBLISHED: ("heli_dynamics_sim", "linear"),
        "presets": ("heli_flight", "laws"),
    }
    if kind not in folders:
        raise ParameterError(f"list {kind}: unknown; known: {', '.join(_OPTIONS)}")
    package, name = folders[kind]
    files = sorted((config_folder(package) / name).glob("*.yaml"))
    return {file.stem: first_sentence(file) for file in files}


def first_sentence(file: Path) -> str:
    """The first sentence of the comment that a YAML file begins with."""
    lines = []
    for line in file.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        if "SPDX" not in line:
            lines.append(line.lstrip("# "))
    text = _END_OF_SENTENCE.split(" ".join(lines), maxsplit=1)[0]
    # Of worlds and presets the line begins with the name, which stands before it already.
    text = re.sub(rf"^(?:World|Control preset) `{file.stem}`: ", "", text)
    return text.strip()


def list_packaged(
    kind: Annotated[
        str,
        typer.Argument(
            metavar="KIND",
            help="scenarios, worlds, aircraft, controllers or presets",
            autocompletion=kinds,
        ),
    ],
    as_json: Json = False,
) -> int:
    """List what is packaged: scenarios, worlds, aircraft, controllers, presets."""
    from heli_flight.terminal import console, json_text

    names = packaged(kind) | (packaged(PUBLISHED) if kind == "aircraft" else {})
    if as_json:
        print(json_text(names), end="")
        return 0
    out, width = console(), max(map(len, names))
    for name, words in names.items():
        out.print(f"{name:<{width}}  {words}", highlight=False, markup=False, soft_wrap=True)
    print(f"fly one: heli hover {_OPTIONS[kind]} NAME" if kind != "aircraft" else
          f"design for one: heli design {_OPTIONS[kind]} NAME")  # fmt: skip
    return 0
