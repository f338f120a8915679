# SPDX-License-Identifier: Apache-2.0
"""Mission task elements as tables: geometry, conditions, and the bounds of desired and adequate.

Source: ADS-33E-PRF, Handling Qualities Requirements for Military Rotorcraft (US Army AMCOM, 2000),
3.11; bounds are those for the good visual environment, of cargo/utility rotorcraft where categories
differ. MIL-DTL-32742 (2023) supersedes it; its figures are not in here. **The numbers are as
recalled from ADS-33E-PRF, whose text was not at hand; an independent list confirms those of hover,
vertical manoeuvre and pirouette (README).**

What the standard leaves to the test pilot's eye is a number of our own, said where it stands.
"""

from dataclasses import dataclass, replace
from enum import Enum

from heli_core.errors import HandlingCause, HandlingError

FT, KT = 0.3048, 1852.0 / 3600.0
"""A foot in metres, a knot in m/s."""
REFERENCE_ROTOR_M = 16.36
"""Main rotor diameter of a UH-60: the full size, of which Froude scaling takes the ratio."""


class Quantity(Enum):
    """Kind of a number; the value is its SI unit (angles: degrees)."""

    LENGTH = "m"
    TIME = "s"
    SPEED = "m/s"
    ANGLE = "deg"

    def factor(self, ratio: float) -> float:
        """What a number of this kind becomes at a length ratio: the Froude number stays."""
        if self is Quantity.LENGTH:
            return ratio
        return 1.0 if self is Quantity.ANGLE else float(ratio**0.5)


@dataclass(frozen=True)
class Criterion:
    """One line of a table of performance.

    Attributes
    ----------
    name : str
        Key for programs.
    text : str
        What is bounded.
    quantity : Quantity
    desired, adequate : float
        Largest magnitudes, SI and degrees.
    at_least : bool
        The bounds are the smallest values instead.
    """

    name: str
    text: str
    quantity: Quantity
    desired: float
    adequate: float
    at_least: bool = False


@dataclass(frozen=True)
class EntryCondition:
    """What has to be flown for the result to count, not how well: a range of a quantity."""

    name: str
    text: str
    quantity: Quantity
    low: float
    high: float


@dataclass(frozen=True)
class Manoeuvre:
    """A mission task element.

    Attributes
    ----------
    name : str
        As on the command line.
    title, paragraph : str
        In ADS-33E-PRF.
    geometry : dict
        Name to (Quantity, value): what the phases are found by.
    conditions : tuple of EntryCondition
    criteria : tuple of Criterion
    """

    name: str
    title: str
    paragraph: str
    geometry: dict[str, tuple[Quantity, float]]
    conditions: tuple[EntryCondition, ...]
    criteria: tuple[Criterion, ...]

    def __getitem__(self, name: str) -> float:
        """A number of the geometry."""
        return self.geometry[name][1]

    def bounds(self, name: str) -> Criterion:
        """The criterion of this name."""
        return next(c for c in self.criteria if c.name == name)


@dataclass(frozen=True)
class Scale:
    """Size for which a flight is scored: `full`, or `froude` with the ratio of rotor diameters."""

    name: str
    ratio: float


FULL_SCALE = Scale("full", 1.0)


def froude(rotor_diameter_m: float) -> Scale:
    """Scale of an aircraft: its rotor's diameter over `REFERENCE_ROTOR_M`.

    Lengths grow with the ratio, times and speeds with its root, angles stay, so that the Froude
    number V^2/(g L) does (Wolowicz, Bowman, Gilbert, NASA TP-1435, 1979; for manoeuvres of unmanned
    rotorcraft: Ivler, Geyer, VFS Forum 80, 2024).

    Raises
    ------
    HandlingError
        UNKNOWN for a diameter that is not between 0.05 and 50 m.
    """
    if not 0.05 <= rotor_diameter_m <= 50.0:
        raise HandlingError(
            HandlingCause.UNKNOWN,
            f"rotor diameter {rotor_diameter_m:g} m: allowed are 0.05 to 50 m",
        )
    return Scale("froude", rotor_diameter_m / REFERENCE_ROTOR_M)


_L, _T, _V, _A = Quantity.LENGTH, Quantity.TIME, Quantity.SPEED, Quantity.ANGLE

_STILL = {
    # Ours: the standard says "stabilized hover".
    "still_mps": (_V, 0.5),
    "still_for_s": (_T, 1.0),
}


def _position(desired_ft: float, adequate_ft: float) -> Criterion:
    text = "distance from the hover point, each horizontal axis"
    return Criterion("position", text, _L, desired_ft * FT, adequate_ft * FT)


def _altitude(desired_ft: float, adequate_ft: float) -> Criterion:
    return Criterion("altitude", "altitude kept within", _L, desired_ft * FT, adequate_ft * FT)


def _heading(desired_deg: float, adequate_deg: float) -> Criterion:
    return Criterion("heading", "heading kept within", _A, desired_deg, adequate_deg)


def _time(desired_s: float, adequate_s: float, text: str = "time to complete") -> Criterion:
    return Criterion("time", text, _T, desired_s, adequate_s)


HOVER = Manoeuvre(
    "hover",
    "Hover",
    "3.11.1",
    {"hold_s": (_T, 30.0), "approach_mps": (_V, 6.0 * KT), **_STILL},
    (
        EntryCondition("approach", "ground speed of the approach", _V, 6.0 * KT, 10.0 * KT),
        # "Approximately 45 deg"; the range is ours.
        EntryCondition("oblique", "track of the approach off the heading", _A, 35.0, 55.0),
    ),
    (
        _time(5.0, 8.0, "stabilised after the deceleration began"),
        _position(3.0, 6.0),
        _altitude(2.0, 4.0),
        _heading(5.0, 10.0),
    ),
)

VERTICAL = Manoeuvre(
    "vertical",
    "Vertical Maneuver",
    "3.11.6",
    {"ascent_m": (_L, 25.0 * FT), "begun_m": (_L, 1.0 * FT), "top_m": (_L, 3.0 * FT), **_STILL},
    (
        # "25 ft"; the range is ours.
        EntryCondition("ascent", "height gained", _L, 22.0 * FT, 31.0 * FT),
        EntryCondition("top", "time stabilised at the top", _T, 2.0, float("inf")),
    ),
    (
        _time(13.0, 18.0),
        _position(3.0, 6.0),
        Criterion("altitude", "final altitude off the first", _L, 3.0 * FT, 6.0 * FT),
        _heading(5.0, 10.0),
    ),
)

PIROUETTE = Manoeuvre(
    "pirouette",
    "Pirouette",
    "3.11.5",
    {"radius_m": (_L, 100.0 * FT), "arrival_m": (_L, 10.0 * FT), "hold_s": (_T, 5.0), **_STILL},
    (),
    (
        _time(45.0, 60.0, "time around the circle"),
        Criterion("capture", "stabilised after the return", _T, 5.0, 10.0),
        Criterion("radius", "distance off the circle", _L, 10.0 * FT, 15.0 * FT),
        _altitude(3.0, 10.0),
        Criterion("heading", "nose off the centre", _A, 10.0, 15.0),
    ),
)

DEPART_ABORT = Manoeuvre(
    "depart-abort",
    "Depart/Abort",
    "3.11.7",
    {"course_m": (_L, 800.0 * FT), "end_m": (_L, 20.0 * FT), **_STILL},
    (
        EntryCondition("peak", "largest ground speed", _V, 40.0 * KT, 50.0 * KT),
        EntryCondition("overshoot", "beyond the end point", _L, float("-inf"), 20.0 * FT),
    ),
    (
        _time(25.0, 30.0),
        Criterion("track", "distance off the course", _L, 10.0 * FT, 20.0 * FT),
        Criterion("height", "height above the ground", _L, 50.0 * FT, 75.0 * FT),
        Criterion("heading", "heading off the course", _A, 10.0, 15.0),
    ),
)

LATERAL_REPOSITION = Manoeuvre(
    "lateral-reposition",
    "Lateral Reposition",
    "3.11.8",
    {"course_m": (_L, 400.0 * FT), "end_m": (_L, 10.0 * FT), **_STILL},
    # "Approximately 35 kt"; the range is ours.
    (EntryCondition("peak", "largest ground speed", _V, 30.0 * KT, 40.0 * KT),),
    (
        _time(18.0, 22.0),
        Criterion("track", "distance off the course", _L, 10.0 * FT, 20.0 * FT),
        _altitude(10.0, 15.0),
        Criterion("heading", "heading off square to the course", _A, 10.0, 15.0),
    ),
)

SLALOM = Manoeuvre(
    "slalom",
    "Slalom",
    "3.11.9",
    {"gate_m": (_L, 50.0 * FT), "apart_m": (_L, 500.0 * FT)},
    # "At 500-ft intervals"; the range is ours.
    (EntryCondition("interval", "smallest distance between turns", _L, 400.0 * FT, 600.0 * FT),),
    (
        Criterion("speed", "ground speed", _V, 60.0 * KT, 40.0 * KT, at_least=True),
        Criterion("clearance", "turns off the centreline", _L, 50.0 * FT, 50.0 * FT, at_least=True),
        Criterion("error", "turns beyond the gates", _L, 50.0 * FT, 50.0 * FT),
        # The lesser of twice the rotor's diameter and 100 ft: the reference rotor's is longer.
        Criterion("height", "height above the ground", _L, 100.0 * FT, 100.0 * FT),
    ),
)

MANOEUVRES = {
    m.name: m for m in (HOVER, VERTICAL, PIROUETTE, SLALOM, LATERAL_REPOSITION, DEPART_ABORT)
}


def manoeuvre(name: str, scale: Scale = FULL_SCALE) -> Manoeuvre:
    """The table of a manoeuvre at a scale.

    Raises
    ------
    HandlingError
        UNKNOWN.
    """
    if name not in MANOEUVRES:
        raise HandlingError(
            HandlingCause.UNKNOWN, f"manoeuvre {name!r} is none of {', '.join(MANOEUVRES)}"
        )
    full, ratio = MANOEUVRES[name], scale.ratio
    return replace(
        full,
        geometry={k: (q, v * q.factor(ratio)) for k, (q, v) in full.geometry.items()},
        conditions=tuple(
            replace(c, low=c.low * c.quantity.factor(ratio), high=c.high * c.quantity.factor(ratio))
            for c in full.conditions
        ),
        criteria=tuple(
            replace(
                c,
                desired=c.desired * c.quantity.factor(ratio),
                adequate=c.adequate * c.quantity.factor(ratio),
            )
            for c in full.criteria
        ),
    )
