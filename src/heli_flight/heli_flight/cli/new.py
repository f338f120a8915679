# SPDX-License-Identifier: Apache-2.0
"""The command `heli new aircraft`: an aircraft file from mass and rotor diameter."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.common import Json, aircraft

NEW_EPILOG = (
    "\b\nexample:\n  heli new aircraft --mass 5 --rotor-diameter 1.4 --out my_aircraft.yaml\n\n"
    "exit code: 0 written, 2 bad input (one line)"
)
_SHOWN = 12
new = typer.Typer(help="Begin something of your own.", no_args_is_help=True, rich_markup_mode=None)


class RuleName(StrEnum):
    """Rules of the rotor's speed, as the option has them."""

    MACH = "mach"
    FROUDE = "froude"


@new.command("aircraft", epilog=NEW_EPILOG)
def new_aircraft(
    mass: Annotated[float, typer.Option(metavar="KG", help="all that flies")],
    rotor_diameter: Annotated[float, typer.Option(metavar="M", help="of the main rotor")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="file to write")] = Path(
        "my_aircraft.yaml"
    ),
    like: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="aircraft that is scaled (default: the packaged one nearest in size)",
            autocompletion=aircraft,
        ),
    ] = None,
    rule: Annotated[
        RuleName,
        typer.Option(help="rotor speed: mach keeps the tip speed, froude gravity's share"),
    ] = RuleName.MACH,
    rotor_rpm: Annotated[
        float | None, typer.Option(metavar="RPM", help="rotor speed (default: by the rule)")
    ] = None,
    inertia: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="XX YY ZZ", help="about roll, pitch, yaw axis, kg m2"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Write an aircraft file from mass and rotor diameter, scaled from a packaged aircraft.

    Says what was assumed and which numbers matter most to a design: measure those first.
    """
    import math

    from heli_core.errors import ParameterCause
    from heli_core.folders import write_whole
    from heli_dynamics_sim import scaling
    from heli_dynamics_sim.aircraft import AircraftError
    from heli_flight.terminal import console, json_text

    if out.exists():
        raise AircraftError(
            "it exists; name another file with --out", ParameterCause.CONFLICT, where=str(out)
        )
    speed = None if rotor_rpm is None else rotor_rpm * 2.0 * math.pi / 60.0
    given = scaling.Given(mass, rotor_diameter, speed, inertia)
    made = scaling.new_aircraft(given, like, scaling.Rule(rule.value))
    ranked = scaling.sensitivities(made.parameters)
    write_whole(out, scaling.yaml_text(made, out.stem))
    keys = {entry.key: entry for entry in made.keys}
    if as_json:
        content = {
            "file": str(out),
            "scaled_from": made.source,
            "rule": made.rule.value,
            "length": made.length,
            "mass": made.mass,
            "time": made.time,
            "blade_loading": made.blade_loading,
            "tip_speed_mps": made.tip_speed_mps,
            "collective_rad": made.collective_rad,
            "tail_rad": made.tail_rad,
            "keys": {
                key: {"value": keys[key].value, "origin": keys[key].origin.name, "change": change}
                for key, change in ranked
            },
        }
        print(json_text(content), end="")
        return 0
    say = console()

    def line(text: str) -> None:
        say.print(text, highlight=False, markup=False, soft_wrap=True)

    rpm = made.parameters.main_speed_radps * 30.0 / math.pi
    line(
        f"scaled from {made.source}: length x {made.length:.3g}, mass x {made.mass:.3g}, "
        f"time x {made.time:.3g}"
    )
    line(
        f"rotor {rpm:.0f} rpm, tip speed {made.tip_speed_mps:.0f} m/s; hover at blade pitch "
        f"{math.degrees(made.collective_rad):.1f} deg, C_T/sigma {made.blade_loading:.3f} "
        f"(stall at {scaling.STALL_BLADE_LOADING:g})"
    )
    if made.blade_loading > scaling.HIGH_BLADE_LOADING:
        line("note: little thrust is left for gusts and climbs at this C_T/sigma")
    line("")
    line("Measure these first: what 10 % more changes of the linear model's rows, at most")
    for key, change in ranked[:_SHOWN]:
        entry = keys[key]
        line(f"  {key:<32} {entry.value:<10g} {entry.origin.name.lower():<7} {change:6.1%}")
    light = [key for key, change in ranked if change < 0.01]
    line(f"{len(light)} of {len(keys)} numbers change it by less than 1 %.")
    line(f"written: {out}")
    line(f"next: heli design --aircraft {out} --out my_design")
    return 0
