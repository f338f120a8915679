# SPDX-License-Identifier: Apache-2.0
"""Identifications written to a folder: YAML, JSON and a page of charts.

Bode plots of data, fit and truth, residuals, excitation.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from heli_analysis.identification.actuators import COMMANDS, sampled_rates
from heli_analysis.identification.doubts import structure_doubts
from heli_analysis.identification.model import FAST, FastModel, measured_response
from heli_analysis.identification.spectra import CHANNELS, RATES, Experiment, Spectra, spectra_of
from heli_analysis.identification.structure import AIR, N_FAST, STATE
from heli_core.folders import write_whole
from heli_core.linear import WIND
from heli_core.ticks import TICK_S
from heli_flight.interrupts import held_back
from heli_flight.report.data import Chart, Panel, Trace
from heli_flight.report.figures import write_figures
from heli_flight.report.page import PageHeader, filled
from heli_flight.report.tables import ReportTable, scope
from heli_flight.terminal import being_filled, json_text
from heli_studies.identify import (
    JSON,
    YAML,
    ComparisonRow,
    Identification,
    IdentifyOrder,
    IdentifyOutcome,
    Truth,
    as_dict,
    fast_of,
    misses,
    run,
)
from heli_studies.identify_methods import structure_text

# -------------------------------------------------------------------------------------------------
# Charts.
# -------------------------------------------------------------------------------------------------

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


def charts(identification: Identification, truth: Truth | None) -> list[Chart]:
    """All charts of the page."""
    true = fast_of(truth.basis) if truth is not None else None
    ab_spectra, gust_spectra = (
        spectra_of(identification.actuators),
        spectra_of(identification.gusts),
    )
    wind_model = _with_wind(identification)
    bode = [
        _bode(ab_spectra, identification.ab.fast, true if channel < 3 else None, rate, channel,
              COMMANDS[channel], "rad/s")
        for rate, channel in _SHOWN if np.any(ab_spectra.channel == channel)
    ]  # fmt: skip
    bode += [
        _bode(gust_spectra, wind_model, None if (rate, axis) == _KINKED else true, rate,
              len(COMMANDS) + axis, _AXES[axis], "rad/s per m/s")
        for rate, axis in _GUSTS
    ]  # fmt: skip
    rest = [
        _residuals(identification),
        _excitation(identification.actuators),
        _gust(identification.gusts),
    ]
    return [chart for chart in [*bode, *rest] if chart.has_data]


def _with_wind(identification: Identification) -> FastModel:
    fast = identification.ab.fast
    E = np.zeros((N_FAST, AIR.size))
    E[:, AIR.velocity] = identification.wind.E[FAST]
    # The excitation swings through the kink: the lines show the mean slope of both sides.
    E[STATE.r, AIR.w] = identification.wind.E_rw["mean"]
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
            Panel(f"|{rate} / {name}|", unit, gains, 1.1, log_y=True),
            Panel("phase", "deg", turns, 0.9),
            Panel("coherence", "", [Trace(hz, data.coherence, "coherence", "green", "points")], 0.5,
                  (0.0, 1.05)),
        ],
        kind,
        x_quantity="frequency", x_unit="Hz",
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


def _residuals(identification: Identification) -> Chart:
    """Whitened residuals of both fits over frequency."""
    panels = []
    for title, experiment, fit in (
        ("actuators", identification.actuators, identification.ab.estimate),
        ("gusts", identification.gusts, identification.wind.estimate),
    ):
        hz = spectra_of(experiment).omega_radps / (2.0 * np.pi)
        traces = [
            Trace(hz, np.abs(fit.residual[:, i]), rate, role, "points")
            for i, (rate, role) in enumerate(zip(RATES, ("nav", "truth", "green"), strict=True))
        ]
        panels.append(Panel(f"{title}: |residual|", "1", traces, 1.0))
    return Chart(
        "residuals",
        "Residuals",
        "What the fit leaves of p, q, r at each line, over the noise that is measured between the "
        "lines: about 1 where noise is all that is left, more where the aircraft is not linear.",
        panels,
        "residuals",
        x_quantity="frequency",
        x_unit="Hz",
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
            Panel("added", "1", _traces(time_s, steady.excitation_u[part], COMMANDS)),
            Panel("rate", "deg/s", _traces(time_s, rates, RATES)),
            Panel("angle", "deg", _traces(time_s, angles, ("phi", "theta"))),
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
            Panel("gust", "m/s", _traces(time_s, steady.gust_body_mps[part], _AXES)),
            Panel("rate", "deg/s", _traces(time_s, rates, RATES)),
        ],
        "experiments",
    )  # fmt: skip


def lines_of(experiment: Experiment) -> str:
    """How many lines each channel has, in words."""
    spectra = spectra_of(experiment)
    names = [*COMMANDS, *_AXES]
    counts = [(names[i], int(np.sum(spectra.channel == i))) for i in range(len(names))]
    return ", ".join(f"{count} of {name}" for name, count in counts if count)


# -------------------------------------------------------------------------------------------------
# report.html and figures of an identification, with the flight report's look.
# -------------------------------------------------------------------------------------------------

PAGE, FIGURES = "report.html", "figures"
_TITLES = {
    "result": "Identified numbers",
    "actuators": "Responses to the actuators",
    "gusts": "Responses to the gusts",
    "residuals": "Residuals",
    "experiments": "The experiments",
    "ground": "Measured on the ground",
    "scope": "What is not simulated",
}
_GROUPS = {
    "A": "A, eq. (10)", "B": "B, eq. (10)", "E": "E, eq. (10)", "": "Servos, delay, trim, thrust",
    "norm": "Norm wind to h of the closed loop",
}  # fmt: skip
_DEFINITION = (
    "An entry is significant if its effect, |true entry| times the rms (over the excited lines) of "
    "the state or input that it multiplies, is above 1 % of the largest such effect in its row; "
    "grey rows are not. The truth is the linearised aircraft file: for comparison only, no number "
    "of it is used. E(r,w) is that of rising air (the power of climb makes a kink at w = 0)."
)


def write_page(outcome: IdentifyOutcome, folder: Path) -> Path:
    """Write report.html and figures/ into a folder; returns the page.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    drawn = charts(outcome.identification, outcome.truth)
    page = folder / PAGE
    write_whole(page, render(outcome, drawn))
    write_figures(drawn, _conditions(outcome), folder / FIGURES)
    return page


def render(outcome: IdentifyOutcome, drawn: Sequence[Chart]) -> str:
    """The page as text."""
    head = PageHeader(
        kind="Identification report · simulation",
        title="Identification of the hover model",
        heading="Identification of the hover model",
        verdicts=[_verdict(outcome)],
        facts=_facts(outcome),
        links=_TITLES,
    )
    groups = {title: _group(outcome, group) for group, title in _GROUPS.items()}
    return filled(
        "identification.html",
        head,
        drawn,
        definition=_DEFINITION,
        groups={title: table for title, table in groups.items() if table.rows},
        zeros=outcome.zeros,
        ground=_ground(outcome),
        not_simulated=scope(outcome.settings.nodes["plant"])["Not simulated"],
    )


def _verdict(outcome: IdentifyOutcome) -> tuple[str, str, str]:
    judged = [row for row in outcome.rows if row.met is not None]
    missed = misses(outcome.rows)
    if outcome.truth is None:
        return "–", "", "No aircraft file to compare with: see the standard deviations."
    if missed:
        names = ", ".join(row.name for row in missed)
        return (
            "✗",
            "bad",
            (
                f"{len(judged) - len(missed)} of {len(judged)} significant numbers meet their "
                f"target (A, B, servos, norms 5 %, E 10 %); missed: {names}."
            ),
        )
    return (
        "✓",
        "good",
        (
            f"All {len(judged)} significant numbers meet their target: A, B, servos and norms "
            "within 5 % of the linearised truth, E within 10 %."
        ),
    )


def _facts(outcome: IdentifyOutcome) -> list[tuple[str, str]]:
    identification, settings = outcome.identification, outcome.settings
    a_priori, bound = identification.a_priori, identification.design.attitude.bound
    return [
        ("Experiments", f"2, {a_priori.periods} periods of {a_priori.period_s:g} s each"),
        ("Lines", f"{lines_of(identification.actuators)}; {lines_of(identification.gusts)}"),
        ("Structure", structure_text(identification.ab.structure)),
        *((("Doubt", doubt.value)) for doubt in structure_doubts(identification.ab)),
        ("Compared with", outcome.truth.basis.source if outcome.truth else "nothing"),
        ("GPS", settings.gps),
        ("Seed", str(settings.seed)),
        ("gamma", f"{bound.gamma:.4g}" if bound else "none"),
    ]


def _conditions(outcome: IdentifyOutcome) -> str:
    a_priori = outcome.identification.a_priori
    return (
        f"Simulated flight: turbulence of MIL-F-8785C and sensor noise on; {a_priori.periods} "
        f"periods of {a_priori.period_s:g} s; seed {outcome.settings.seed}"
    )


def _number(value: float, digits: int = 5) -> str:
    return "–" if np.isnan(value) else f"{value:.{digits}g}".replace("-", "−")


def _cells(row: ComparisonRow, known: bool) -> list[str]:
    marks = {True: "✓", False: "✗", None: ""}
    dull = row.met is None and not row.significant
    name = Markup('<span class="dull">{}</span>').format(row.name) if dull else row.name
    spread = _number(2.0 * row.sigma, 2) if row.sigma > 0.0 else "–"
    cells = [name, _number(row.value), spread]
    if known:
        cells += [_number(row.truth), row.deviation_text.replace("-", "−") or "–"]
    share = "" if np.isnan(row.share) else f"{100.0 * row.share:.3g} %"
    return [*cells, share, *([marks[row.met]] if known else [])]


def _group(outcome: IdentifyOutcome, group: str) -> ReportTable:
    """The identified numbers of one group."""
    known = outcome.truth is not None
    head = ["", "identified", "± 2σ", *(["truth", "deviation"] if known else []), "effect in row"]
    rows = [_cells(row, known) for row in outcome.rows if row.group == group]
    return ReportTable(head + ([""] if known else []), rows)


def _ground(outcome: IdentifyOutcome) -> ReportTable:
    a_priori = outcome.identification.a_priori
    return ReportTable(
        ["constant", "value, SI"],
        [[name, _number(float(value))] for name, value in a_priori.ground.items()],
        "By scale, ruler, rpm counter, or from a table "
        f"({a_priori.source}); all else comes from the two flights.",
    )


def write(outcome: IdentifyOutcome, folder: Path) -> None:
    """Write identified.yaml, identification.json with what `as_dict` gives, and the page."""
    from heli_studies.design.make import write_yaml

    write_yaml(outcome.identification.design, folder / YAML, "heli identify, from flight data")
    write_whole(folder / JSON, json_text(as_dict(outcome)))
    write_page(outcome, folder)


def execute(wanted: IdentifyOrder, folder: Path) -> IdentifyOutcome:
    """`run` and `write` in a new folder; a failure leaves the bags that were flown, else nothing.

    An interrupt waits until all is written.

    Raises
    ------
    ParameterError, BagDataError, IdentificationError, SynthesisError, FlightError
    """
    with being_filled(folder) as new:
        try:
            if not (wanted.from_bags or wanted.one_process):
                from heli_flight.graph.processes import check_middleware, start_server

                check_middleware()
                start_server()
            outcome = run(wanted, folder)
            with held_back():
                write(outcome, folder)
        finally:
            new.stays = any(folder.glob("*/bag"))
    return outcome
