# SPDX-License-Identifier: Apache-2.0
"""Laws: which attitude law, position law and observer a scenario is flown with.

A file of laws is an rcl parameter file that says only what differs from the packaged parameters of
the three nodes that control the aircraft. It knows nothing of the aircraft, the air or the sensors:
those are the world's. A law in Python stands in no such file: the parameter `own_law` of its node
names it, and only the command line or Python gives that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from heli_flight.loop.named_files import NamedFiles
from heli_parameters.python_law import INNER, OUTER, PARAMETER, LawError, short_name

if TYPE_CHECKING:
    from heli_flight.loop.settings import Settings

LAWS = NamedFiles("laws", "laws")
PACKAGED = "packaged"
"""The laws that fly unless others are named: nothing is changed."""
SECTIONS = ("observer", "inner_loop", "outer_loop")
"""What a file of laws may tell."""

NODES = {INNER: "inner_loop", OUTER: "outer_loop"}
"""The node in whose place a law in Python flies, by its loop."""


def own_laws(settings: Settings) -> dict[str, str]:
    """By loop the law in Python that the settings name; without those that are packaged."""
    found = {loop: str(settings.nodes[node][PARAMETER]) for loop, node in NODES.items()}
    return {loop: source for loop, source in found.items() if source}


def own_words(settings: Settings) -> str:
    """The same in words, empty for none: my_law:MyLaw in the place of the inner loop."""
    found = own_laws(settings).items()
    return ", ".join(f"{short_name(s)} in the place of the {loop} loop" for loop, s in found)


def without_own(settings: Settings) -> Settings:
    """The same flight with the packaged laws."""
    own = {NODES[loop]: {**settings.nodes[NODES[loop]], PARAMETER: ""} for loop in NODES}
    return replace(settings, nodes={**settings.nodes, **own})


def refuse_own_laws(settings: Settings) -> None:
    """Raise LawError where a law in Python is named for what flies compiled laws alone."""
    for loop, source in own_laws(settings).items():
        raise LawError(
            f"{NODES[loop]}: {PARAMETER}: {short_name(source)} is flown by heli hover --law and "
            "heli.fly; allowed here: none"
        )


def refuse_unnamed(settings: Settings, over: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise LawError where a file names code: a file alone runs none."""
    for loop, source in own_laws(settings).items():
        if PARAMETER not in over.get(NODES[loop], {}):
            raise LawError(
                f"{NODES[loop]}: {PARAMETER}: {source}: a parameter file names this law, whose "
                f"code would run; if you trust it, name it: --law {source}"
            )
