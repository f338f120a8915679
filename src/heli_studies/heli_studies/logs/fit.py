# SPDX-License-Identifier: Apache-2.0
"""Models out of a log: of each axis a response of low order, and eq. (10) where the log allows."""

import csv
from dataclasses import asdict, dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_analysis.identification.actuators import IdentifiedAB, fit_record
from heli_analysis.identification.aperiodic import AperiodicRecord
from heli_analysis.identification.axis import AxisModel, fit_axis
from heli_analysis.identification.structure import FULL, ModelStructure
from heli_core.errors import IdentificationError
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import INPUT_NAMES, STATE_NAMES
from heli_core.ticks import TICKS_PER_S
from heli_flight.report.figures import BLUE, GREY, RED, picture
from heli_flight.terminal import table
from heli_studies.identify_methods import print_structure, structure_as_dict
from heli_studies.logs.info import LogInfo, LogVerdict, Part, on_grid, references_of
from heli_studies.logs.signals import FlightLog

_FEEDFORWARD = {
    Part.ROLL: "ATC_RAT_RLL_FF", Part.PITCH: "ATC_RAT_PIT_FF", Part.YAW: "ATC_RAT_YAW_FF",
}  # fmt: skip
_LEAST_RATE_HZ = 0.8 * TICKS_PER_S
_CLOSE = 0.1


@dataclass(frozen=True)
class FittedAxis:
    """A model of one output's answer to one input.

    Attributes
    ----------
    output, input : str
    part : Part
    model : AxisModel or None
    refused : str
        Why there is none.
    """

    output: str
    input: str
    part: Part
    model: AxisModel | None
    refused: str

    @property
    def feedforward(self) -> float | None:
        """ArduPilot's ATC_RAT_*_FF: output per rate asked for, s/rad; None: no such axis."""
        known = self.model is not None and self.part in _FEEDFORWARD and self.model.gain
        return abs(1.0 / self.model.gain) if known and self.model else None


@dataclass(frozen=True)
class FittedLog:
    """What was fitted to a log.

    Attributes
    ----------
    info : LogInfo
    axes : tuple of FittedAxis
    hover : IdentifiedAB or None
        Eq. (10).
    refused : str
        Why there is no `hover`.
    """

    info: LogInfo
    axes: tuple[FittedAxis, ...]
    hover: IdentifiedAB | None
    refused: str

    @property
    def notches_hz(self) -> tuple[float, ...]:
        """Frequencies for notch filters: narrow lines of the rates, one of those close together."""
        found: list[float] = []
        for shaken in self.info.vibration:
            for hertz in shaken.peaks_hz if shaken.name in ("p", "q", "r") else ():
                if all(abs(hertz / other - 1.0) > _CLOSE for other in found):
                    found.append(hertz)
        return tuple(sorted(found))

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        axes = [
            {"output": a.output, "input": a.input, "part": a.part.name, "refused": a.refused,
             "model": a.model and asdict(a.model), "parameter": _FEEDFORWARD.get(a.part),
             "feedforward": a.feedforward}
            for a in self.axes
        ]  # fmt: skip
        hover = self.hover and {
            "states": list(STATE_NAMES), "inputs": list(INPUT_NAMES),
            "A": self.hover.A.tolist(), "B": self.hover.B.tolist(),
            "A_sigma": self.hover.A_sigma.tolist(), "B_sigma": self.hover.B_sigma.tolist(),
            "servo_radps": self.hover.servo_radps, "servo_damping": self.hover.servo_damping,
            "structure": structure_as_dict(self.hover),
            "delay_s": self.hover.delay_s, "delay_s_sigma": self.hover.delay_s_sigma,
        }  # fmt: skip
        return {
            "path": self.info.log.path, "axes": axes, "hover": hover, "refused": self.refused,
            "notches_hz": list(self.notches_hz),
        }  # fmt: skip


def fit_log(info: LogInfo, structure: ModelStructure = FULL) -> FittedLog:
    """Fit all axes that answer, and eq. (10) in a structure."""
    axes = []
    for answer in info.answers:
        if answer.part is Part.CROSS:
            continue
        model, refused = None, answer.cause.value if answer.cause else ""
        if answer.verdict is not LogVerdict.NO and info.response is not None:
            k, m = info.outputs.index(answer.output), info.columns.index(answer.input)
            good = info.response.usable(k, m)
            try:
                model, refused = fit_axis(
                    info.response.omega_radps[good], info.response.value[good, k, m],
                    info.response.sigma[good, k, m],
                ), ""  # fmt: skip
            except IdentificationError as error:
                refused = str(error)
        axes.append(FittedAxis(answer.output, answer.input, answer.part, model, refused))
    hover, refused = None, ""
    try:
        hover = fit_record(record_of(info.log), structure=structure)
    except (IdentificationError, _LacksError) as error:
        refused = str(error)
    return FittedLog(info, tuple(axes), hover, refused)


class _LacksError(ValueError):
    """A log that has not all that eq. (10) needs; one sentence."""


def record_of(log: FlightLog) -> AperiodicRecord:
    """The record that `fit_record` takes, at 100 Hz; raises _LacksError.

    What was added from outside is the log's chirp; without one the sticks; without those nothing
    tells it from what the controllers do.
    """
    inputs = ("d_lat", "d_lon", "d_ped", "d_col")
    needed = ("p", "q", "r", "phi", "theta", *inputs)
    speeds = next((s for s in (("u", "v", "w"), ("vn", "ve", "vd", "psi"))
                   if set(s) <= set(log.signals)), ())  # fmt: skip
    lacking = [name for name in needed if name not in log.signals]
    if lacking or not speeds:
        names = ", ".join(lacking or ["a velocity"])
        raise _LacksError(f"eq. (10) needs {names}, which the log has not")
    slow = [n for n in ("p", "q", "r", *inputs) if log.signals[n].rate_hz < _LEAST_RATE_HZ]
    if slow:
        raise _LacksError(f"eq. (10) needs {', '.join(slow)} at {TICKS_PER_S} Hz")
    sticks = [f"stick_{n.removeprefix('d_')}" for n in inputs]
    extra = ["chirp"] if "chirp" in log.signals and log.sweeps else sticks
    if not set(extra) <= set(log.signals):
        raise _LacksError("eq. (10) needs to know what was added from outside: a chirp, or sticks")
    grid = on_grid([log.signals[n] for n in (*needed, *speeds, *extra)], float(TICKS_PER_S))
    c = grid.columns
    if extra == sticks:
        added = np.column_stack([c[n] for n in sticks])
    else:
        added = np.zeros((grid.time_s.size, len(inputs)))
        for i, name in enumerate(inputs):
            one = references_of(log, [name], grid)
            if one is not None:
                added[:, [i]] = one
    velocity = np.column_stack([c[n] for n in speeds if n != "psi"])
    if "vn" in speeds:
        angles = np.column_stack([c["phi"], c["theta"], c["psi"]])
        R_nb = np.array([quat_to_R_nb(quat_from_euler(*row)) for row in angles])
        velocity = np.einsum("nji,nj->ni", R_nb, velocity)
    return AperiodicRecord(
        np.column_stack([c[n] for n in inputs]),
        added,
        np.column_stack([c[n] for n in ("p", "q", "r")]),
        velocity,
        np.column_stack([c["phi"], c["theta"]]),
        tuple(grid.runs),
    )


# -------------------------------------------------------------------------------------------------
# Shown and written.
# -------------------------------------------------------------------------------------------------


def print_fit(fitted: FittedLog, out: Console) -> None:
    """A table of the axes, and what else came out."""
    shown = table(
        "Each axis: gain e^(-s delay) over 1 + s/pole, or of second order; two sigma", out
    )
    for name in ("answer", "order", "gain, rad/s", "pole, rad/s", "delay, ms", "misfit", "FF"):
        shown.add_column(name, justify="left" if name == "answer" else "right")
    for axis in fitted.axes:
        name, m = f"{axis.output} from {axis.input}", axis.model
        if m is None:
            shown.add_row(name, axis.refused, "", "", "", "", "")
            continue
        ff = axis.feedforward
        shown.add_row(
            name, str(m.order), f"{m.gain:.3g} +- {2.0 * m.sigma['gain']:.2g}",
            f"{m.pole_radps:.3g} +- {2.0 * m.sigma['pole_radps']:.2g}",
            f"{1e3 * m.delay_s:.1f} +- {2e3 * m.sigma['delay_s']:.1f}", f"{m.misfit:.2g}",
            "" if ff is None else f"{_FEEDFORWARD[axis.part]} {ff:.3f}",
        )  # fmt: skip
    out.print(shown)
    if fitted.notches_hz:
        out.print(f"notch filters: {', '.join(f'{f:.1f}' for f in fitted.notches_hz)} Hz")
    if fitted.hover is None:
        out.print(f"no model of eq. (10): {fitted.refused}", markup=False, soft_wrap=True)
    else:
        delay = fitted.hover.delay_s
        print_structure(fitted.hover, out)
        out.print(f"eq. (10): A and B are in the JSON; transport delay {1e3 * delay:.1f} ms")


def responses_csv(info: LogInfo) -> str:
    """Every response of the log as a table: Hz, gain, phase, coherence, random error."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["output", "input", "hz", "gain_db", "phase_deg", "partial_coherence",
                   "random_error"])  # fmt: skip
    found = info.response
    if found is not None:
        hertz = found.omega_radps / (2.0 * np.pi)
        for k, output in enumerate(info.outputs):
            for m, name in enumerate(info.columns):
                value = found.value[:, k, m]
                gain = 20.0 * np.log10(np.maximum(np.abs(value), 1e-300))
                phase = np.degrees(np.unwrap(np.angle(value)))
                columns = (hertz, gain, phase, found.partial_coherence[:, k, m],
                           found.random_error[:, k, m])  # fmt: skip
                for row in zip(*columns, strict=True):
                    rows.writerow([output, name, *(f"{x:.6g}" for x in row)])
    return text.getvalue()


def draw_fit(fitted: FittedLog, path: Path) -> None:
    """Gain and phase of each axis that was fitted, beside its lines."""
    found = fitted.info.response
    axes = [a for a in fitted.axes if a.model is not None]
    if found is None or not axes:
        return
    from matplotlib.ticker import NullFormatter

    with picture(path, 2, len(axes), (4.0 * len(axes), 5.0), sharex="col") as (figure, grid):
        for column, axis in enumerate(axes):
            k, m = (fitted.info.outputs.index(axis.output), fitted.info.columns.index(axis.input))
            good = found.usable(k, m)
            omega, value = found.omega_radps[good], found.value[good, k, m]
            hertz, error = omega / (2.0 * np.pi), found.random_error[good, k, m]
            model = axis.model.response(omega) if axis.model else value
            gain, phase = grid[:, column]
            gain.errorbar(hertz, 20.0 * np.log10(np.abs(value)), yerr=17.0 * error, fmt=".",
                          color=BLUE, ecolor=GREY, label="log, two sigma")  # fmt: skip
            gain.semilogx(hertz, 20.0 * np.log10(np.abs(model)), color=RED, label="model")
            phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(value))), ".", color=BLUE)
            turn = np.degrees(np.unwrap(np.angle(model)))
            turn += 360.0 * np.round((np.degrees(np.angle(value))[:1] - turn[:1]) / 360.0)
            phase.semilogx(hertz, turn, color=RED)
            for ax in (gain, phase):
                ax.xaxis.set_major_formatter("{x:g}")
                ax.xaxis.set_minor_formatter(NullFormatter())
            gain.set_title(f"{axis.output} from {axis.input}")
            phase.set_xlabel("frequency, Hz")
        grid[0, 0].set_ylabel("gain, dB")
        grid[1, 0].set_ylabel("phase, deg")
        grid[0, 0].legend(fontsize="small")
        figure.suptitle(Path(fitted.info.log.path).name)
