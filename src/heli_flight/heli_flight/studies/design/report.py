# SPDX-License-Identifier: Apache-2.0
"""What `heli design` prints: trim, certificate, margins of the three loops, gains; or all of it as
JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import control
import numpy as np
from rich.console import Console
from rich.table import Table

from heli_flight.studies.design.make import LONGEST_DELAY_S, Design
from heli_flight.studies.design.outer import NAMES
from heli_flight.terminal import table
from heli_inner_hinf.margins import ChannelMargin, DiskMargin
from heli_math.rows import NINE
from heli_math.state_names import ACTUATOR_NAMES, INPUT_NAMES, MEASURED, STATE_NAMES


def print_design(design: Design, out: Console) -> None:
    """Everything a control engineer asks first, in tables."""
    s = design.attitude.synthesis
    out.print(f"{design.basis.source}: {design.basis.outer['mass']:g} kg")
    x, u = design.attitude.x_trim, design.basis.u_trim
    commands = ", ".join(f"{n} {v:.4f}" for n, v in zip(ACTUATOR_NAMES, u, strict=True))
    out.print(
        f"trim of hover in still air: phi {np.degrees(x[NINE.phi]):.3f} deg, "
        f"theta {np.degrees(x[NINE.theta]):.3f} deg, {commands}; largest "
        f"residual {design.basis.residual:.1e}"
    )
    out.print(f"modes of the aircraft without control, rad/s: {_modes(design)}")
    star = s.gamma_star
    out.print(
        f"gamma* = {star.value:.10g} in [{star.lower:.10g}, {star.upper:.10g}] "
        f"({star.mechanism.value}), gamma = {s.gamma:.8g} = {s.gamma / star.value:.4f} gamma*, "
        f"norm wind -> h = {s.norm:.6g} at {s.norm_frequency:.3g} rad/s"
    )
    out.print(_certificate(design, out))
    out.print(_margins(design, out))
    survived = design.further_delay_s
    more = "more than " if survived >= LONGEST_DELAY_S else ""
    out.print(
        f"as flown: servos {design.actuation.servo_radps:g} rad/s, transport delay "
        f"{1e3 * design.actuation.delay_s:g} ms, 100 Hz; survives {more}{1e3 * survived:.0f} ms of "
        "further delay in all channels at once"
    )
    out.print(_gains("F, u = F x + G r", s.F, INPUT_NAMES, STATE_NAMES, out))
    names = [STATE_NAMES[i] for i in MEASURED]
    poles = ", ".join(f"{p:g}" for p in design.observer.poles)
    out.print(
        _gains(
            f"observer's K, poles {poles} rad/s",
            design.observer.K,
            ("a_s", "b_s", "d_int"),
            names,
            out,
        )
    )
    if design.outer:
        out.print(_outer(design, out))


def _modes(design: Design) -> str:
    """Poles of the linear model in words, fastest first; oscillations with their damping."""
    with np.errstate(invalid="ignore"):  # a pole at 0 has no damping
        frequencies, dampings, poles = control.damp(design.basis.system, doprint=False)
    words = []
    for i in np.argsort(-frequencies):
        pole, damping = poles[i], dampings[i]
        if pole.imag > 0.0:
            words.append(f"{pole.real:.3g} +- {pole.imag:.3g}i (damping {damping:.3f})")
        elif pole.imag == 0.0:
            words.append(f"{pole.real:.3g}" if abs(pole) > 1e-9 else "0")
    return ", ".join(words)


def _outer(design: Design, out: Console) -> Table:
    rows = table(
        "Position loop with the gains of the parameters (not chosen here), gain and phase margin "
        "of either sign; rms in the turbulence at the start, exact navigation",
        out,
    )
    rows.add_column("axis")
    for name in ("crossover", "gain margin", "phase margin", "modulus margin", "position", "speed"):
        rows.add_column(name, justify="right")
    for name, report in zip(NAMES, design.outer, strict=True):
        if not report.stable:
            rows.add_row(name, "unstable", *([""] * 5))
            continue
        rows.add_row(
            name,
            f"{report.crossover_radps:.2f} rad/s",
            f"{report.gain_margin_db:.1f} dB",
            f"{report.phase_margin_deg:.0f} deg",
            f"{report.modulus_margin:.2f}",
            f"{report.position_rms_m:.3f} m",
            f"{report.speed_rms_mps:.3f} m/s",
        )
    return rows


def _certificate(design: Design, out: Console) -> Table:
    rows = table("Certificate: eq. (16) has a stabilising P >= 0 at this gamma", out)
    for name in ("condition", "number", "bound", ""):
        rows.add_column(name, justify="left" if name in ("condition", "") else "right")
    for condition in design.attitude.synthesis.certificate.conditions:
        rows.add_row(
            condition.name,
            f"{condition.value:.4g}",
            f"{condition.bound:.4g}",
            "holds" if condition.holds else "FAILS",
        )
    return rows


def _margins(design: Design, out: Console) -> Table:
    rows = table(
        "Margins (disk: all channels at once; gain / phase / delay: one, others closed)", out
    )
    rows.add_column("loop")
    for name in ("norm wind -> h", "disk, input", "disk, output", *INPUT_NAMES):
        rows.add_column(name, justify="right")
    for report in design.reports:
        rows.add_row(
            report.name,
            f"{report.norm:.4f}",
            _disk(report.disk_input),
            _disk(report.disk_output),
            *(_channel(margin) for margin in report.channels_input),
        )
    return rows


def _disk(margin: DiskMargin) -> str:
    return f"{margin.alpha:.2f} ({margin.gain_db:.1f} dB, {margin.phase_deg:.0f} deg)"


def _channel(margin: ChannelMargin) -> str:
    delay = "inf" if np.isinf(margin.delay_s) else f"{1e3 * margin.delay_s:.0f} ms"
    return f"{margin.gain_up_db:.1f} dB / {margin.phase_deg:.0f} deg / {delay}"


def _gains(
    title: str, matrix: np.ndarray, names: Sequence[str], columns: Sequence[str], out: Console
) -> Table:
    rows = table(title, out)
    rows.add_column("")
    for name in columns:
        rows.add_column(name, justify="right")
    for name, row in zip(names, matrix, strict=True):
        rows.add_row(name, *(f"{value + 0.0:.4f}" for value in row))
    return rows


def as_dict(design: Design) -> dict[str, Any]:
    """For --json; infinities become None, as JSON has none."""
    s = design.attitude.synthesis
    return {
        "aircraft": design.basis.plant.get("aircraft_file", ""),
        "trim": {"x": design.attitude.x_trim.tolist(), "u": design.basis.u_trim.tolist(),
                 "residual": _finite(design.basis.residual)},
        "gamma": s.gamma,
        "gamma_star": {"value": s.gamma_star.value, "lower": s.gamma_star.lower,
                       "upper": s.gamma_star.upper, "mechanism": s.gamma_star.mechanism.value},
        "norm": s.norm,
        "norm_frequency_radps": s.norm_frequency,
        "certificate": [
            {"condition": c.name, "value": _finite(c.value), "bound": _finite(c.bound),
             "holds": bool(c.holds)}
            for c in s.certificate.conditions
        ],
        "loops": [
            {
                "name": report.name,
                "norm": _finite(report.norm),
                "disk_input": report.disk_input.alpha,
                "disk_output": report.disk_output.alpha,
                "channels_input": {
                    name: {"gain_db": _finite(m.gain_up_db), "phase_deg": _finite(m.phase_deg),
                           "gain_down_db": _finite(m.gain_down_db),
                           "delay_s": _finite(m.delay_s)}
                    for name, m in zip(INPUT_NAMES, report.channels_input, strict=True)
                },
            }
            for report in design.reports
        ],
        "further_delay_s": design.further_delay_s,
        "position_loop": {
            name: {key: _finite(value) for key, value in asdict(report).items()}
            for name, report in zip(NAMES, design.outer, strict=False)
        },
        "F": s.F.tolist(),
        "G": s.G.tolist(),
        "K": design.observer.K.tolist(),
        "observer_poles_radps": list(design.observer.poles),
        "pid": {axis.axis: {"K_P": axis.K_P, "K_I": axis.K_I, "K_D": axis.K_D}
                for axis in design.pid},
    }  # fmt: skip


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
