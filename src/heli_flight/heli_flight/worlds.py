# SPDX-License-Identifier: Apache-2.0
"""Files that an option names: worlds and control presets; what a world's seed draws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from heli_core.command_line import config_folder
from heli_core.parameters import (
    Parameter,
)
from heli_core.rcl_yaml import (
    ParameterError,
)

# -------------------------------------------------------------------------------------------------
# Parameter files that an option names: packaged ones by their name, the user's own by path.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class NamedFiles:
    """One kind of them: worlds, control presets.

    Attributes
    ----------
    word : str
        Key in the section `flight`.
    what : str
        What it is, in words.
    folder : str
        Where the packaged ones lie, under the config folder.
    option : str
        That names one on the command line.
    """

    word: str
    what: str
    folder: str
    option: str

    def names(self) -> list[str]:
        """Names of the packaged ones."""
        return sorted(path.stem for path in self._folder().glob("*.yaml"))

    def file(self, name: str, where: str = "") -> Path:
        """File of a packaged one, or the user's own, by its path.

        Raises
        ------
        ParameterError
            There is none; `where` says who named it, default: the option.
        """
        if name in self.names():
            return self._folder() / f"{name}.yaml"
        path = Path(name)
        if path.suffix in (".yaml", ".yml") and path.is_file():
            return path
        raise ParameterError(
            f"{where or self.option} {name}: unknown {self.what}; known: "
            f"{', '.join(self.names())}, or the path of a YAML file"
        )

    def full_name(self, name: str) -> str:
        """A packaged one's name, or the whole path of a user's: what params.yaml says of it."""
        return name if name in self.names() else str(Path(name).absolute())

    def _folder(self) -> Path:
        return config_folder("heli_flight") / self.folder


# -------------------------------------------------------------------------------------------------
# Controllers: which attitude controller, position controller and observer a scenario is flown with.
#
# A control preset is an rcl parameter file that says only what differs from the packaged parameters
# of the three nodes that control the aircraft. It has no parameters of the aircraft, the air or the
# sensors: those are the world's. A controller in Python is in no such file: the parameter `own_law`
# of its node names it, and only the command line or Python sets that.
# -------------------------------------------------------------------------------------------------

LAWS = NamedFiles("laws", "control preset", "laws", "--control-preset")
PACKAGED = "packaged"
"""The controllers that fly unless others are named: nothing is changed."""
SECTIONS = ("observer", "inner_loop", "outer_loop")
"""What a control preset may tell."""
# -------------------------------------------------------------------------------------------------
# Worlds: what air, aircraft and sensors a scenario is flown in, and what the seed draws of them.
#
# A world is an rcl parameter file: what it changes in the nodes, and a section `world` with what
# the seed samples. The true aircraft is sampled; the controllers keep their nominal model.
# -------------------------------------------------------------------------------------------------

WORLD_SECTION = "world"
WORLDS = NamedFiles("world", "world", "worlds", "--world")
PAPER = "paper"
HOVER_TEST_WORLD = "honest"
"""The world of the hover test where neither option nor file names one."""

_GRADES = ("none", "consumer", "industrial", "rtk")
# Child of the seed's sequence from which worlds draw: far from those of the sources in
# `heli_dynamics_sim.noise`, which are counted from 0, so that no flight's wind or sensors move.
_STREAM = 1 << 20


def _width(name: str, of: str) -> Parameter:
    return Parameter(
        f"draw.{name}", "double", f"Half width of the draw of {of}", "1", lower=0.0, upper=0.8
    )


WORLD_TABLE: tuple[Parameter, ...] = (
    _width("mass", "scale.mass"),
    _width("inertia", "scale.inertia"),
    _width("rotor_stiffness", "scale.rotor_stiffness"),
    _width("thrust", "scale.thrust"),
    _width("servo_speed", "scale.servo_speed"),
    Parameter(
        "draw.delay_ticks", "int", "Half width of the draw of delay_ticks", "ticks",
        lower=0, upper=10,
    ),
    Parameter("sensors.standalone", "string", "Grade of sensors beside this receiver",
              choices=_GRADES),
    Parameter("sensors.rtk", "string", "Grade of sensors beside this receiver", choices=_GRADES),
)  # fmt: skip

DRAWN: tuple[str, ...] = (
    "scale.mass",
    "scale.inertia",
    "scale.rotor_stiffness",
    "scale.thrust",
    "scale.servo_speed",
    "delay_ticks",
)
"""Parameters of the plant that a world may draw. A new one goes to the end: each has a stream of
its own by its place, so that the others keep their numbers."""


@dataclass(frozen=True)
class Draw:
    """A parameter of the plant that is drawn uniformly per seed.

    Attributes
    ----------
    key : str
        One of `DRAWN`.
    centre : float or int
        What it is without the draw.
    width : float or int
        A scale is drawn from centre (1 - width) to centre (1 + width), a number of ticks from
        centre - width to centre + width, whole, and not below 0.
    """

    key: str
    centre: float | int
    width: float | int

    def value(self, seed: int) -> float | int:
        """What a seed draws; independent of wind, sensors and other draws of that seed."""
        children = (_STREAM, DRAWN.index(self.key))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=children))
        if isinstance(self.centre, int):
            width = int(self.width)
            return max(0, self.centre + int(rng.integers(-width, width, endpoint=True)))
        return float(self.centre * rng.uniform(1.0 - self.width, 1.0 + self.width))


def draws(world: Mapping[str, Any], plant: Mapping[str, Any]) -> dict[str, Draw]:
    """What a world draws, by parameter of the plant.

    Parameters
    ----------
    world, plant : mapping
        Parameters of the section `world` and of the plant.
    """
    drawn = {}
    for key in DRAWN:
        width = world[f"draw.{key.removeprefix('scale.')}"]
        if width > 0:
            drawn[key] = Draw(key, plant[key], width)
    return drawn
