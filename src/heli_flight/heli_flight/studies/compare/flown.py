# SPDX-License-Identifier: Apache-2.0
"""The attitude loop as a flight's settings fly it: linear, of the aircraft that its laws know."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from heli_flight.studies.design.make import LONGEST_DELAY_S
from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.analysis import loops_of, model_of
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import Loop
from heli_inner_hinf.margins import disk_margin, further_delay_s


class Margins(NamedTuple):
    """What a loop keeps.

    Attributes
    ----------
    input, output : float
        Disk margins at the plant's input and at its measured outputs, all channels at once.
    delay_s : float
        Further transport delay, in all channels at once, that it survives, at most
        `LONGEST_DELAY_S`.
    """

    input: float
    output: float
    delay_s: float


def loop_as_flown(
    nodes: Mapping[str, Mapping[str, Any]], actuation: Actuation | None = None
) -> Loop | None:
    """Any law behind servos and delay, state feedback behind observer (19) and prediction besides.

    Parameters
    ----------
    nodes : mapping
        Parameters of inner loop and observer.
    actuation : Actuation, optional
        Another one than that which the law knows.

    Returns
    -------
    Loop or None
        None for a kind of law whose linear form is not known.
    """
    return _loop(AttitudeConfig.from_parameters(nodes["inner_loop"]), nodes["observer"], actuation)


def margins_as_flown(nodes: Mapping[str, Mapping[str, Any]]) -> Margins | None:
    """Margins of the loop as flown, the observer included; None if its linear form is not known."""
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    loop = _loop(config, nodes["observer"])
    if loop is None:
        return None
    return Margins(
        disk_margin(loop, "input").alpha,
        disk_margin(loop, "output").alpha,
        further_delay_s(loop, model_of(config), config.actuation, LONGEST_DELAY_S),
    )


def _loop(
    config: AttitudeConfig, observer: Mapping[str, Any], actuation: Actuation | None = None
) -> Loop | None:
    feed = ObserverInput.from_parameters(observer)
    *_, flown = (None, *loops_of(config, observer["K"], feed, actuation or config.actuation))
    return flown
