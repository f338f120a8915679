# SPDX-License-Identifier: Apache-2.0
"""What shakes and what answers: spectra of IMU, actuators, attitude and position.

Beside them stand the frequencies that the design knows: disturbance rejection bandwidth and
crossover of the attitude loop, and the lines of the rotor where its vibration is simulated.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from heli_core.metrics import heading_frame
from heli_core.rows import IMU, REFERENCE
from heli_dynamics_sim.config import PlantConfig
from heli_flight.report.charts import DesignNumbers, LoopNumbers
from heli_flight.report.data import Chart, Panel, Report, Trace
from heli_flight.report.tables import ReportTable
from heli_flight.scoring import SOURCE_NAMES
from heli_inner_hinf.excitation import AXES

# -------------------------------------------------------------------------------------------------
# Power spectral densities of recorded signals, by Welch's method.
#
# One-sided, in the signal's unit squared per Hz: the area below a density is the signal's
# variance.
# Windows of Hann that overlap by half, each without its mean (Welch, IEEE Transactions on Audio
# and
# Electroacoustics 15(2), 1967; `scipy.signal.welch`).
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

_PARTS = 6
"""A window is so much of the record: 11 windows, each with half of the next one."""
_LONGEST_S = 40.0
LEAST_SAMPLES = 240


@dataclass(frozen=True)
class Spectrum:
    """Density of one signal.

    Attributes
    ----------
    hertz : (m,) array
        Frequencies above 0, up to half of the sampling rate.
    density : (m,) array
        Unit squared per Hz.
    step_hz : float
        Between lines.
    rms : float
        Of the samples about their mean.
    """

    hertz: Array
    density: Array
    step_hz: float
    rms: float

    @property
    def area_rms(self) -> float:
        """Root of the area below the density: the rms by the other way (Parseval)."""
        return float(np.sqrt(self.density.sum() * self.step_hz))

    @property
    def median_hz(self) -> float:
        """Half of the power is below."""
        share = np.cumsum(self.density)
        return float(self.hertz[np.searchsorted(share, 0.5 * share[-1])])

    def below(self, hertz: float) -> float:
        """Share of the power below a frequency."""
        whole = float(self.density.sum())
        return float(self.density[self.hertz <= hertz].sum()) / whole if whole > 0.0 else 0.0


def even(time_s: Array, values: Array) -> tuple[float, Array, int] | None:
    """Samples (n, k) at even times, how many per second, and how many of them were not recorded.

    Those are put between their neighbours. None for what is too short, or not finite.

    Parameters
    ----------
    time_s : (N,) array
    values : (N, k) array
    """
    if time_s.size < LEAST_SAMPLES or not np.isfinite(values).all():
        return None
    step_s = float(np.median(np.diff(time_s)))
    if step_s <= 0.0:
        return None
    count = round(float(time_s[-1] - time_s[0]) / step_s) + 1
    at = time_s[0] + step_s * np.arange(count)
    filled = [np.interp(at, time_s, column) for column in values.T]
    return 1.0 / step_s, np.column_stack(filled), count - time_s.size


def spectrum(values: Array, rate_hz: float) -> Spectrum:
    """Density of (n,) samples, `LEAST_SAMPLES` or more, so many per second."""
    from scipy import signal  # takes a third of a second to import

    size = min(values.size, max(LEAST_SAMPLES, values.size // _PARTS), round(_LONGEST_S * rate_hz))
    hertz, density = signal.welch(
        values, fs=rate_hz, window="hann", nperseg=size, noverlap=size // 2, detrend="constant",
        scaling="density",
    )  # fmt: skip
    return Spectrum(hertz[1:], density[1:], float(hertz[1]), float(np.std(values)))


def folded(hertz: float, rate_hz: float) -> float:
    """Where a sine shows up in samples, so many per second."""
    return abs(hertz - rate_hz * round(hertz / rate_hz))


# -------------------------------------------------------------------------------------------------
# Spectrum charts.
# -------------------------------------------------------------------------------------------------

SECTION = "spectra"
_BODY, _HEADING = ("forward", "right", "down"), ("forward", "right", "down")
_ROLES = ("nav", "truth", "green", "rival")
_VIBRATION = ("rev_mps2", "rev_radps", "blade_mps2", "blade_radps")
_LEAST_SHARE = 1e-9


@dataclass(frozen=True)
class SpectrumSignal:
    """A recorded signal of some axes and its spectra.

    Attributes
    ----------
    key, title, unit, caption : str
        Of its chart; `caption` is a sentence.
    names : sequence of str
        Of the axes.
    spectra : sequence of Spectrum
    """

    key: str
    title: str
    unit: str
    caption: str
    names: Sequence[str]
    spectra: Sequence[Spectrum]


@dataclass(frozen=True)
class FlightSpectra:
    """All spectra of a flight, of one stretch of it.

    Attributes
    ----------
    start_s, end_s : float
        The stretch.
    rate_hz : float
        Of the samples; 0: nothing was long enough.
    filled : int
        Samples that were not recorded.
    signals : sequence of SpectrumSignal
    """

    start_s: float
    end_s: float
    rate_hz: float
    filled: int
    signals: Sequence[SpectrumSignal]


def spectra_of(report: Report) -> FlightSpectra:
    """Spectra of the longest scored stretch, of the whole flight where nothing is scored."""
    r = report.record
    nothing = FlightSpectra(0.0, 0.0, 0.0, 0, ())
    if not len(r):
        return nothing
    whole = (float(r.time_s[0]), float(r.time_s[-1]))
    start_s, end_s = max(report.spans, key=lambda span: span[1] - span[0], default=whole)
    inside = (r.time_s >= start_s) & (r.time_s <= end_s)
    signals, rate_hz, filled = [], 0.0, 0
    for key, title, unit, caption, names, values in _recorded(report):
        made = even(r.time_s[inside], values[inside])
        if made is None:
            continue
        rate_hz, samples, filled = made
        spectra = [spectrum(column, rate_hz) for column in samples.T]
        signals.append(SpectrumSignal(key, title, unit, caption, names, spectra))
    return FlightSpectra(start_s, end_s, rate_hz, filled, signals) if signals else nothing


def _recorded(report: Report) -> list[tuple[str, str, str, str, Sequence[str], Array]]:
    """Key, title, unit, a sentence, axes and values (N, k) of each signal."""
    r, source = report.record, "truth" if report.has_truth else "navigation"
    signals: list[tuple[str, str, str, str, Sequence[str], Array]] = []
    if r.imu is not None:
        how = "as the IMU measured them, body axes"
        signals += [
            ("spectrum_force", "Specific force", "m/s²", f"Specific forces {how}.", _BODY,
             r.imu[:, IMU.force]),
            ("spectrum_rate", "Rates", "rad/s", f"Rates {how}.", ("p", "q", "r"),
             r.imu[:, IMU.rate]),
        ]  # fmt: skip
    names = ("lateral", "longitudinal", "pedal", "collective")
    caption = "Commands to the servos, of (-1, 1)."
    signals.append(("spectrum_actuators", "Actuators", "", caption, names, r.u))
    command = np.unwrap(r.setpoint, axis=0)
    angle = np.unwrap(np.radians(report.euler_deg(source)), axis=0)
    error = np.degrees(angle - command)
    caption = f"Attitude ({SOURCE_NAMES[source]}) less its command."
    signals.append(("spectrum_attitude", "Attitude", "°", caption, AXES, error))
    if report.kind != "attitude":
        place = r.truth_pos_ned_m if source == "truth" else r.nav_pos_ned_m
        heading = r.reference[:, REFERENCE.psi]
        away = heading_frame(place - r.reference[:, REFERENCE.pos], heading)
        caption = f"Position ({SOURCE_NAMES[source]}) less its reference, in the heading frame."
        signals.append(("spectrum_position", "Position", "m", caption, _HEADING, away))
    return signals


def rotor_lines(report: Report) -> list[tuple[float, str]]:
    """Frequencies, Hz, at which the rotor shakes the IMU in the simulation, and in words."""
    plant = report.settings.nodes["plant"]
    shaken = [np.any(plant[f"sensors.imu.vibration.{name}"]) for name in _VIBRATION]
    if plant["linear_model"] or not any(shaken):  # a linear aircraft has no rotor that turns
        return []
    aircraft = PlantConfig.from_parameters(plant).helicopter
    turns_hz = aircraft.main_speed_radps / (2.0 * np.pi)
    orders = [(1.0, any(shaken[:2])), (float(aircraft.main_blades), any(shaken[2:]))]
    return [
        (order * turns_hz, f"{order:g} per revolution, {order * turns_hz:.1f} Hz")
        for order, on in orders
        if on
    ]


def spectrum_charts(
    report: Report, spectra: FlightSpectra, design: DesignNumbers | None
) -> list[Chart]:
    """A chart of each signal."""
    if not spectra.signals:
        return []
    stretch = f"{spectra.start_s:g} to {spectra.end_s:g} s"
    return [_chart(report, spectra, signal, design, stretch) for signal in spectra.signals]


def _chart(
    report: Report,
    spectra: FlightSpectra,
    signal: SpectrumSignal,
    design: DesignNumbers | None,
    stretch: str,
) -> Chart:
    lines = [
        Trace(s.hertz, s.density, name, role, width=1.2)
        for s, name, role in zip(signal.spectra, signal.names, _ROLES, strict=False)
    ]
    (top, bottom), drawn = _reach(signal.spectra), ""
    if signal.key in ("spectrum_force", "spectrum_rate"):
        for hertz, words in rotor_lines(report):
            folded_hz = folded(hertz, spectra.rate_hz)
            more = f", seen at {folded_hz:.1f} Hz" if abs(folded_hz - hertz) > 0.05 else ""
            lines.append(_at(folded_hz, f"{words}{more}", "muted", "dot", (bottom, top)))
    designed = _designed(signal, design)
    if designed:
        for axis, numbers in enumerate(designed):
            role = _ROLES[axis]
            for radps, what, kind in (
                (numbers.rejection_radps, "DRB", "dash"),
                (numbers.crossover_radps, "crossover", "dot"),
            ):
                if radps is not None:
                    lines.append(_at(radps / (2.0 * np.pi), what, role, kind, (bottom, top)))
        drawn = "; dashed: disturbance rejection bandwidth (DRB), dotted: crossover, as designed"
    rms = ", ".join(
        f"{name} {s.rms:.3g}" for name, s in zip(signal.names, signal.spectra, strict=True)
    )
    unit = f"({signal.unit})²/Hz" if signal.unit else "1/Hz"
    rms_unit = f" {signal.unit}".rstrip()
    filled = f" {spectra.filled} samples were not recorded." if spectra.filled else ""
    return Chart(
        signal.key,
        f"{signal.title}: power spectral density",
        f"{signal.caption} {stretch}; rms about the mean: {rms}{rms_unit}{drawn}.{filled}",
        [Panel("density", unit, lines, 1.6, y_range=(bottom, top), log_y=True)],
        SECTION,
        x_quantity="frequency",
        x_unit="Hz",
        time=False,
        log_x=True,
    )


def _designed(signal: SpectrumSignal, design: DesignNumbers | None) -> Sequence[LoopNumbers]:
    """What the design says of the axes of a signal."""
    if design is None:
        return ()
    known: dict[str, Sequence[LoopNumbers]]
    known = {"spectrum_attitude": design.axes, "spectrum_position": design.position}
    return known.get(signal.key, ())


def _at(hertz: float, label: str, role: str, kind: str, ends: tuple[float, float]) -> Trace:
    """A vertical line."""
    return Trace(np.full(2, hertz), np.array(ends), label, role, kind, width=1.3)


def _reach(spectra: Sequence[Spectrum]) -> tuple[float, float]:
    """Top and bottom of the axis: at most nine decades, as what is constant has no density."""
    top = max(float(s.density.max()) for s in spectra)
    if top <= 0.0:
        return 1.0, _LEAST_SHARE
    lowest = min(float(s.density[s.density > 0.0].min(initial=top)) for s in spectra)
    return 2.0 * top, max(0.5 * lowest, _LEAST_SHARE * top)


def spectrum_table(spectra: FlightSpectra) -> ReportTable | None:
    """Numbers of each signal's spectrum; None without any."""
    if not spectra.signals:
        return None
    rows = []
    for signal in spectra.signals:
        unit = f", {signal.unit}" if signal.unit else ""
        for name, s in zip(signal.names, signal.spectra, strict=True):
            peak = float(s.hertz[int(np.argmax(s.density))])
            rows.append(
                [
                    f"{signal.title.lower()}, {name}{unit}", f"{s.rms:.3g}", f"{s.area_rms:.3g}",
                    f"{s.median_hz:.2f}", f"{peak:.2f}", f"{100.0 * s.below(1.0):.0f} %",
                ]
            )  # fmt: skip
    first = spectra.signals[0].spectra[0]
    windows = max(1, round(2.0 * (spectra.end_s - spectra.start_s) * first.step_hz) - 1)
    caption = (
        f"Welch's method over {spectra.start_s:g} to {spectra.end_s:g} s, "
        f"{spectra.rate_hz:.0f} samples a second, {windows} windows of "
        f"{1.0 / first.step_hz:.1f} s (Hann, overlapping by half, "
        "without their means), one-sided: the area below a density is the variance. Both rms must "
        "agree but for what is slower than a window."
    )
    head = ("", "rms", "root of the area", "half below, Hz", "largest at, Hz", "below 1 Hz")
    return ReportTable(head, rows, caption)


def _radps(radps: float | None) -> str | Markup:
    if radps is None:
        return "not reached"
    return Markup("{:.2f} <small>({:.2f} Hz)</small>").format(radps, radps / (2.0 * np.pi))


def _peak(numbers: LoopNumbers) -> Markup:
    template = Markup("{:.1f} dB <small>at {:.1f} rad/s</small>")
    return template.format(numbers.peak_db, numbers.peak_radps)


def loop_tables(design: DesignNumbers) -> list[ReportTable]:
    """Disturbance rejection, crossover and bandwidth of the loops as designed."""
    tables = [_attitude_table(design)] if design.axes else []
    return [*tables, *([_position_table(design)] if design.position else [])]


def _position_table(design: DesignNumbers) -> ReportTable:
    rows = [
        ["disturbance rejection bandwidth (DRB), rad/s",
         *(_radps(axis.rejection_radps) for axis in design.position)],
        ["peak of disturbance rejection (DRP)", *map(_peak, design.position)],
        ["crossover, broken at the commanded acceleration, rad/s",
         *(_radps(axis.crossover_radps) for axis in design.position)],
    ]  # fmt: skip
    caption = (
        "The position loop around it, each axis alone, about the trim in the mean wind: what it "
        "takes off a displacement that the aircraft is pushed by."
    )
    return ReportTable(("", *_HEADING), rows, caption)


def _attitude_table(design: DesignNumbers) -> ReportTable:
    head = ("", *AXES)
    axes = design.axes
    kinds = {
        "disturbance rejection bandwidth (DRB), rad/s": [a.rejection_radps for a in axes],
        "crossover, broken at the actuator, rad/s": [a.crossover_radps for a in axes],
        "bandwidth of attitude to command, by phase, rad/s": [
            a.phase_bandwidth_radps for a in axes
        ],
        "the same by gain, rad/s": [a.gain_bandwidth_radps for a in axes],
    }
    rows = [[name, *map(_radps, values)] for name, values in kinds.items()]
    rows.insert(1, ["peak of disturbance rejection (DRP)", *map(_peak, axes)])
    caption = (
        "The attitude loop as designed and as it is flown (sampled, with servos and delay), by its "
        "linear model: below the DRB it takes more than 3 dB off a disturbance of the attitude, at "
        "the DRP it adds most. Bandwidths: ADS-33E, -135° and 6 dB. Computed, beside the measured "
        "spectra."
    )
    return ReportTable(head, rows, caption)
