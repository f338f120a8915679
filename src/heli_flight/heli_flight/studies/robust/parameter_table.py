# SPDX-License-Identifier: Apache-2.0
"""The set of aircraft of `heli robust`; values stand in config/robust.yaml."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from heli_flight.studies.robust.aircraft import SCALED
from heli_parameters.locate import config_folder
from heli_parameters.parameters import Parameter, ParameterError, load
from heli_robust.errors import RobustError
from heli_robust.uncertain import Range

NODE_NAME = "robust"
_DELAY, _GAP = "delay_ticks", "gap"
_MOST_TICKS = 10


def _row(name: str, unit: str, upper: float) -> Parameter:
    of = f"{SCALED[name]}, as a factor" if name in SCALED else "the rotor's flap-back"
    return Parameter(
        name, "double[]", f"Low, nominal and high {of}", unit, lower=0.0, upper=upper, shape=(3,)
    )


TABLE: tuple[Parameter, ...] = (
    *(_row(name, "1", 4.0) for name in SCALED),
    _row("flap_back", "rad s/m", 0.1),
    Parameter(
        _DELAY, "double[]", "Fewest and most ticks of transport delay", "ticks",
        lower=0, upper=_MOST_TICKS, shape=(2,),
    ),
    Parameter(
        _GAP, "double", "How far the proof may stay behind the worst aircraft found", "1",
        lower=0.001, upper=1.0,
    ),
)  # fmt: skip


class AircraftRanges(NamedTuple):
    """Ranges of the parameters, delays (ticks) one by one, and the gap of the proof."""

    ranges: tuple[Range, ...]
    delays_ticks: tuple[int, ...]
    gap: float


def read_ranges(params: Sequence[Path]) -> AircraftRanges:
    """The packaged set under the user's files; sections of other nodes are passed over.

    Raises
    ------
    ParameterError
        Also for a range that is upside down or does not include its nominal value.
    """
    values = load(TABLE, [config_folder("heli_flight") / "robust.yaml", *params], NODE_NAME)
    ranges = []
    for name in [*SCALED, "flap_back"]:
        low, nominal, high = (float(value) for value in values[name])
        try:
            ranges.append(Range(name, nominal, low, high))
        except RobustError as error:
            raise ParameterError(f"{NODE_NAME}: {error}") from None
    fewest, most = (float(value) for value in values[_DELAY])
    if fewest > most or not (fewest.is_integer() and most.is_integer()):
        raise ParameterError(
            f"{NODE_NAME}: {_DELAY}: {fewest:g} .. {most:g} is not allowed; allowed: whole "
            "numbers, the fewest first"
        )
    return AircraftRanges(
        tuple(ranges), tuple(range(int(fewest), int(most) + 1)), float(values[_GAP])
    )
