# SPDX-License-Identifier: Apache-2.0
"""The attitude laws that others are held against, as families of the same search.

Their numbers are parameters of the inner loop, so that whoever chooses a controller flies what the
search found for it; only those of LQR, whose weights there are H-infinity's, stand in the laws
`lqr`. PID and INDI are not held to the floors at the corners of the set: kept to these they fly
worse than without, and no baseline is detuned. Nor is their heading searched for: the cost weighs
it little, and the search would give it away.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_inner_hinf.actuation import ObserverInput
from heli_inner_hinf.as_flown import pid_as_output_law
from heli_inner_hinf.attitude_search import Family, Yardstick
from heli_inner_hinf.design import AttitudeConfig, added_weights
from heli_inner_hinf.indi import IndiGains, indi_law
from heli_inner_hinf.loops import N_Y, N_Z, Model, as_output_law
from heli_inner_hinf.lqg import lqg_law
from heli_inner_hinf.lqr import lqr
from heli_inner_hinf.output_feedback import generalised_plant
from heli_inner_hinf.output_law import OutputLaw
from heli_inner_hinf.weights import output_selector, weights
from heli_math.grid_search import STRIDES

_PID = ("pid.K_P", "pid.K_I", "pid.K_D")
_INDI = tuple(f"indi.{gain}" for gain in IndiGains._fields)
_LQG = ("lqg.effort", "lqg.integral", "lqg.load", "lqg.noise")
_LQR = ("C11", "C22", "D11", "offset_free_radps")
KEYS = {"pid": _PID, "indi": _INDI, "lqg": _LQG, "lqr": _LQR}
"""By controller, and file of laws, the parameters of the inner loop that the search chooses."""
KEPT = -1
PID_FLOOR = 0.45
"""Disk margin that the PID keeps: with that of the others it would be slower than by its rule."""


class _Shape(NamedTuple):
    """How a law's parameters are made of positive numbers.

    By parameter: which number each of its values is (`KEPT`: none, it stays), its sign, and what
    stands there now.
    """

    places: Mapping[str, NDArray[np.int64]]
    signs: Mapping[str, NDArray[np.float64]]
    now: Mapping[str, NDArray[np.float64]]

    def parameters(self, numbers: Sequence[float]) -> dict[str, NDArray[np.float64]]:
        """The parameters that are these numbers; arrays are flat."""
        n = np.asarray(numbers, float)
        return {
            key: np.where(places == KEPT, self.now[key], self.signs[key] * n[places])
            for key, places in self.places.items()
        }

    def numbers(self) -> tuple[float, ...]:
        """The numbers that the parameters are now."""
        found = {
            place: abs(float(value))
            for key, places in self.places.items()
            for place, value in zip(places, self.now[key], strict=True)
            if place != KEPT
        }
        return tuple(found[place] for place in sorted(found))


def _shape(controller: str, inner: Mapping[str, Any]) -> _Shape:
    """Of PID and INDI roll and pitch; of LQG all, roll and pitch with one noise.

    Of LQR the diagonals but the first weight on an actuator, to which the others are relative.
    """
    keys = KEYS[controller]
    now = {key: np.asarray(inner[key], float).ravel() for key in keys}
    signs = {key: np.where(values < 0.0, -1.0, 1.0) for key, values in now.items()}
    if controller == "lqr":
        return _Shape(_lqr_places(), signs, now)
    places = {}
    for i, key in enumerate(keys):
        if controller != "lqg":
            within = [2 * i, 2 * i + 1, KEPT]
        elif key == "lqg.noise":
            within = [3 * i, 3 * i, 3 * i + 1, 3 * i + 1, 3 * i + 2, 3 * i + 3]
        else:
            within = [3 * i, 3 * i + 1, 3 * i + 2]
        places[key] = np.array(within)
    return _Shape(places, signs, now)


def _lqr_places() -> dict[str, NDArray[np.int64]]:
    """Nine numbers: phi, theta, p, q of C11, r, psi of C22, d_lon, d_ped of D11, the shift."""
    C11, C22, D11 = np.full((4, 4), KEPT), np.full((2, 5), KEPT), np.full((3, 3), KEPT)
    C11[range(4), range(4)] = range(4)
    np.put(C22, [2, 9], [4, 5])
    D11[1, 1], D11[2, 2] = 6, 7
    flat = (C11.ravel(), C22.ravel(), D11.ravel(), np.array([8]))
    return dict(zip(_LQR, flat, strict=True))


def _maker(
    config: AttitudeConfig, controller: str, observer: Mapping[str, Any]
) -> Callable[[Mapping[str, Any]], OutputLaw]:
    """The law of the controller's parameters."""
    if controller == "pid":
        return lambda p: pid_as_output_law(*(p[key] for key in _PID))
    if controller == "indi":
        return lambda p: indi_law(
            config.A, config.B, IndiGains(*(p[key] for key in _INDI)), config.actuation
        )
    if controller == "lqr":
        return lambda p: _lqr_law(config, p, observer)
    model = config.A, config.B, config.E, config.C, config.D
    return lambda p: lqg_law(generalised_plant(*model, added_weights(p, "lqg"), config.actuation))


def _lqr_law(
    config: AttitudeConfig, p: Mapping[str, Any], observer: Mapping[str, Any]
) -> OutputLaw:
    """LQR of C11, C22, D11 with its offset-free target, behind the prediction and observer (19)."""
    shapes = {"C11": (4, 4), "C22": (2, 5), "D11": (3, 3)}
    C, D = weights(*(np.reshape(p[key], shape) for key, shape in shapes.items()))
    found = lqr(config.A, config.B, config.E, C, D, output_selector())
    shift_rate = float(p["offset_free_radps"][0])
    model = Model(config.A, config.B, config.E, C, D, found.F, found.G, shift_rate)
    K = np.reshape(observer["K"], (N_Z, N_Y))
    return as_output_law(model, K, config.prediction_s, ObserverInput.from_parameters(observer))


def family(controller: str, nodes: Mapping[str, Mapping[str, Any]]) -> Family:
    """The family of one of `KEYS` about the parameters of inner loop and observer."""
    inner = nodes["inner_loop"]
    config = AttitudeConfig.from_parameters({**inner, "controller": "pid"})
    shape, make = _shape(controller, inner), _maker(config, controller, nodes["observer"])
    return Family(controller, lambda numbers: make(shape.parameters(numbers)), (shape.numbers(),))


def measure_of(controller: str, common: Yardstick) -> Yardstick:
    """What one of `KEYS` is measured by.

    PID and INDI: the nominal aircraft, and the one that flaps back; the PID with its own floor.
    """
    if controller in ("lqg", "lqr"):
        return common
    flaps_back, wanted = common.others[0], common.wanted
    if controller == "pid":
        flaps_back = replace(flaps_back, disk_margin=PID_FLOOR)
        wanted = wanted._replace(disk_margin=PID_FLOOR)
    return replace(common, others=(flaps_back,), wanted=wanted)


def chosen(
    controller: str,
    nodes: Mapping[str, Mapping[str, Any]],
    common: Yardstick,
    strides: Sequence[int] = STRIDES,
    pairs: bool = True,
) -> dict[str, NDArray[np.float64]]:
    """Parameters, flat, that the search chooses for one of `KEYS`, from the present ones on.

    Parameters
    ----------
    controller : str
    nodes : mapping
        Parameters of inner loop and observer as the laws of the controller's name fly them.
    common : Yardstick
        What all laws are measured by.
    strides, pairs
        As of `heli_math.grid_search.search`.

    Raises
    ------
    NoLawError
        No law of the family keeps the floors.
    """
    found = measure_of(controller, common).best(family(controller, nodes), strides, pairs)
    return _shape(controller, nodes["inner_loop"]).parameters(found)
