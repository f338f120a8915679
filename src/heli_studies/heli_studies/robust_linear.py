# SPDX-License-Identifier: Apache-2.0
"""`heli robust` of a linear aircraft: margins of the attitude loop as flown, and a box of entries.

Masses, inertias and rotor do not stand in A and B, so nothing is proved as for an aircraft file.
What is known instead: the margins with the published A, B and delay, and whether the loop stays
stable when the file's own entries, each by itself, are up to 30 % off. The box is sampled at some
of its corners and inside: an unstable aircraft that is found is one, none found proves nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from heli_core.foreign_files import read_yaml
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import AircraftError
from heli_dynamics_sim.linear_aircraft import (
    PARAMETER,
    DerivativeEntry,
    LinearAircraft,
    attitude_entries,
    find_linear,
    with_entries,
)
from heli_flight.settings import Settings
from heli_flight.terminal import table
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import (
    ChannelMargin,
    Loop,
    OutputFeedback,
    channel_margins,
    closed_loop,
    disk_margin,
    further_delay_s,
    sampled_plant,
)
from heli_inner_hinf.mu import DiskMargin
from heli_inner_hinf.tuning import model_of
from heli_studies.compare import loop_as_flown
from heli_studies.design.linear import flown_actuation
from heli_studies.design.make import LONGEST_DELAY_S
from heli_studies.published import LAWS, settings_of
from heli_studies.robust import BROKEN_AT, feedback_flown

SIZE = 0.3
"""Each entry is so much off at most, relative."""
SAMPLES = 500
"""Aircraft of corners, and as many of the inside."""
_SEED = 1
_CHANNELS = ("d_lat", "d_lon", "d_ped")


class CertificateCause(Enum):
    """Why the certificate of `heli robust` does not apply."""

    LINEAR_PLANT = (
        "it is over masses, inertias and rotor of an aircraft file, which are not in A, B"
    )


@dataclass(frozen=True)
class BoxSample:
    """Aircraft of a box that were tried.

    Attributes
    ----------
    tried, unstable : int
        Aircraft, and those with which the loop is not stable.
    refused : int
        Those that are no helicopter about hover, and were not tried.
    growth_per_s : float
        The largest of the loop's modes, of all that were tried; below 0 it is stable.
    worst : mapping of DerivativeEntry to float
        Factors of the entries that give it.
    """

    tried: int
    unstable: int
    refused: int
    growth_per_s: float
    worst: Mapping[DerivativeEntry, float]


@dataclass(frozen=True)
class LinearRobustness:
    """What is known of a controller on a linear aircraft.

    Attributes
    ----------
    aircraft : str
        Packaged name, or file.
    law : str
    size : float
        Each entry is so much off at most, relative.
    delay_s : float
        From a command to the aircraft: the plant's and the file's.
    growth_per_s : float
        Of the loop with the published numbers.
    disks : mapping of str to DiskMargin
        Where the loop is broken to its margin, all channels at once.
    channels : sequence of ChannelMargin
        Of d_lat, d_lon, d_ped, the others closed.
    further_delay_s : float
        In all channels at once, up to which it is stable; at most `LONGEST_DELAY_S` is tried.
    entries : mapping of DerivativeEntry to float
        That are varied.
    corners, inside : BoxSample
    """

    aircraft: str
    law: str
    size: float
    delay_s: float
    growth_per_s: float
    disks: Mapping[str, DiskMargin]
    channels: list[ChannelMargin]
    further_delay_s: float
    entries: Mapping[DerivativeEntry, float]
    corners: BoxSample
    inside: BoxSample

    @property
    def stable(self) -> bool:
        """Whether no aircraft that was tried is unstable."""
        return self.growth_per_s < 0.0 and not self.corners.unstable + self.inside.unstable


def growth(aircraft: LinearAircraft, law: OutputFeedback, actuation: Actuation) -> float:
    """Largest growth, 1/s, of the attitude loop as flown, discretised exactly."""
    A, B, _, _ = aircraft.nine()
    poles = np.linalg.eigvals(closed_loop(A, B, law, actuation))
    return float(np.log(np.max(np.abs(poles))) / TICK_S)


def judged(settings: Settings, samples: int = SAMPLES, size: float = SIZE) -> LinearRobustness:
    """Margins and box of the attitude controller of settings whose plant is a linear aircraft.

    Parameters
    ----------
    settings : Settings
    samples : int
        Aircraft of corners, and as many of the inside.
    size : float
        Each entry is so much off at most, relative.

    Raises
    ------
    ParameterError
        The controller's linear form is not known.
    AircraftError
    """
    plant = settings.nodes["plant"]
    name = str(plant[PARAMETER])
    aircraft, tree = LinearAircraft.from_yaml(name), read_yaml(find_linear(name))
    actuation = flown_actuation(aircraft, int(plant["delay_ticks"]))
    config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
    loop = loop_as_flown(settings.nodes, actuation)
    if loop is None:
        raise ParameterError(
            f"heli robust: the linear form of {config.controller} is not known; allowed: hinf, "
            "hinf_output, lqr, pid, lqg"
        )
    # The controller may be designed for another aircraft: what is judged is the loop that flies.
    A, B, E, _ = aircraft.nine()
    model = replace(model_of(config), A=A, B=B, E=E)
    loop = replace(loop, plant=sampled_plant(model, actuation))
    law, entries = feedback_flown(settings), attitude_entries(tree)
    draw = np.random.default_rng(_SEED)
    corners = draw.choice([1.0 - size, 1.0 + size], (samples, len(entries)))
    inside = draw.uniform(1.0 - size, 1.0 + size, (samples, len(entries)))
    return LinearRobustness(
        aircraft=name,
        law=config.controller,
        size=size,
        delay_s=actuation.delay_s,
        growth_per_s=growth(aircraft, law, actuation),
        disks={at: disk_margin(loop, at) for at in BROKEN_AT},
        channels=_channels(loop),
        further_delay_s=further_delay_s(loop, model, actuation, LONGEST_DELAY_S),
        entries=entries,
        corners=_sampled(tree, entries, corners, law, actuation),
        inside=_sampled(tree, entries, inside, law, actuation),
    )


def _channels(loop: Loop) -> list[ChannelMargin]:
    """Of a loop that is not stable there are none."""
    return channel_margins(loop) if loop.stability() < 0.0 else []


def _sampled(
    tree: Any,
    entries: Mapping[DerivativeEntry, float],
    factors: NDArray[np.float64],
    law: OutputFeedback,
    actuation: Actuation,
) -> BoxSample:
    """Factors (N, n) of the entries, one aircraft after another."""
    growths = np.full(len(factors), np.nan)
    for i, row in enumerate(factors):
        values = {place: f * entries[place] for place, f in zip(entries, row.tolist(), strict=True)}
        try:
            growths[i] = growth(with_entries(tree, values), law, actuation)
        except AircraftError:
            continue
    tried = np.isfinite(growths)
    if not tried.any():
        return BoxSample(0, 0, len(factors), float("nan"), {})
    worst = int(np.nanargmax(growths))
    return BoxSample(
        int(tried.sum()),
        int((growths[tried] >= 0.0).sum()),
        int((~tried).sum()),
        float(growths[worst]),
        dict(zip(entries, factors[worst].tolist(), strict=True)),
    )


def robustness_of(names: list[str]) -> list[LinearRobustness]:
    """Of each packaged aircraft with the controllers that are designed for it."""
    return [judged(settings_of(name, law, "paper")) for name in names for law in LAWS]


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------


def as_dict(found: LinearRobustness) -> dict[str, Any]:
    """For --json and result files; what is not finite is None."""
    return {
        "aircraft": found.aircraft,
        "law": found.law,
        "delay_s": found.delay_s,
        "growth_per_s": found.growth_per_s,
        "disk": {
            at: {
                "alpha": disk.alpha,
                "frequency_radps": disk.frequency,
                "gain_db": _finite(disk.gain_db),
                "phase_deg": disk.phase_deg,
            }
            for at, disk in found.disks.items()
        },
        "channels": {
            name: {key: _finite(value) for key, value in vars(channel).items()}
            for name, channel in zip(_CHANNELS, found.channels, strict=False)
        },
        "further_delay_s": found.further_delay_s,
        "box": {
            "relative": found.size,
            "entries": {_name(place): value for place, value in found.entries.items()},
            "corners": _sample(found.corners),
            "inside": _sample(found.inside),
            "stable": found.stable,
        },
        "certificate": {"applies": False, "cause": CertificateCause.LINEAR_PLANT.name.lower()},
    }


def _sample(sample: BoxSample) -> dict[str, Any]:
    return {
        "tried": sample.tried,
        "unstable": sample.unstable,
        "refused": sample.refused,
        "growth_per_s": _finite(sample.growth_per_s),
        "worst": {_name(place): value for place, value in sample.worst.items()},
    }


def _name(place: DerivativeEntry) -> str:
    return f"{place.matrix}: {place.row}: {place.column}"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


HEADS = ("disk, input / output", "gain, dB", "phase, deg", "further delay, ms", "entries",
         "unstable corners", "unstable inside", "slowest, 1/s", "certificate")  # fmt: skip


def cells(row: Mapping[str, Any]) -> list[str]:
    """What stands in a table under `HEADS` of an `as_dict`."""
    channels, box = row["channels"].values(), row["box"]
    gains = [
        abs(c[key])
        for c in channels
        for key in ("gain_up_db", "gain_down_db")
        if c[key] is not None
    ]
    phases = [c["phase_deg"] for c in channels if c["phase_deg"] is not None]
    further_ms = 1e3 * row["further_delay_s"]
    growths = [s["growth_per_s"] for s in (box["corners"], box["inside"]) if s["tried"]]
    return [
        f"{row['disk']['input']['alpha']:.2f} / {row['disk']['output']['alpha']:.2f}",
        f"{min(gains):.1f}" if gains else "–",
        f"{min(phases):.0f}" if phases else "–",
        f"{further_ms:.0f}" if further_ms < 1e3 * LONGEST_DELAY_S else f"≥ {further_ms:.0f}",
        str(len(box["entries"])),
        *(f"{box[of]['unstable']} of {box[of]['tried']}" for of in ("corners", "inside")),
        f"{max(growths):.2f}" if growths else "–",
        "applies" if row["certificate"]["applies"] else "not applicable",
    ]


def print_robustness(found: list[LinearRobustness], out: Console) -> None:
    """The table, and what it says of the certificate."""
    rows = table(f"Margins of the attitude loop; entries of A and B up to {SIZE:.0%} off", out)
    rows.add_column("aircraft, controller")
    for head in HEADS:
        rows.add_column(head, justify="right")
    for one in found:
        rows.add_row(f"{one.aircraft}, {one.law}", *cells(as_dict(one)))
    out.print(rows)
    out.print(
        "Sampled, not proved. Certificate: not applicable, as "
        f"{CertificateCause.LINEAR_PLANT.value}.",
        highlight=False, soft_wrap=True,
    )  # fmt: skip
