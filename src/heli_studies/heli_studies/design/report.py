# SPDX-License-Identifier: Apache-2.0
"""What `heli design` prints: trim, certificate, margins of the three loops, gains; or all of it as
JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import control
import numpy as np
from rich.console import Console
from rich.table import Table

from heli_flight.loop.position_axes import NAMES
from heli_flight.studies.design.between_samples import norms_on_the_way
from heli_flight.studies.design.make import LONGEST_DELAY_S, Design
from heli_flight.terminal import table
from heli_inner_hinf.law_state import CONTROLLERS, STATE_FEEDBACK
from heli_inner_hinf.margins import ChannelMargin, DiskMargin
from heli_inner_hinf.output_feedback import OutputSynthesis
from heli_math.rows import NINE
from heli_math.state_names import ACTUATOR_NAMES, INPUT_NAMES, MEASURED, STATE_NAMES
from heli_outer_pd.axis_analysis import AxisReport

_DISK, _CHANNEL = ("", ", gain", ", phase"), (", gain", ", phase", ", delay")


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
    own = design.attitude.output
    if own is None:
        star = s.gamma_star
        out.print(
            f"gamma* = {star.value:.10g} in [{star.lower:.10g}, {star.upper:.10g}] "
            f"({star.mechanism.value}), gamma = {s.gamma:.8g} = {s.gamma / star.value:.4f} gamma*, "
            f"norm wind -> h = {s.norm:.6g} at {s.norm_frequency:.3g} rad/s"
        )
        out.print(_certificate(design, out))
    else:
        out.print(_of_output(own))
    out.print(said_of_the_flown_norm(design))
    out.print(_margins(design, out))
    survived = design.further_delay_s
    more = "more than " if survived >= LONGEST_DELAY_S else ""
    out.print(
        f"as flown: servos {design.actuation.servo_radps:g} rad/s, transport delay "
        f"{1e3 * design.actuation.delay_s:g} ms, 100 Hz; survives {more}{1e3 * survived:.0f} ms of "
        "further delay in all channels at once"
    )
    if own is None:
        out.print(_gains("F transposed, u = F x + G r", s.F, INPUT_NAMES, STATE_NAMES, out))
    names = [STATE_NAMES[i] for i in MEASURED]
    poles = ", ".join(f"{p:g}" for p in design.observer.poles)
    out.print(
        _gains(
            f"observer's K transposed, poles {poles} rad/s",
            design.observer.K,
            ("a_s", "b_s", "d_int"),
            names,
            out,
        )
    )
    if design.outer and design.outer_together:
        out.print(_outer(design, out))
        lags = design.values["outer_loop"]["disturbance.attitude_lag_s"]
        out.print(
            f"phi_ref, theta_ref and collective broken together: disk margin "
            f"{design.outer_together.alpha:.2f} at {design.outer_together.frequency:.1f} rad/s; "
            f"around the attitude loop of {design.attitude.controller} as flown, lag of pitch "
            f"{lags[0]:.2f} s, of roll {lags[1]:.2f} s"
        )


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


def _of_output(found: OutputSynthesis) -> str:
    """Certificate of output feedback in a sentence."""
    star, K = found.gamma_star, found.controller
    return (
        f"output feedback of order {found.law.A.shape[0]}: gamma* = {star.value:.6g} in "
        f"[{star.lower:.6g}, {star.value:.6g}] ({star.mechanism.value}), gamma = {found.gamma:.6g} "
        f"= {found.gamma / star.value:.4f} gamma*, norm (wind, load, noise) -> (h, integrals) = "
        f"{found.norm:.6g} at {found.norm_frequency:.3g} rad/s, rho(X Y) / gamma^2 = "
        f"{K.radius:.4g}, largest residual of both Riccati equations {K.residual:.1e}"
    )


def said_of_the_flown_norm(design: Design) -> str:
    """What the certificate is worth for the loop as flown; where it is exceeded, by what."""
    flown, gamma = design.between_samples, design.attitude.synthesis.gamma
    said = (
        f"as flown, between its samples too: norm wind -> h = {flown.upper:.6g} at "
        f"{flown.frequency_radps:.3g} rad/s (bounds {flown.upper - flown.lower:.1e} apart)"
    )
    if CONTROLLERS[design.attitude.controller] != STATE_FEEDBACK:
        return said
    if flown.upper < gamma:
        return f"{said}, below gamma = {gamma:.6g}: what is certified holds as flown"
    steps = ", ".join(
        f"{name} {_norm(value)}"
        for name, value in norms_on_the_way(
            design.model,
            design.observer.K,
            design.attitude.prediction_s,
            design.observer_input,
            design.actuation,
        )
    )
    return f"{said}, NOT below gamma = {gamma:.6g}, which is proved for state feedback: {steps}"


def _norm(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else "unstable"


def _outer(design: Design, out: Console) -> Table:
    return _beside(
        "Position loop, gain and phase margin of either sign; rms in the hover test's turbulence "
        "with RTK, and the least that any linear law leaves, actuators perfect",
        (
            "crossover",
            "gain margin",
            "phase margin",
            "disk margin",
            "position",
            "at least",
            "speed",
            "at least ",
        ),
        dict(zip(NAMES, map(_axis, design.outer), strict=True)),
        out,
    )


def _axis(report: AxisReport) -> list[str]:
    if not report.stable:
        return ["unstable", *([""] * 7)]
    return [
        f"{report.crossover_radps:.2f} rad/s",
        f"{report.gain_margin_db:.1f} dB",
        f"{report.phase_margin_deg:.0f} deg",
        f"{report.disk_margin:.2f}",
        f"{report.position_rms_m:.3f} m",
        f"{report.position_limit_m:.3f} m",
        f"{report.speed_rms_mps:.3f} m/s",
        f"{report.speed_limit_mps:.3f} m/s",
    ]


def _beside(
    title: str, names: Sequence[str], columns: Mapping[str, Sequence[str]], out: Console
) -> Table:
    """A table of a column for each of few things, a row for each of what is told of them."""
    rows = table(title, out)
    rows.add_column("")
    for head in columns:
        rows.add_column(head, justify="right")
    for name, *cells in zip(names, *columns.values(), strict=True):
        rows.add_row(name, *cells)
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
    names = ["norm wind -> h"]
    names += [f"{name}{part}" for name in ("disk, input", "disk, output") for part in _DISK]
    names += [f"{name}{part}" for name in INPUT_NAMES for part in _CHANNEL]
    columns = {
        report.name: [
            f"{report.norm:.4f}",
            *_disk(report.disk_input),
            *_disk(report.disk_output),
            *(word for margin in report.channels_input for word in _channel(margin)),
        ]
        for report in design.reports
    }
    title = "Margins (disk: all channels at once; d_lat to d_ped: one, others closed)"
    return _beside(title, names, columns, out)


def _disk(margin: DiskMargin) -> tuple[str, str, str]:
    return f"{margin.alpha:.2f}", f"{margin.gain_db:.1f} dB", f"{margin.phase_deg:.0f} deg"


def _channel(margin: ChannelMargin) -> tuple[str, str, str]:
    delay = "inf" if np.isinf(margin.delay_s) else f"{1e3 * margin.delay_s:.0f} ms"
    return f"{margin.gain_up_db:.1f} dB", f"{margin.phase_deg:.0f} deg", delay


def _gains(
    title: str, matrix: np.ndarray, names: Sequence[str], columns: Sequence[str], out: Console
) -> Table:
    """A gain matrix, transposed: it has few rows."""
    cells = {
        name: [f"{value + 0.0:.4f}" for value in row]
        for name, row in zip(names, matrix, strict=True)
    }
    return _beside(title, columns, cells, out)


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
        "between_samples": design.between_samples._asdict(),
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
        "position_loop_together": design.outer_together and design.outer_together.alpha,
        "position_loop": {
            name: {key: _finite(value) for key, value in asdict(report).items()}
            for name, report in zip(NAMES, design.outer, strict=False)
        },
        "output": _as_dict_of_output(design.attitude.output),
        "F": s.F.tolist(),
        "G": s.G.tolist(),
        "K": design.observer.K.tolist(),
        "observer_poles_radps": list(design.observer.poles),
        "pid": {axis.axis: {"K_P": axis.K_P, "K_I": axis.K_I, "K_D": axis.K_D}
                for axis in design.pid},
    }  # fmt: skip


def _as_dict_of_output(found: OutputSynthesis | None) -> dict[str, Any] | None:
    if found is None:
        return None
    star = found.gamma_star
    return {
        "order": found.law.A.shape[0],
        "gamma": found.gamma,
        "gamma_star": {
            "value": star.value,
            "lower": star.lower,
            "mechanism": star.mechanism.value,
        },
        "norm": found.norm,
        "norm_frequency_radps": found.norm_frequency,
        "radius": found.controller.radius,
        "residual": found.controller.residual,
    }


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
