# SPDX-License-Identifier: Apache-2.0
"""Identified numbers beside the linearised truth: for checking the method in simulation only.

An entry is significant if its effect, |true entry| times the rms over the excited lines of the
state or input that it multiplies, is above 1 % of the largest such effect in its row. Targets: 5 %
for A, B and servos, 10 % for E, 5 % for the closed loop's norm.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from heli_flight.loop.settings import Settings
from heli_flight.studies.design.make import Basis, Design, aircraft_basis, design_of
from heli_flight.studies.identify.fit import Identification
from heli_identification.actuators import SIGNIFICANT_SHARE, effect_shares
from heli_identification.places import AIR, FAST, N_FAST
from heli_identification.response import FastModel
from heli_identification.spectra import spectra_of
from heli_inner_hinf.frequency import peak_gain
from heli_inner_hinf.loops import Loop, sampled_plant
from heli_math.rows import ACTUATOR
from heli_math.state_names import INPUT_NAMES, STATE_NAMES

TARGETS = {"A": 0.05, "B": 0.05, "E": 0.10, "": 0.05, "norm": 0.05}
WIND_NAMES = ("u", "v", "w")
_DYNAMIC = range(2, 8)
# -1 by definition: they give a_s, b_s and d_int their scale.
_FIXED = ("A(a_s,q)", "A(b_s,p)", "A(d_int,r)")
_COLUMNS = {"A": STATE_NAMES, "B": INPUT_NAMES, "E": WIND_NAMES}


@dataclass(frozen=True)
class Row:
    """One number of the table.

    Attributes
    ----------
    group : str
        "A", "B", "E", "norm" or "" for servos, delay, trim and collective.
    name : str
    value, sigma : float
        Identified, and its standard deviation (0: fixed by structure; nan: not estimated).
    truth : float
        nan where the aircraft file is not known.
    share : float
        Effect in its row over the row's largest; nan where that means nothing.
    target : float
        Largest allowed relative deviation of a significant number; nan: none.
    """

    group: str
    name: str
    value: float
    sigma: float
    truth: float
    share: float
    target: float

    @property
    def significant(self) -> bool:
        """Whether the number counts (1 % rule); what has no share always does."""
        return not self.share < SIGNIFICANT_SHARE

    @property
    def deviation(self) -> float:
        """(identified - truth) / |truth|; nan without truth."""
        if self.truth == 0.0:
            return 0.0 if self.value == 0.0 else float("inf")
        return (self.value - self.truth) / abs(self.truth)

    @property
    def deviation_text(self) -> str:
        """The deviation for people; empty without truth."""
        if np.isnan(self.truth):
            return ""
        if self.truth == 0.0:
            return "truth is 0"
        return f"{100.0 * self.deviation:+.1f} %"

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None if there is none to meet."""
        if not self.significant or np.isnan(self.target) or np.isnan(self.truth):
            return None
        return bool(abs(self.deviation) <= self.target)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "group": self.group, "name": self.name, "identified": self.value,
            "two_sigma": 2.0 * self.sigma, "truth": self.truth, "deviation": self.deviation,
            "share": self.share, "significant": self.significant, "target": self.target,
            "met": self.met,
        }  # fmt: skip


@dataclass(frozen=True)
class Truth:
    """The linearised aircraft and the design made from it with the same weights."""

    basis: Basis
    design: Design


def truth_of(settings: Settings, aircraft: str | None, gamma: float) -> Truth:
    """Trim, linearise and design the aircraft file: the yardstick, never an input."""
    basis = aircraft_basis(settings, aircraft)
    return Truth(basis, design_of(basis, settings, gamma=gamma))


def table(found: Identification, truth: Truth | None) -> list[Row]:
    """Every identified number beside the truth."""
    return [
        *_matrix_rows(found, truth),
        *_scalar_rows(found, truth),
        *(_norm_rows(found.design, truth) if truth is not None else ()),
    ]


def _matrix_rows(found: Identification, truth: Truth | None) -> list[Row]:
    ab, wind = found.ab, found.wind
    parts = (
        ("A", ab.A, ab.A_sigma, truth.basis.A if truth else None),
        ("B", ab.B, ab.B_sigma, truth.basis.B if truth else None),
        ("E", wind.E, wind.E_sigma, truth.basis.E if truth else None),
    )
    share = shares(found, truth)
    rows = []
    for group, matrix, sigma, true in parts:
        for i in _DYNAMIC:
            for j, column in enumerate(_COLUMNS[group]):
                name = f"{group}({STATE_NAMES[i]},{column})"
                known = float("nan") if true is None else float(true[i, j])
                if matrix[i, j] == 0.0 and (np.isnan(known) or abs(known) < 1e-9):
                    continue
                if name in _FIXED:
                    continue
                rows.append(
                    Row(group, name, float(matrix[i, j]), float(sigma[i, j]), known,
                        share.get(name, 0.0), TARGETS[group])
                )  # fmt: skip
    return rows


def fast_of(basis: Basis) -> FastModel:
    """A basis as the fits describe an aircraft (no kink, no collective)."""
    B, E = np.zeros((N_FAST, ACTUATOR.size)), np.zeros((N_FAST, AIR.size))
    B[:, ACTUATOR.attitude], E[:, AIR.velocity] = basis.B[FAST], basis.E[FAST]
    at = basis.actuation
    return FastModel(basis.A[FAST, FAST], B, E, at.servo_radps, at.servo_damping, at.delay_s)


def shares(found: Identification, truth: Truth | None) -> dict[str, float]:
    """Share of each entry in its row: of A and B in the first experiment, of E in the second.

    Of the true entries where they are known, so that neither an entry that was lost nor one that is
    nothing but error decides by itself whether it counts; else of the identified ones.
    """
    model = fast_of(truth.basis if truth is not None else found.design.basis)
    rows = [STATE_NAMES[i] for i in _DYNAMIC]
    result: dict[str, float] = {}
    for groups, experiment in ((("A", "B"), found.actuators), (("E",), found.gusts)):
        names = tuple(
            f"{group}({row},{column})"
            for group in groups
            for row in (rows if group != "E" else ("p", "q", "r"))
            for column in _COLUMNS[group]
            if column not in ("phi", "theta", "psi")
        )
        result |= effect_shares(model, spectra_of(experiment), names)
    return result


def _scalar_rows(found: Identification, truth: Truth | None) -> list[Row]:
    ab, trim, basis = found.ab, found.trim, truth.basis if truth else None
    nan = float("nan")
    actuation = basis.actuation if basis else None
    rows = [
        Row("", "servo frequency, rad/s", ab.servo_radps, ab.servo_radps_sigma,
            actuation.servo_radps if actuation else nan, nan, TARGETS[""]),
        Row("", "servo damping", ab.servo_damping, ab.servo_damping_sigma,
            actuation.servo_damping if actuation else nan, nan, TARGETS[""]),
        Row("", "delay, s", ab.delay_s, ab.delay_s_sigma,
            actuation.delay_s if actuation else nan, nan, nan),
        Row("", "K_col, rad", found.collective.K_col, found.collective.K_col_sigma,
            basis.outer["rotor.K_col"] if basis else nan, nan, nan),
    ]  # fmt: skip
    for i in (0, 1, 4, 5):
        true = float(basis.x_trim[i]) if basis else nan
        rows.append(
            Row("", f"trim {STATE_NAMES[i]}, rad", float(trim.x[i]), float(trim.x_sigma[i]), true,
                nan, nan)
        )  # fmt: skip
    for i, name in enumerate((*INPUT_NAMES, "d_col")):
        true = float(basis.u_trim[i]) if basis else nan
        rows.append(
            Row("", f"trim {name}", float(trim.u[i]), float(trim.u_sigma[i]), true, nan, nan)
        )
    return rows


def _norm_rows(design: Design, truth: Truth) -> list[Row]:
    """Norms wind -> h: design against design, and the identified law on the true aircraft."""
    nan = float("nan")
    rows = [
        Row("norm", f"norm, {mine.name}", mine.norm, nan, theirs.norm, nan, TARGETS["norm"])
        for mine, theirs in zip(design.reports, truth.design.reports, strict=True)
    ]
    flown = peak_gain(flown_on(design, truth.basis).wind_to_h)[0]
    return [
        *rows,
        Row("norm", "norm, identified law on the true aircraft, as flown", float(flown), nan,
            truth.design.reports[-1].norm, nan, TARGETS["norm"]),
    ]  # fmt: skip


def flown_on(design: Design, basis: Basis) -> Loop:
    """The design's loop as flown with the plant of another basis, judged by the same C and D."""
    model = replace(design.model, A=basis.A, B=basis.B, E=basis.E)
    return replace(design.loops[-1], plant=sampled_plant(model, basis.actuation))


def misses(rows: Sequence[Row]) -> list[Row]:
    """Significant numbers that miss their target."""
    return [row for row in rows if row.met is False]
