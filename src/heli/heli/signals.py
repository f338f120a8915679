# SPDX-License-Identifier: Apache-2.0
"""Signals of a flight: arrays with a name, a unit and a meaning, in groups."""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from heli_flight.loop.record import FlightRecord


@dataclass(frozen=True)
class Signal:
    """One signal.

    Attributes
    ----------
    values : (N,) or (N, k) ndarray
        One row per tick; cannot be written.
    unit : str
        Empty for none.
    meaning : str
        A few words: frame, sign.
    """

    values: NDArray
    unit: str
    meaning: str


class Signals(Mapping[str, NDArray]):
    """A group of signals: `group.phi_rad`, `group["phi_rad"]`, `group.unit("phi_rad")`.

    Parameters
    ----------
    name : str
        Of the group, as in `flight.truth`.
    signals : mapping of name to Signal
    """

    def __init__(self, name: str, signals: Mapping[str, Signal]) -> None:
        self._name, self._signals = name, dict(signals)
        for signal in self._signals.values():
            signal.values.setflags(write=False)

    def __getitem__(self, name: str) -> NDArray:
        return self._found(name, KeyError).values

    def __getattr__(self, name: str) -> NDArray:
        if name.startswith("_"):
            raise AttributeError(name)
        return self._found(name, AttributeError).values

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __len__(self) -> int:
        return len(self._signals)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._signals]

    def unit(self, name: str) -> str:
        """Unit of a signal, empty for none."""
        return self._found(name, KeyError).unit

    def meaning(self, name: str) -> str:
        """What a signal is, in a few words."""
        return self._found(name, KeyError).meaning

    def columns(self) -> dict[str, NDArray]:
        """The signals of one number per tick, by `group_name`."""
        found = self._signals.items()
        return {f"{self._name}_{n}": s.values for n, s in found if s.values.ndim == 1}

    def _found(self, name: str, error: type[Exception]) -> Signal:
        if name in self._signals:
            return self._signals[name]
        near = difflib.get_close_matches(name, self._signals, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(self._signals)}"
        raise error(f"{self._name} has no signal {name!r}; {hint}")

    def _rows(self) -> list[tuple[str, str, str, str]]:
        return [
            (f"{self._name}.{name}", " x ".join(map(str, s.values.shape)), s.unit, s.meaning)
            for name, s in self._signals.items()
        ]

    def __repr__(self) -> str:
        rows = self._rows()
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        return "\n".join(
            "  ".join(cell.ljust(n) for cell, n in zip(row, widths, strict=True)).rstrip()
            for row in rows
        )

    def _repr_html_(self) -> str:
        return html_table(("signal", "shape", "unit", ""), self._rows())


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> str:
    """A table for a notebook; every cell is text."""
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    return f"<table>{caption}<thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"


_AXES = ("north", "east", "down")


def _scalar(values: NDArray, unit: str, meaning: str) -> Signal:
    return Signal(np.ascontiguousarray(values), unit, meaning)


def _motion(
    pos: NDArray, vel: NDArray, q: NDArray, rate: NDArray, rotor: NDArray
) -> dict[str, Signal]:
    """What ground truth and navigation share."""
    from heli_math.rotations import euler_angles

    euler = euler_angles(q)
    found = {
        "pos_ned_m": Signal(pos.view(), "m", "position: north, east, down"),
        "vel_ned_mps": Signal(vel.view(), "m/s", "velocity over the ground: north, east, down"),
        "q_nb": Signal(q.view(), "", "attitude quaternion w, x, y, z, body to NED"),
        "rate_body_radps": Signal(rate.view(), "rad/s", "p, q, r: forward, right, down"),
    }
    for i, axis in enumerate(_AXES):
        found[f"{axis}_m"] = _scalar(pos[:, i], "m", f"position, {axis}")
    found["altitude_m"] = _scalar(-pos[:, 2], "m", "position, up")
    for i, axis in enumerate(_AXES):
        found[f"vel_{axis}_mps"] = _scalar(vel[:, i], "m/s", f"velocity over the ground, {axis}")
    for i, (name, words) in enumerate(
        (("phi", "roll, right side down"), ("theta", "pitch, nose up"), ("psi", "heading"))
    ):
        found[f"{name}_rad"] = _scalar(euler[:, i], "rad", words)
    for i, name in enumerate(("p", "q", "r")):
        found[f"{name}_radps"] = _scalar(rate[:, i], "rad/s", f"body rate {name}")
    for i, (name, words) in enumerate(
        (
            ("a_s", "disc tilted backwards"),
            ("b_s", "disc tilted to the right"),
            ("d_int", "integrator of the yaw gyro"),
        )
    ):
        found[f"{name}_rad"] = _scalar(rotor[:, i], "rad", words)
    return found


def groups_of(record: "FlightRecord") -> dict[str, Signals]:
    """The groups of a `heli_flight` FlightRecord: truth, nav, reference, setpoint, u, wind."""
    r = record
    nav = _motion(r.nav_pos_ned_m, r.nav_vel_ned_mps, r.nav_q_nb, r.nav_rate_body_radps,
                  r.nav_rotor)  # fmt: skip
    sigmas = (
        ("sigma_pos_m", r.nav_sigma_pos_m, "m", "standard deviation of the position, NED"),
        ("sigma_vel_mps", r.nav_sigma_vel_mps, "m/s", "standard deviation of the velocity, NED"),
        ("sigma_att_rad", r.nav_sigma_att_rad, "rad", "of the attitude, about north, east, down"),
    )
    nav |= {n: Signal(a.view(), unit, words) for n, a, unit, words in sigmas if a is not None}
    truth = _motion(r.truth_pos_ned_m, r.truth_vel_ned_mps, r.truth_q_nb,
                    r.truth_rate_body_radps, r.truth_rotor)  # fmt: skip
    return {
        "truth": Signals("truth", truth),
        "nav": Signals("nav", nav),
        "reference": Signals("reference", _reference(r.reference)),
        "setpoint": Signals("setpoint", _setpoint(r.setpoint)),
        "u": Signals("u", _actuators(r.u)),
        "wind": Signals("wind", _wind(r.wind_ned_mps)),
    }


def _reference(rows: NDArray) -> dict[str, Signal]:
    from heli_math.rows import REFERENCE

    pos, vel = rows[:, REFERENCE.pos], rows[:, REFERENCE.vel]
    found = {
        "pos_ned_m": Signal(pos.view(), "m", "where it should be: north, east, down"),
        "vel_ned_mps": Signal(vel.view(), "m/s", "how it should move: north, east, down"),
    }
    for i, axis in enumerate(_AXES):
        found[f"{axis}_m"] = _scalar(pos[:, i], "m", f"position, {axis}")
    found["altitude_m"] = _scalar(-pos[:, 2], "m", "position, up")
    return found | {"psi_rad": _scalar(rows[:, REFERENCE.psi], "rad", "heading")}


def _setpoint(rows: NDArray) -> dict[str, Signal]:
    words = ("commanded roll", "commanded pitch", "commanded heading")
    names = ("phi_rad", "theta_rad", "psi_rad")
    pairs = enumerate(zip(names, words, strict=True))
    return {name: _scalar(rows[:, i], "rad", told) for i, (name, told) in pairs}


def _actuators(rows: NDArray) -> dict[str, Signal]:
    words = {
        "delta_lat": "lateral cyclic, -1 to 1",
        "delta_lon": "longitudinal cyclic, -1 to 1",
        "delta_ped": "pedal, -1 to 1",
        "delta_col": "collective, -1 to 1",
    }
    return {name: _scalar(rows[:, i], "", told) for i, (name, told) in enumerate(words.items())}


def _wind(rows: NDArray) -> dict[str, Signal]:
    found = {"ned_mps": Signal(rows.view(), "m/s", "velocity of the air: north, east, down")}
    for i, axis in enumerate(_AXES):
        found[f"{axis}_mps"] = _scalar(rows[:, i], "m/s", f"velocity of the air, {axis}")
    return found
