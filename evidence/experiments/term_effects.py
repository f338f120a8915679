# SPDX-License-Identifier: Apache-2.0
"""What each term of the aircraft does to trim and to A, B, E of the default aircraft; JSON.

Usage: ./heli python -m evidence.experiments.term_effects

Trim in four airs, entries of A, B, E that change, deviations from the published A, B, E with and
without the rotor's terms, and the tilt of the disc by air across it beside published ones.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from evidence.files import Results
from evidence.registry import produces, table
from evidence.tables import grid
from heli_core.rotations import euler_from_quat
from heli_core.rows import ACTUATOR, INPUT_NAMES, NINE, PLANT, STATE_NAMES, WIND_NAMES
from heli_dynamics_sim.aircraft import HelicopterParameters, ModelOptions
from heli_dynamics_sim.trim import LinearModel, TrimPoint, linearize, trim

DATA = Path(__file__).resolve().parents[2] / "tests/verification/data"
COLUMNS = {"A": STATE_NAMES, "B": INPUT_NAMES, "E": WIND_NAMES}
ROTOR = ("flap_back", "inflow", "ground_effect", "vortex_ring")
# Air (NED, m/s) and altitude (m) of the trims.
AIRS = {
    "still air": ((0.0, 0.0, 0.0), 1000.0),
    "5 m/s from ahead": ((-5.0, 0.0, 0.0), 1000.0),
    "5 m/s from the right": ((0.0, -5.0, 0.0), 1000.0),
    "air rising with 5 m/s": ((0.0, 0.0, -5.0), 1000.0),
    "still air, 1.2 m above the ground": ((0.0, 0.0, 0.0), 1.2),
}
CHANGED = 1e-4
"""Smallest change of an entry or of a trim value (deg, units of command) that is told."""


def with_terms(aircraft: HelicopterParameters, *names: str) -> HelicopterParameters:
    """The aircraft with these terms on."""
    return replace(aircraft, terms=ModelOptions()._replace(**dict.fromkeys(names, True)))


def trim_values(trim_point: TrimPoint) -> dict[str, float]:
    """Attitude and disc in deg, commands and gyro integrator as they are."""
    phi, theta, _ = euler_from_quat(trim_point.x[PLANT.quat])
    a_s, b_s, d_int = trim_point.x[PLANT.rotor]
    angles = dict(
        zip(("phi", "theta", "a_s", "b_s"), np.degrees((phi, theta, a_s, b_s)), strict=True)
    )
    commands = {
        "d_lat": trim_point.u[ACTUATOR.lat],
        "d_lon": trim_point.u[ACTUATOR.lon],
        "d_col": trim_point.u[ACTUATOR.col],
    }
    return {k: float(v) for k, v in {**angles, **commands, "d_int": d_int}.items()}


def trims(aircraft: HelicopterParameters, flown: HelicopterParameters) -> list[dict[str, Any]]:
    """Per air what the terms of `flown` change of the trim."""
    rows = []
    for name, (wind, altitude) in AIRS.items():
        before, after = (trim_values(trim(p, wind, altitude_m=altitude)) for p in (aircraft, flown))
        changed = {k: after[k] - before[k] for k in after if abs(after[k] - before[k]) > 1e-3}
        rows.append({"air": name, "changed": changed})
    return rows


def entries(before: LinearModel, after: LinearModel) -> list[dict[str, Any]]:
    """Entries of A, B, E that differ."""
    rows = []
    for name, columns in COLUMNS.items():
        old, new = getattr(before, name), getattr(after, name)
        for i, j in np.argwhere(np.abs(new - old) > CHANGED):
            entry = f"{name}({STATE_NAMES[i]}, {columns[j]})"
            rows.append({"entry": entry, "off": float(old[i, j]), "on": float(new[i, j])})
    return rows


def deviations(models: Mapping[str, LinearModel]) -> list[dict[str, Any]]:
    """Published entries and ours, where one of the models is off them or differs from the first."""
    published = yaml.safe_load((DATA / "nus_linear_model.yaml").read_text(encoding="utf-8"))
    rows = []
    for name, columns in COLUMNS.items():
        theirs = np.array(published[name], dtype=float)
        ours = {key: getattr(model, name) for key, model in models.items()}
        first = next(iter(ours.values()))
        moved = np.max([np.abs(value - first) for value in ours.values()], axis=0)
        for i, j in np.argwhere(moved > CHANGED):
            deviation = {key: float(value[i, j]) for key, value in ours.items()}
            entry = f"{name}({STATE_NAMES[i]}, {columns[j]})"
            rows.append({"entry": entry, "published": float(theirs[i, j]), **deviation})
    return rows


def tilts(aircraft: HelicopterParameters) -> dict[str, float]:
    """Settled tilt per air speed, rad per m/s, and the tip speed; couplings of the disc left out.

    The published derivatives, too, stand beside the couplings of the flapping, not behind them.
    """
    uncoupled = replace(aircraft, flap_a_bs_per_s=0.0, flap_b_as_per_s=0.0)
    model = linearize(uncoupled, trim(uncoupled))
    disc = [NINE.a_s, NINE.b_s]
    slope = np.linalg.solve(model.A[np.ix_(disc, disc)], model.E[disc, :2])
    named = dict(zip(("a_s_u", "a_s_v", "b_s_u", "b_s_v"), slope.ravel().tolist(), strict=True))
    return {**named, "tip_mps": aircraft.main_speed_radps * aircraft.main_radius_m}


def main() -> None:
    """Print the JSON."""
    default = HelicopterParameters.from_yaml("helion.yaml")
    off = linearize(default, trim(default))
    terms = []
    for name in ModelOptions._fields:
        flown = with_terms(default, name)
        model = linearize(flown, trim(flown))
        row = {"term": name, "trims": trims(default, flown), "entries": entries(off, model)}
        terms.append(row)
    models = {
        "off": off,
        "flap_back": linearize(*_trimmed(with_terms(default, "flap_back"))),
        "rotor": linearize(*_trimmed(with_terms(default, *ROTOR))),
    }
    published = yaml.safe_load((DATA / "published_tilts.yaml").read_text(encoding="utf-8"))
    discs = [
        {"aircraft": f"{name}, published", "bar": row.pop("bar"), **row}
        for name, row in published.items()
    ]
    for name in ("helion", "xcell60", "logo600"):
        aircraft = HelicopterParameters.from_yaml(f"{name}.yaml")
        for words, on in (("flap_back", ["flap_back"]), ("flap_back, inflow", ROTOR[:2])):
            tilt = tilts(with_terms(aircraft, *on))
            bar = aircraft.bar_gain > 0.0
            discs.append({"aircraft": f"{name}.yaml, {words}", "bar": bar, **tilt})
    print(json.dumps({"terms": terms, "deviations": deviations(models), "tilts": discs}))


def _trimmed(aircraft: HelicopterParameters) -> tuple[HelicopterParameters, TrimPoint]:
    return aircraft, trim(aircraft)


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "term_effects",
    "./heli python -m evidence.experiments.term_effects",
    "What each term of the aircraft does to trim, A, B, E and the tilt of the disc.",
)


_DEG = ("phi", "theta", "a_s", "b_s")


_NAMES = {"off": "all off", "flap_back": "flap_back", "rotor": "the rotor's four"}


_SLOPES = ("a_s_u", "b_s_v", "a_s_v", "b_s_u")


@table("term_effects")
def term_effects(results: Results) -> str:
    """Per term what changes of the trims and of A, B, E."""
    rows, without = [], []
    for record in results["term_effects"]["terms"]:
        trims = [
            f"{row['air']}: {', '.join(_change(*item) for item in row['changed'].items())}"
            for row in record["trims"]
            if row["changed"]
        ]
        entries = [f"{e['entry']} {e['off']:.4f} to {e['on']:.4f}" for e in record["entries"]]
        if not trims and not entries:
            without.append(f"`{record['term']}`")
            continue
        rows.append([f"`{record['term']}`", "; ".join(trims) or "-", "; ".join(entries) or "-"])
    head = ["term", "change of the trim", "A, B, E in hover, off to on"]
    silent = f" Neither changes with {', '.join(without)}." if without else ""
    return (
        f"{grid(head, rows)}\n\nDefault aircraft, one term at a time; changes below 0.001 (deg; "
        "units of command; rad of d_int) of the trim and 0.0001 of an entry are left out. States "
        "that a term adds are taken as settled in A, B, E; where a kink lies at hover, the entry "
        f"is the mean of its sides.{silent}"
    )


def _change(name: str, value: float) -> str:
    return f"{name} {value:+.3f}" + " deg" * (name in _DEG)


@table("term_deviations")
def term_deviations(results: Results) -> str:
    """Published entries beside the linear models with terms."""
    rows = [
        [row["entry"], f"{row['published']:.4f}", *(f"{row[key]:.4f}" for key in _NAMES)]
        for row in results["term_effects"]["deviations"]
    ]
    return (
        f"{grid(['entry', 'published', *_NAMES.values()], rows)}\n\nEntries that a term of the "
        "rotor moves by more than 0.0001; the published model has no column for what it lacks."
    )


@table("term_tilts")
def term_tilts(results: Results) -> str:
    """Settled tilt of the disc per air speed across it, beside published ones."""
    rows = [
        [
            row["aircraft"],
            "yes" if row["bar"] else "no",
            *(f"{1e3 * row[key]:+.2f}" if key in row else "-" for key in _SLOPES),
            f"{row['tip_mps']:.0f}",
        ]
        for row in results["term_effects"]["tilts"]
    ]
    head = ["rotor", "bar", "a_s by u", "b_s by v", "a_s by v", "b_s by u", "tip speed, m/s"]
    return (
        f"{grid(head, rows)}\n\nSettled, in hover, rad per 1000 m/s; a_s back, b_s to the right. "
        "The disc's own couplings are left out, as in the published derivatives; those of "
        "`helion.yaml`, identified and of one sign, double what the wake's skew (`inflow`) does."
    )


if __name__ == "__main__":
    main()
