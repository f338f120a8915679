# SPDX-License-Identifier: Apache-2.0
"""A new aircraft from few numbers: a packaged one scaled by dynamic similarity.

Lengths go with the ratio of the rotors' radii; times with the ratio of their turns. Main-rotor
speed follows one of two rules unless it is given:

- Mach: the tip speed stays, so speeds stay and times go with the length. Small helicopters are
  built so: the packaged ones have tips of 124 to 137 m/s at radii of 0.7 to 0.8 m.
- Froude: gravity over acceleration stays, so times go with the root of the length.

Mettler, *Identification Modeling and Characteristics of Miniature Rotorcraft* (Kluwer 2003),
compares both over sizes; Wolowicz, Bowman, Gilbert, *Similitude requirements and scaling
relationships as applied to model testing*, NASA TP-1435 (1979), has the rules.

The mass is given, so the body's density may change. What is aerodynamic or belongs to the rotor
keeps its own density; body, gear and engine go with the mass; the yaw gyro's gains keep the yaw
loop. Servos are bought and stay. Blade pitch and tail pitch at hover are solved by trim.
"""

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, replace
from typing import Any

import numpy as np

from heli_core.errors import ParameterCause
from heli_core.rows import ACTUATOR, PLANT
from heli_dynamics_sim.aircraft import (
    AircraftError,
    HelicopterParameters,
    config_folders,
    file_fields,
)
from heli_dynamics_sim.trim import linearize, trim

STALL_BLADE_LOADING = 0.14
"""Largest C_T/sigma: steady stall of a rotor in hover; Leishman, *Principles of Helicopter
Aerodynamics*, 2nd ed. (2006), ch. 5: about 0.12 to 0.14."""
HIGH_BLADE_LOADING = 0.11
"""Above it little thrust is left for manoeuvres and gusts."""


class Rule(enum.Enum):
    """What the main rotor's speed follows."""

    MACH = "mach"
    FROUDE = "froude"


class Origin(enum.Enum):
    """Where a value of the new file comes from."""

    YOURS = "Y"
    SCALED = "S"
    KEPT = "K"
    SOLVED = "T"

    @property
    def meaning(self) -> str:
        """For the file's head."""
        return {
            Origin.YOURS: "yours",
            Origin.SCALED: "scaled; the factor stands beside it",
            Origin.KEPT: "kept",
            Origin.SOLVED: "solved by the trim of a hover in still air",
        }[self]


@dataclass(frozen=True)
class Given:
    """What is known of the new aircraft; None: to be scaled.

    Attributes
    ----------
    mass_kg : float
    rotor_diameter_m : float
    rotor_speed_radps : float, optional
    inertia_kgm2 : sequence of 3 floats, optional
        Roll, pitch, yaw.
    """

    mass_kg: float
    rotor_diameter_m: float
    rotor_speed_radps: float | None = None
    inertia_kgm2: Sequence[float] | None = None


@dataclass(frozen=True)
class Key:
    """A value of the new file.

    Attributes
    ----------
    key : str
        `group.key`
    value : float or str
    origin : Origin
    factor : float
        Value over that of the source; 1 for a word.
    """

    key: str
    value: float | str
    origin: Origin
    factor: float


@dataclass(frozen=True)
class NewAircraft:
    """An aircraft that was scaled.

    Attributes
    ----------
    parameters : HelicopterParameters
    source : str
        Packaged aircraft that it was scaled from.
    rule : Rule
    keys : tuple of Key
        In the order of the file.
    length, mass, time : float
        Ratios, new over source.
    blade_loading : float
        C_T/sigma of hover.
    tip_speed_mps : float
    collective_rad, tail_rad : float
        Blade pitch of main and tail rotor in hover.
    """

    parameters: HelicopterParameters
    source: str
    rule: Rule
    keys: tuple[Key, ...]
    length: float
    mass: float
    time: float
    blade_loading: float
    tip_speed_mps: float
    collective_rad: float
    tail_rad: float


def packaged_names() -> list[str]:
    """Aircraft that can be scaled."""
    return sorted({f.stem for folder in config_folders() for f in folder.glob("aircraft/*.yaml")})


def nearest(given: Given) -> str:
    """The packaged aircraft nearest in size: distance in log radius and a third of log mass."""

    def distance(name: str) -> float:
        source = HelicopterParameters.from_yaml(name)
        length = 0.5 * given.rotor_diameter_m / source.main_radius_m
        return math.hypot(math.log(length), math.log(given.mass_kg / source.mass_kg) / 3.0)

    return min(packaged_names(), key=distance)


def blade_loading(aircraft: HelicopterParameters) -> float:
    """C_T/sigma = m g / (rho b c R (Omega R)^2) of a hover."""
    a = aircraft
    tip_mps = a.main_speed_radps * a.main_radius_m
    area = a.main_blades * a.main_chord_m * a.main_radius_m
    return a.mass_kg * a.gravity_mps2 / (a.air_density_kgpm3 * area * tip_mps**2)


def new_aircraft(given: Given, source: str | None = None, rule: Rule = Rule.MACH) -> NewAircraft:
    """Scale a packaged aircraft to the numbers that are known.

    Parameters
    ----------
    given : Given
    source : str, optional
        A packaged aircraft, or a file; default: the nearest packaged one.
    rule : Rule
        Of the rotor's speed, where that is not given.

    Returns
    -------
    NewAircraft

    Raises
    ------
    AircraftError
        A number is out of bounds, the inertia is no rigid body's or one of a larger body, or the
        rotor cannot carry the mass.
    TrimError
        The aircraft cannot hover.
    """
    _check(given)
    source = source or nearest(given)
    base = HelicopterParameters.from_yaml(source)
    length = 0.5 * given.rotor_diameter_m / base.main_radius_m
    mass = given.mass_kg / base.mass_kg
    time = length if rule is Rule.MACH else math.sqrt(length)
    if given.rotor_speed_radps is not None:
        time = base.main_speed_radps / given.rotor_speed_radps
    density = mass / length**3
    factors = {item.name: _factor(item, length, mass, time, density) for item in file_fields(base)}
    yours = {"mass_kg", "main_radius_m"}
    values = {
        name: getattr(base, name) * factor
        for name, factor in factors.items()
        if isinstance(getattr(base, name), float)
    }
    values["mass_kg"], values["main_radius_m"] = given.mass_kg, 0.5 * given.rotor_diameter_m
    if given.rotor_speed_radps is not None:
        values["main_speed_radps"] = given.rotor_speed_radps
        yours.add("main_speed_radps")
    if given.inertia_kgm2 is not None:
        names = ("inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2")
        values.update(zip(names, given.inertia_kgm2, strict=True))
        yours.update(names)
    scaled = _with(base, {name: _rounded(value) for name, value in values.items()})
    _check_body(scaled)
    loading = blade_loading(scaled)
    if loading > STALL_BLADE_LOADING:
        raise AircraftError(
            f"the blades would stall: C_T/sigma is {loading:.3g} in hover; more rotor speed, a "
            "larger diameter or less mass",
            ParameterCause.CONFLICT,
            key="main_rotor.speed_radps",
            value=scaled.main_speed_radps,
            allowed=f"C_T/sigma below {STALL_BLADE_LOADING:g}",
        )
    scaled = _hovering_as(base, scaled)
    pitch = _pitch(scaled)
    solved = {"collective_offset_rad", "pedal_offset_rad"}
    keys = []
    for item in file_fields(base):
        value, of_base = getattr(scaled, item.name), getattr(base, item.name)
        factor = value / of_base if isinstance(value, float) and of_base else 1.0
        origin = Origin.KEPT if factor == 1.0 else Origin.SCALED
        if item.name in yours | solved:
            origin = Origin.YOURS if item.name in yours else Origin.SOLVED
        keys.append(Key(item.metadata["key"], value, origin, factor))
    tip_mps = scaled.main_speed_radps * scaled.main_radius_m
    return NewAircraft(
        scaled, source, rule, tuple(keys), length, mass, time, loading, tip_mps, *pitch
    )


def _with(aircraft: HelicopterParameters, numbers: Mapping[str, Any]) -> HelicopterParameters:
    return replace(aircraft, **numbers)


def _check(given: Given) -> None:
    numbers = {"mass": given.mass_kg, "rotor diameter": given.rotor_diameter_m}
    if given.rotor_speed_radps is not None:
        numbers["rotor speed"] = given.rotor_speed_radps
    for place, value in enumerate(given.inertia_kgm2 or ()):
        numbers[f"inertia about {'xyz'[place]}"] = value
    for key, value in numbers.items():
        if not (math.isfinite(value) and value > 0.0):
            raise AircraftError(
                f"{value:g} is not allowed",
                ParameterCause.BOUNDS,
                key=key,
                value=value,
                allowed="a finite number above 0",
            )


def _check_body(aircraft: HelicopterParameters) -> None:
    """Refuse inertias of a body that reaches beyond tail and rotor."""
    reach_m = max(aircraft.tail_arm_m + aircraft.tail_radius_m, aircraft.main_radius_m)
    for axis in ("xx", "yy", "zz"):
        value = getattr(aircraft, f"inertia_{axis}_kgm2")
        if value > aircraft.mass_kg * reach_m**2:
            raise AircraftError(
                f"{value:g} kg m2 is not allowed: {aircraft.mass_kg:g} kg within {reach_m:.2f} m "
                "of the centre of gravity have less",
                ParameterCause.CONFLICT,
                key=f"body.inertia_{axis}_kgm2",
                value=value,
                allowed=f"below {aircraft.mass_kg * reach_m**2:.3g} kg m2",
            )


_KEPT = ("environment", "servo", "fins")
_SPECIAL = {
    "yaw_gyro.pedal_gain_radps", "engine.time_constant_s", "engine.fuel_per_energy_kgpj",
    "landing_gear.hard_impact_mps",
}  # fmt: skip
"""Kept, whatever their units: what a pilot is used to, what burns, what breaks."""


def _factor(item: Field[Any], length: float, mass: float, time: float, density: float) -> float:
    """A value of the new aircraft over that of its source."""
    key, unit = item.metadata["key"], item.metadata.get("unit", "1")
    group = key.partition(".")[0]
    if group in _KEPT or key in _SPECIAL:
        return 1.0
    if group == "yaw_gyro":  # N_ped goes with 1/(density time^2): the loop N_ped K stays the same
        return density * (time if key.endswith("proportional_s") else 1.0)
    if key == "engine.power_w":  # momentum theory: T^(3/2) / R
        return mass**1.5 / length
    if key == "landing_gear.stiffness_npm":  # sinks in by the same share of its size
        return mass / length
    if key == "landing_gear.damping_nspm":  # the same share of critical damping
        return mass / math.sqrt(length)
    heavy = mass if group == "body" or key == "engine.fuel_kg" else length**3
    return _of_unit(unit, heavy, length, time)


def _of_unit(unit: str, mass: float, length: float, time: float) -> float:
    """Ratio of a quantity of this unit: `N m/rad`, `rad s/m`, `kg m2`."""
    base = {
        "kg": mass,
        "m": length,
        "s": time,
        "rad": 1.0,
        "1": 1.0,
        "-": 1.0,
        "N": mass * length / time**2,
        "W": mass * length**2 / time**3,
        "J": mass * length**2 / time**2,
    }
    over, _, under = unit.partition("/")

    def product(words: str) -> float:
        total = 1.0
        for word in words.split():
            name = word.rstrip("0123456789") or word
            total *= base[name] ** int(word[len(name) :] or 1)
        return total

    return product(over) / (product(under) if under else 1.0)


def _rounded(value: float) -> float:
    """Five digits, as a file shows them."""
    return float(f"{value:.5g}")


def _pitch(aircraft: HelicopterParameters) -> tuple[float, float]:
    """Blade pitch of main and tail rotor in a hover in still air, rad; raises TrimError."""
    point = trim(aircraft)
    main = aircraft.collective_offset_rad + aircraft.collective_gain_rad * point.u[ACTUATOR.col]
    tail = aircraft.pedal_offset_rad + aircraft.pedal_gain * _gyro_output(aircraft, point.x)
    return float(main), float(tail)


def _gyro_output(aircraft: HelicopterParameters, x: np.ndarray) -> float:
    """Output of the yaw gyro at rest: that of its integrator."""
    return float(aircraft.gyro_integral * x[PLANT.d_int])


def _hovering_as(base: HelicopterParameters, scaled: HelicopterParameters) -> HelicopterParameters:
    """With the pitch offsets at which sticks and gyro rest in hover where the source's do."""
    rest = trim(base)
    # Far from its source a rotor may need more pitch than the old offset leaves to the stick.
    for _ in range(2):
        guess = _within_reach(scaled)
        main, tail = _pitch(guess)
        scaled = replace(
            scaled,
            collective_offset_rad=_rounded(
                main - scaled.collective_gain_rad * rest.u[ACTUATOR.col]
            ),
            pedal_offset_rad=_rounded(tail - scaled.pedal_gain * _gyro_output(base, rest.x)),
        )
    return scaled


def _within_reach(aircraft: HelicopterParameters) -> HelicopterParameters:
    """The offset for the pitch of blade-element and momentum theory: a trim finds it from there.

    theta_0 = 6 C_T/(sigma a) + 3/2 lambda_h; Leishman, eq. (3.75).
    """
    loading = blade_loading(aircraft)
    solidity = aircraft.main_blades * aircraft.main_chord_m / (math.pi * aircraft.main_radius_m)
    inflow = math.sqrt(0.5 * loading * solidity)
    pitch = 6.0 * loading / aircraft.main_lift_slope + 1.5 * inflow
    return replace(aircraft, collective_offset_rad=_rounded(pitch))


def sensitivities(aircraft: HelicopterParameters, share: float = 0.1) -> list[tuple[str, float]]:
    """Which keys matter to the design: by how much the linear model changes with each.

    Parameters
    ----------
    aircraft : HelicopterParameters
    share : float
        Change of each number in turn.

    Returns
    -------
    list of (key, change)
        Largest first. change: of the rows of [A B], each over its norm, the one that changes most.
    """

    def rows(one: HelicopterParameters) -> np.ndarray:
        model = linearize(one, trim(one))
        return np.hstack([model.A, model.B])

    nominal = rows(aircraft)
    size = np.linalg.norm(nominal, axis=1)
    found = []
    for item in file_fields(aircraft):
        value = getattr(aircraft, item.name)
        if item.metadata["key"].startswith("environment.") or not isinstance(value, float):
            continue
        try:
            changed = rows(_with(aircraft, {item.name: value * (1.0 + share)}))
        except AircraftError:  # at the end of what is allowed: the other way
            changed = rows(_with(aircraft, {item.name: value * (1.0 - share)}))
        change = np.linalg.norm(changed - nominal, axis=1) / np.where(size > 0.0, size, 1.0)
        found.append((item.metadata["key"], float(change.max())))
    return sorted(found, key=lambda pair: -pair[1])


def yaml_text(made: NewAircraft, title: str) -> str:
    """The aircraft file, each line with symbol, unit, meaning and where it comes from."""
    factors = f"length {made.length:.4g}, mass {made.mass:.4g}, time {made.time:.4g}"
    lines = [
        "# SPDX-License-Identifier: Apache-2.0",
        f"# {title}: {made.source} scaled by `heli new aircraft`. SI units, rad.",
        "#",
        f"# New over {made.source}: {factors} ({made.rule.value} rule).",
        "# Each line: value  # symbol [unit] meaning; where from:",
        *(f"#   [{origin.value}]  {origin.meaning}." for origin in Origin),
    ]
    group = ""
    by_key = {item.metadata["key"]: item.metadata for item in file_fields(made.parameters)}
    for entry in sorted(made.keys, key=_group):
        here, _, name = entry.key.partition(".")
        if here != group:
            lines += ["", f"{here}:"]
            group = here
        rule = by_key[entry.key]
        value = entry.value if isinstance(entry.value, str) else _text(entry.value)
        beside = f", times {entry.factor:.4g}" if entry.origin is Origin.SCALED else ""
        symbol = f"{rule['symbol']} [{rule['unit']}] " if "symbol" in rule else ""
        lines.append(
            f"  {name}: {value}  # {symbol}{rule['meaning']}; [{entry.origin.value}]{beside}"
        )
    return "\n".join(lines) + "\n"


_GROUPS = (
    "body", "environment", "main_rotor", "flapping", "stabiliser_bar", "tail_rotor", "fuselage",
    "horizontal_fin", "vertical_fin", "fins", "yaw_gyro", "engine", "governor", "servo",
    "landing_gear",
)  # fmt: skip


def _group(entry: Key) -> int:
    return _GROUPS.index(entry.key.partition(".")[0])


def _text(value: float) -> str:
    """A number that YAML reads as one: 1.0e-05 has a point."""
    text = f"{value:.5g}"
    mantissa, e, exponent = text.partition("e")
    mantissa = mantissa if "." in mantissa else f"{mantissa}.0"
    return f"{mantissa}{e}{exponent}"
