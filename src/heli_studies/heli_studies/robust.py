# SPDX-License-Identifier: Apache-2.0
"""How far every parameter of a set may be stretched before an aircraft of it is unstable."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_dynamics_sim.aircraft_file import AircraftError
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.trim import TrimError, trim
from heli_flight.loop.settings import Settings
from heli_flight.studies.robust.aircraft import AircraftSet, aircraft_set, with_values
from heli_flight.studies.robust.loop import (
    disks_at_input,
    disks_at_output,
    exact,
    feedback_flown,
    uncertain_loop,
    wind_to_h,
)
from heli_flight.studies.robust.parameter_table import AircraftRanges
from heli_flight.terminal import table
from heli_inner_hinf.as_flown import Feedback
from heli_inner_hinf.design import AttitudeConfig
from heli_math.state_names import ATTITUDE, MEASURED
from heli_parameters.parameters import ParameterError
from heli_robust.blocks import real
from heli_robust.certificate import Certificate, System, certify
from heli_robust.errors import RobustError
from heli_robust.uncertain import Range, Uncertain
from heli_robust.worst_case import Family, Onset
from heli_robust.worst_gain import WorstGain, worst_gain

FURTHEST = 3.0
"""Ranges are stretched up to this; there +-30 % is a tenth to nearly twice."""
FIVE_PERCENT = 0.05
BROKEN_AT = {
    "input": "at the input",
    "attitude": "at measured roll, pitch and heading",
    "output": "at all six outputs at once, the rates with them",
}
"""Where a disk margin is taken; all channels there at once."""
_ATTITUDE = tuple(MEASURED.index(i) for i in ATTITUDE)


@dataclass(frozen=True)
class Case:
    """What is proved at one delay.

    Attributes
    ----------
    delay_ticks : int
    onset : Onset
        The worst aircraft found; nothing smaller was found to be unstable.
    certificate : Certificate
        Up to 1 / level times the ranges no aircraft is unstable.
    largest_psi : float
        The second look at the proof; holds below 0.
    exact_onset : float
        Size at which the same aircraft is unstable with the loop sampled exactly; nan where that is
        more than 5 % away.
    flown_onset : float
        The same in the nonlinear simulation; nan also where it was not flown.
    """

    delay_ticks: int
    onset: Onset
    certificate: Certificate
    largest_psi: float
    exact_onset: float
    flown_onset: float = float("nan")

    @property
    def proved(self) -> float:
        """The robust stability margin is not below this."""
        return 1.0 / self.certificate.level


@dataclass(frozen=True)
class Proof:
    """All cases of a set, one a delay.

    Attributes
    ----------
    aircraft : AircraftSet
    law : Feedback
    cases : tuple of Case
    gain : WorstGain or None
        At the worst delay, over the set: horizontal wind (m/s) to h of eq. (11). None where the set
        is not proved stable.
    disks : mapping of str to WorstGain
        Inverse disk margins there, by `BROKEN_AT`; empty where the set is not proved stable.
    """

    aircraft: AircraftSet
    law: Feedback
    cases: tuple[Case, ...]
    gain: WorstGain | None = None
    disks: Mapping[str, WorstGain] = field(default_factory=dict)

    @property
    def worst(self) -> Case:
        """The delay at which least is proved."""
        return min(self.cases, key=lambda case: case.proved)


def prove(
    settings: Settings,
    asked: AircraftRanges,
    progress: Callable[[float], None] = lambda done: None,
    flown: bool = False,
) -> Proof:
    """Prove stability of the settings' attitude loop for every aircraft of the set.

    Parameters
    ----------
    settings : Settings
    asked : AircraftRanges
    progress : callable
        Told how many delays are done.
    flown : bool
        Whether the worst aircraft of each delay is flown, too.

    Raises
    ------
    ParameterError
        An aircraft of the ranges cannot hover, or the loop is unstable with the nominal one.
    """
    aircraft, law = set_of(settings, asked), feedback_flown(settings)
    cases = []
    for done, ticks in enumerate(asked.delays_ticks):
        case = _case(aircraft, law, ticks, asked.gap)
        if flown and case.onset.deltas:
            case = replace(case, flown_onset=_flown_onset(settings, aircraft, case))
        cases.append(case)
        progress(done + 1)
    return _with_gains(Proof(aircraft, law, tuple(cases)), settings, asked.gap)


def set_of(settings: Settings, asked: AircraftRanges) -> AircraftSet:
    """The settings' aircraft with every parameter in its range; raises as `prove`."""
    nominal = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    try:
        return aircraft_set(nominal, asked.ranges)
    except (AircraftError, TrimError) as error:
        raise ParameterError(
            f"robust: {_culprit(nominal, asked.ranges)}: an aircraft of the ranges cannot be "
            f"flown, no law can hold it: {error}"
        ) from None


def _culprit(nominal: HelicopterParameters, ranges: Sequence[Range]) -> str:
    """The first range with an end that alone no trim holds."""
    for r in ranges:
        for end in (r.low, r.high):
            try:
                trim(with_values(nominal, {r.name: end}))
            except (AircraftError, TrimError):
                return f"{r.name} {end:g}"
    return "several parameters together"


def onset_of(A: Uncertain, ticks: int) -> Onset:
    """The worst aircraft found of a loop's state matrix; raises as `prove`."""
    family = Family(A)
    growth = family.abscissa(np.zeros(len(family.names)))
    if growth >= 0.0:
        raise ParameterError(
            f"robust: the loop is unstable with the nominal aircraft and {ticks} ticks of delay "
            f"(a mode grows at {growth:.3g} 1/s), so there is nothing to prove; delay_ticks"
        )
    return family.onset(FURTHEST)


def _case(aircraft: AircraftSet, law: Feedback, ticks: int, gap: float) -> Case:
    A = uncertain_loop(aircraft, law, ticks)
    onset = onset_of(A, ticks)
    system = System(A.D, A.C, A.B, A.A)
    blocks = [real(name, A.channels.count(name)) for name in dict.fromkeys(A.channels)]
    try:
        proof = certify(system, blocks, (1.0 + gap) / min(onset.size, FURTHEST))
    except RobustError as error:
        raise ParameterError(f"robust: {ticks} ticks of delay: {error}") from None
    return Case(
        ticks, onset, proof, proof.largest_psi(system), exact_onset(aircraft, law, ticks, onset)
    )


def _with_gains(proof: Proof, settings: Settings, gap: float) -> Proof:
    """The worst gain and disk margin at the worst delay, if the whole set is proved stable."""
    ticks = proof.worst.delay_ticks
    if proof.worst.proved <= 1.0:
        return proof
    config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
    wind = wind_to_h(proof.aircraft, proof.law, ticks, config.C, config.D)
    loop = proof.aircraft, proof.law, ticks
    families = disks_at_input(*loop), disks_at_output(*loop, _ATTITUDE), disks_at_output(*loop)
    try:
        disks = [worst_gain(family, gap) for family in families]
        return replace(
            proof, gain=worst_gain(wind, gap), disks=dict(zip(BROKEN_AT, disks, strict=True))
        )
    except RobustError as error:
        raise ParameterError(f"robust: worst gain, {ticks} ticks of delay: {error}") from None


def exact_onset(aircraft: AircraftSet, law: Feedback, ticks: int, onset: Onset) -> float:
    """The size at which the loop, sampled exactly, is unstable along the same direction."""

    def growth(factor: float) -> float:
        return exact(aircraft, {k: factor * d for k, d in onset.deltas.items()}, law, ticks)

    return onset.size * _first_growth(growth, 1e-5) if onset.deltas else float("nan")


def _flown_onset(settings: Settings, aircraft: AircraftSet, case: Case) -> float:
    """The size at which the oscillation grows in the nonlinear simulation."""
    from heli_flight.studies.robust.fly import growth_in_flight

    def growth(factor: float) -> float:
        deltas = {k: factor * d for k, d in case.onset.deltas.items()}
        frequency = case.onset.frequency_radps
        try:
            return growth_in_flight(settings, aircraft, deltas, case.delay_ticks, frequency)
        except (AircraftError, TrimError) as error:
            raise ParameterError(f"robust: the worst aircraft cannot be flown: {error}") from None

    return case.onset.size * _first_growth(growth, 2e-3)


def _first_growth(growth: Callable[[float], float], within: float) -> float:
    """The factor, 5 % from one at most, at which a growth changes its sign; nan if nowhere."""
    stable, unstable = 1.0 - FIVE_PERCENT, 1.0 + FIVE_PERCENT
    if growth(stable) >= 0.0 or growth(unstable) < 0.0:
        return float("nan")
    while unstable - stable > within:
        middle = 0.5 * (stable + unstable)
        stable, unstable = (stable, middle) if growth(middle) >= 0.0 else (middle, unstable)
    return unstable


def as_dict(proof: Proof) -> dict[str, Any]:
    """For --json and result files."""
    return {
        "ranges": {r.name: [r.low, r.nominal, r.high] for r in proof.aircraft.ranges},
        "model_residual": proof.aircraft.residual,
        "robustly_stable": proof.worst.proved > 1.0,
        "cases": [
            {
                "delay_ticks": case.delay_ticks,
                "margin_proved": case.proved,
                "margin_at_most": _finite(case.onset.size),
                "frequency_radps": case.onset.frequency_radps,
                "exact_onset": _finite(case.exact_onset),
                "flown_onset": _finite(case.flown_onset),
                "pieces": len(case.certificate.pieces),
                "largest_psi": case.largest_psi,
                "worst_aircraft": proof.aircraft.values(case.onset.deltas),
            }
            for case in proof.cases
        ],
        "worst_delay_ticks": proof.worst.delay_ticks,
        "wind_to_h": _gain(proof, proof.gain),
        "inverse_disk_margin": {at: _gain(proof, proof.disks.get(at)) for at in BROKEN_AT},
    }


def _gain(proof: Proof, found: WorstGain | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "nominal": found.nominal,
        "found": found.lower,
        "proved": found.upper,
        "frequency_radps": found.frequency_radps,
        "aircraft": proof.aircraft.values(found.deltas),
    }


def print_proof(proof: Proof, out: Console) -> None:
    """The table of cases, the worst aircraft, and the verdict in one sentence."""
    rows = table("Robust stability margin, in ranges: 1 is the set itself", out)
    heads = (
        "delay, ticks",
        "proved",
        "at most",
        "gap, %",
        "rad/s",
        "exact loop",
        "flown",
        "pieces",
    )
    for head in heads:
        rows.add_column(head, justify="right")
    for case in proof.cases:
        size = case.onset.size
        rows.add_row(
            str(case.delay_ticks),
            f"{case.proved:.3f}",
            f"{size:.3f}" if np.isfinite(size) else f"> {FURTHEST:g}",
            f"{100.0 * (size / case.proved - 1.0):.1f}" if np.isfinite(size) else "-",
            f"{case.onset.frequency_radps:.2f}" if case.onset.deltas else "-",
            f"{case.exact_onset:.3f}" if np.isfinite(case.exact_onset) else "-",
            f"{case.flown_onset:.3f}" if np.isfinite(case.flown_onset) else "-",
            str(len(case.certificate.pieces)),
        )
    out.print(rows)
    worst = proof.worst
    box = table(f"Parameter box, and the aircraft at the onset ({worst.delay_ticks} ticks)", out)
    for head in ("parameter", "low", "nominal", "high", "onset"):
        box.add_column(head, justify="left" if head == "parameter" else "right")
    values: Mapping[str, float] = proof.aircraft.values(worst.onset.deltas)
    for r in proof.aircraft.ranges:
        at = f"{values[r.name]:.4g}" if r.name in worst.onset.deltas else "any"
        box.add_row(r.name, f"{r.low:g}", f"{r.nominal:g}", f"{r.high:g}", at)
    out.print(box)
    held = "is" if worst.proved > 1.0 else "is not proved to be"
    out.print(
        f"The loop {held} stable with every aircraft of the set: the least margin is "
        f"{worst.proved:.3f}, at {worst.delay_ticks} ticks of delay. The linear model is within "
        f"{100.0 * proof.aircraft.residual:.2f} % of aircraft that were not used for it.",
        soft_wrap=True,
    )
    if proof.gain:
        out.print(
            f"Over the set, at {worst.delay_ticks} ticks: the norm from horizontal wind to h is at "
            f"most {proof.gain.upper:.4f} (an aircraft has {proof.gain.lower:.4f}, the nominal one "
            f"{proof.gain.nominal:.4f}). Disk margins:",
            soft_wrap=True,
        )
    for at, disk in proof.disks.items():
        out.print(
            f"{BROKEN_AT[at]}: at least {1.0 / disk.upper:.3f} (an aircraft has "
            f"{1.0 / disk.lower:.3f}, the nominal one {1.0 / disk.nominal:.3f}).",
            soft_wrap=True,
        )


def draw(proof: Proof, path: Path) -> None:
    """The parameter box: ranges, what is proved, and the aircraft at the onset."""
    from heli_flight.report.plot_style import BLUE, GREEN, GREY, RED, picture

    ranges, worst = proof.aircraft.ranges, proof.worst
    with picture(path, 1, 1, (6.3, 3.4)) as (_, axes):
        ax = axes[0, 0]
        for row, r in enumerate(ranges):
            ax.plot([-1.0, 1.0], [row, row], color=GREY, lw=7, alpha=0.35, solid_capstyle="butt")
            ax.plot([-worst.proved, worst.proved], [row, row], color=GREEN, lw=2)
            if r.name in worst.onset.deltas:
                ax.plot(worst.onset.deltas[r.name], row, "D", color=RED, ms=5)
        ax.plot([], [], color=GREY, lw=7, alpha=0.35, label="the set")
        ax.plot([], [], color=GREEN, lw=2, label="proved stable")
        ax.plot([], [], "D", color=RED, ms=5, label="unstable aircraft")
        ax.axvline(0.0, color=BLUE, lw=0.7)
        ax.set_yticks(range(len(ranges)), [r.name.replace("_", " ") for r in ranges])
        ax.invert_yaxis()
        ax.set_xlabel(f"deviation, in ranges ({worst.delay_ticks} ticks of delay)")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=3)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
