# SPDX-License-Identifier: Apache-2.0
"""A flight in one figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import pyplot as plt

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from heli.flight import Flight

_TIME = "time (s)"
# Okabe and Ito: told apart by the colour-blind.
_BLUE, _ORANGE, _GREEN, _RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"


def draw(flight: Flight, title: str) -> Figure:
    """Altitude, track, attitude, actuators; the figure is shown by who has it."""
    figure, axes = plt.subplots(2, 2, figsize=(10.0, 7.0), layout="constrained")
    # A notebook would show it a second time at the end of the cell.
    plt.close(figure)
    figure.suptitle(title, fontsize=9, wrap=True)
    _altitude(axes[0, 0], flight)
    _track(axes[0, 1], flight)
    _attitude(axes[1, 0], flight)
    _actuators(axes[1, 1], flight)
    for axis in axes.flat:
        axis.grid(True, color="#dddddd", linewidth=0.5)
        axis.legend(fontsize=8)
    return figure


def _altitude(axis: Any, flight: Flight) -> None:
    axis.plot(flight.time_s, flight.truth.altitude_m, color=_BLUE, label="truth")
    axis.plot(flight.time_s, flight.nav.altitude_m, ":", color=_ORANGE, label="navigation")
    axis.plot(flight.time_s, flight.reference.altitude_m, "--", color=_RED, label="reference")
    axis.set(xlabel=_TIME, ylabel="altitude (m)", title="Altitude")


def _track(axis: Any, flight: Flight) -> None:
    for group, label, style, color in (
        (flight.truth, "truth", "-", _BLUE),
        (flight.nav, "navigation", ":", _ORANGE),
        (flight.reference, "reference", "--", _RED),
    ):
        axis.plot(group.east_m, group.north_m, style, color=color, label=label)
    axis.set(xlabel="east (m)", ylabel="north (m)", title="Track")
    axis.set_aspect("equal", adjustable="datalim")


def _attitude(axis: Any, flight: Flight) -> None:
    angles = (("phi", "roll", _BLUE), ("theta", "pitch", _ORANGE), ("psi", "heading", _GREEN))
    for name, words, color in angles:
        truth, wanted = (
            np.degrees(np.unwrap(group[f"{name}_rad"])) for group in (flight.truth, flight.setpoint)
        )
        axis.plot(flight.time_s, truth, color=color, label=words)
        axis.plot(flight.time_s, wanted, "--", color=color, linewidth=0.8)
    axis.set(xlabel=_TIME, ylabel="angle (deg)", title="Attitude (dashed: commanded)")


def _actuators(axis: Any, flight: Flight) -> None:
    for name, color in zip(flight.u, (_BLUE, _ORANGE, _GREEN, _RED), strict=True):
        axis.plot(flight.time_s, flight.u[name], color=color, label=name)
    axis.set(xlabel=_TIME, ylabel="actuator (-1 to 1)", title="Actuators")
