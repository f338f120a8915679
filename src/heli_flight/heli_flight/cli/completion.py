# SPDX-License-Identifier: Apache-2.0
"""What the shell offers when the user presses Tab: scenarios, worlds, laws, presets, aircraft.

Used by typer's completion (`heli --install-completion`). Imports wait until Tab is pressed. Where
nothing is offered the shell offers files.
"""

from typing import Any

from typer import Context


def scenarios(incomplete: str) -> list[str]:
    """Packaged scenarios."""
    from heli_flight.loop.layers import scenario_names

    return _beginning(incomplete, scenario_names())


def worlds(incomplete: str) -> list[str]:
    """Packaged worlds."""
    from heli_flight.loop.worlds import WORLDS

    return _beginning(incomplete, WORLDS.names())


def laws(incomplete: str) -> list[str]:
    """Packaged laws."""
    from heli_flight.loop.laws import LAWS

    return _beginning(incomplete, LAWS.names())


def gps_presets(incomplete: str) -> list[str]:
    """Receivers."""
    from heli_flight.loop.layers import GPS_PRESETS

    return _beginning(incomplete, GPS_PRESETS)


def controllers(incomplete: str) -> list[str]:
    """Attitude laws."""
    from heli_inner_hinf.law_state import CONTROLLERS

    return _beginning(incomplete, CONTROLLERS)


def manoeuvres(incomplete: str) -> list[str]:
    """Manoeuvres that can be scored."""
    from heli_handling.definitions import MANOEUVRES

    return _beginning(incomplete, MANOEUVRES)


def compared_laws(incomplete: str) -> list[str]:
    """Laws of a comparison, after those that stand before the last comma."""
    from heli_flight.studies.compare.laws import LAWS

    before, comma, last = incomplete.rpartition(",")
    return [before + comma + name for name in _beginning(last, [law.key for law in LAWS])]


def aircraft(incomplete: str) -> list[str]:
    """Packaged aircraft."""
    from heli_parameters.locate import config_folder

    packaged = (config_folder("heli_dynamics_sim") / "aircraft").glob("*.yaml")
    return _beginning(incomplete, sorted(path.name for path in packaged))


def node_packages(incomplete: str) -> list[str]:
    """Packages that hold a node."""
    return _beginning(incomplete, sorted({package for package, _ in _executables()}))


def nodes(context: Context, incomplete: str) -> list[str]:
    """Nodes of the package that stands before."""
    mine = [name for package, name in _executables() if package == context.params["package"]]
    return _beginning(incomplete, sorted(mine))


def _executables() -> list[tuple[str, str]]:
    """Package and name of what `heli run` can start."""
    from heli_parameters.locate import executables

    return executables("heli_")


def _beginning(incomplete: str, names: Any) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
