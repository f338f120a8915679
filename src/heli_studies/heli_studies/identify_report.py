# SPDX-License-Identifier: Apache-2.0
"""Charts of an identification: Bode plots of data, fit and truth, residuals, excitation."""

from collections.abc import Sequence

import numpy as np

from heli_flight.report.chart import Chart, Panel, Trace
from heli_flight.studies.identify.compare import Truth, fast_of
from heli_flight.studies.identify.fit import Identification
from heli_identification.experiment import RATES, Experiment
from heli_identification.measured import CHANNELS, measured_response
from heli_identification.places import AIR, FAST, N_FAST, STATE
from heli_identification.response import FastModel
from heli_identification.spectra import Spectra, spectra_of
from heli_identification.system import COMMANDS, sampled_rates
from heli_math.state_space import WIND
from heli_math.ticks import TICK_S

_SHOWN = (
    # rate, channel, role of the channel, unit
    ("p", 0), ("q", 0), ("p", 1), ("q", 1), ("r", 2), ("p", 2), ("r", 3),
)  # fmt: skip
_GUSTS = (("p", 1), ("p", 2), ("q", 2), ("r", 1), ("r", 2))
# Linear on each side of w = 0 only: the lines show the mean of both, which no linearisation has.
_KINKED = ("r", 2)
_AXES = ("u", "v", "w")
_ROLES = ("nav", "truth", "green", "rival")
_POINTS = 300
_SIGMAS = 2.0


def charts(found: Identification, truth: Truth | None) -> list[Chart]:
    """All charts of the page."""
    true = fast_of(truth.basis) if truth is not None else None
    ab_spectra, gust_spectra = spectra_of(found.actuators), spectra_of(found.gusts)
    wind_model = _with_wind(found)
    bode = [
        _bode(ab_spectra, found.ab.fast, true if channel < 3 else None, rate, channel,
              COMMANDS[channel], "rad/s")
        for rate, channel in _SHOWN if np.any(ab_spectra.channel == channel)
    ]  # fmt: skip
    bode += [
        _bode(gust_spectra, wind_model, None if (rate, axis) == _KINKED else true, rate,
              len(COMMANDS) + axis, _AXES[axis], "rad/s per m/s")
        for rate, axis in _GUSTS
    ]  # fmt: skip
    rest = [_residuals(found), _excitation(found.actuators), _gust(found.gusts)]
    return [chart for chart in [*bode, *rest] if chart.has_data]


def _with_wind(found: Identification) -> FastModel:
    fast = found.ab.fast
    E = np.zeros((N_FAST, AIR.size))
    E[:, AIR.velocity] = found.wind.E[FAST]
    # The excitation swings through the kink: the lines show the mean slope of both sides.
    E[STATE.r, AIR.w] = found.wind.E_rw["mean"]
    return FastModel(fast.A, fast.B, E, fast.servo_radps, fast.servo_damping, fast.delay_s)


def _bode(
    spectra: Spectra,
    model: FastModel,
    true: FastModel | None,
    rate: str,
    channel: int,
    name: str,
    unit: str,
) -> Chart:
    """Magnitude, phase and coherence of one response."""
    data = measured_response(spectra, model, rate, CHANNELS[channel])
    hz = data.omega_radps / (2.0 * np.pi)
    grid = np.geomspace(hz.min(), hz.max(), _POINTS)
    source = (*COMMANDS, *WIND)[channel]
    curves = [("fit", "nav", "line", model)]
    if true is not None:
        curves.append(("truth by linearisation (comparison only)", "truth", "dash", true))
    magnitude, phase = np.abs(data.value), np.degrees(np.unwrap(np.angle(data.value)))
    gains = [Trace(hz, magnitude, "data", "reference", "points"), _bars(hz, magnitude, data.sigma)]
    turns = [Trace(hz, phase, "data", "reference", "points")]
    for label, role, kind, fast in curves:
        response = sampled_rates(fast)[rate, source](np.exp(2j * np.pi * grid * TICK_S))
        angle = np.degrees(np.unwrap(np.angle(response)))
        angle += 360.0 * np.round((phase[0] - angle[0]) / 360.0)
        gains.append(Trace(grid, np.abs(response), label, role, kind))
        turns.append(Trace(grid, angle, label, role, kind))
    kind = "actuators" if channel < len(COMMANDS) else "gusts"
    return Chart(
        f"bode_{rate}_{name}",
        f"{rate} from {name}",
        f"Measured at the lines of {name} with two standard deviations, other inputs' part taken "
        "off; the fit to all lines at once.",
        [
            Panel(f"|{rate} / {name}|, {unit}", gains, 1.1, log_y=True),
            Panel("phase, deg", turns, 0.9),
            Panel("coherence", [Trace(hz, data.coherence, "coherence", "green", "points")], 0.5,
                  (0.0, 1.05)),
        ],
        kind,
        x_label="frequency, Hz",
        time=False,
        log_x=True,
    )  # fmt: skip


def _bars(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> Trace:
    """Vertical bars of two standard deviations, as one line with gaps."""
    low = np.maximum(y - _SIGMAS * sigma, 1e-3 * y)
    gap = np.full_like(x, np.nan)
    xs = np.column_stack([x, x, gap]).ravel()
    ys = np.column_stack([low, y + _SIGMAS * sigma, gap]).ravel()
    return Trace(xs, ys, "two standard deviations", "reference", "line", width=1.0)


def _residuals(found: Identification) -> Chart:
    """Whitened residuals of both fits over frequency."""
    panels = []
    for title, experiment, fit in (
        ("actuators", found.actuators, found.ab.estimate),
        ("gusts", found.gusts, found.wind.estimate),
    ):
        hz = spectra_of(experiment).omega_radps / (2.0 * np.pi)
        traces = [
            Trace(hz, np.abs(fit.residual[:, i]), rate, role, "points")
            for i, (rate, role) in enumerate(zip(RATES, ("nav", "truth", "green"), strict=True))
        ]
        panels.append(Panel(f"{title}: |residual|, 1", traces, 1.0))
    return Chart(
        "residuals",
        "Residuals",
        "What the fit leaves of p, q, r at each line, over the noise that is measured between the "
        "lines: about 1 where noise is all that is left, more where the aircraft is not linear.",
        panels,
        "residuals",
        x_label="frequency, Hz",
        time=False,
        log_x=True,
    )


def _first_period(experiment: Experiment) -> tuple[Experiment, slice, np.ndarray]:
    steady = experiment.steady()
    part = slice(0, steady.period_ticks)
    return steady, part, np.arange(steady.period_ticks) * TICK_S + experiment.start_s


def _traces(time_s: np.ndarray, values: np.ndarray, names: Sequence[str]) -> list[Trace]:
    """One line per column."""
    return [Trace(time_s, values[:, i], name, _ROLES[i]) for i, name in enumerate(names)]


def _excitation(experiment: Experiment) -> Chart:
    steady, part, time_s = _first_period(experiment)
    rates = np.degrees(steady.rate_body_radps[part])
    angles = np.degrees(steady.attitude_rad[part])
    return Chart(
        "excitation",
        "One period of the first experiment",
        "What was added to the actuators, and what the aircraft did.",
        [
            Panel("added, 1", _traces(time_s, steady.excitation_u[part], COMMANDS)),
            Panel("rate, deg/s", _traces(time_s, rates, RATES)),
            Panel("angle, deg", _traces(time_s, angles, ("phi", "theta"))),
        ],
        "experiments",
    )  # fmt: skip


def _gust(experiment: Experiment) -> Chart:
    steady, part, time_s = _first_period(experiment)
    rates = np.degrees(steady.rate_body_radps[part])
    return Chart(
        "gust",
        "One period of the second experiment",
        "The gust that was injected, and what the aircraft did.",
        [
            Panel("gust, m/s", _traces(time_s, steady.gust_body_mps[part], _AXES)),
            Panel("rate, deg/s", _traces(time_s, rates, RATES)),
        ],
        "experiments",
    )  # fmt: skip


def lines_of(experiment: Experiment) -> str:
    """How many lines each channel has, in words."""
    spectra = spectra_of(experiment)
    names = [*COMMANDS, *_AXES]
    counts = [(names[i], int(np.sum(spectra.channel == i))) for i in range(len(names))]
    return ", ".join(f"{count} of {name}" for name, count in counts if count)
