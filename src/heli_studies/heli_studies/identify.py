# SPDX-License-Identifier: Apache-2.0
"""`heli identify`: fly two experiments or take their bags, fit, design, compare, report, fly."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from heli_analysis.identification.actuators import (
    SIGNIFICANT_SHARE,
    IdentifiedAB,
    IdentifiedCollective,
    IdentifiedE,
    IdentifiedTrim,
    RotorGeometry,
    effect_shares,
    fit_actuators,
    fit_collective,
    fit_gusts,
    identified_system,
    refit_actuators,
    relative_air_w,
    trim_of,
)
from heli_analysis.identification.model import FAST, FastModel
from heli_analysis.identification.output_error import MethodAgreement, refine
from heli_analysis.identification.spectra import Array, Experiment, spectra_of
from heli_analysis.identification.structure import AIR, FULL, N_FAST, ModelStructure, Rotor, at_once
from heli_bags.reader import Bag, Stream, read_bag
from heli_bags.writer import BagError
from heli_core.command_line import config_folder
from heli_core.coverage import Coverage, coverage_of
from heli_core.errors import BrokenFlightError
from heli_core.parameters import Parameter, load
from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import euler_angles, quat_to_R_nb
from heli_core.rows import (
    ACTUATOR,
    ACTUATOR_NAMES,
    IMU,
    INPUT_NAMES,
    NAV,
    NINE,
    STATE_NAMES,
    WIND_NAMES,
)
from heli_core.ticks import NS_PER_S, TICK_NS, TICK_S, TICKS_PER_S, seconds, stamp_at, ticks_in
from heli_flight.flight_file import NAME, write_parameters
from heli_flight.fly import FlightOrder, fly_and_write, tell_if_it_compiles
from heli_flight.layers import LOCKSTEP, ONE_PROCESS
from heli_flight.record import FlightRecord
from heli_flight.result import versions
from heli_flight.settings import Settings, resolve
from heli_flight.terminal import console, silent, steps
from heli_flight.terminal import table as text_table
from heli_flight.worlds import PAPER
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.loops import Loop, sampled_plant
from heli_inner_hinf.mu import peak_gain
from heli_msgs_bridge import topics
from heli_studies.design.make import Basis, FinishedDesign, aircraft_basis, design_of
from heli_studies.identify_methods import (
    Method,
    agreement_as_dict,
    print_agreement,
    print_structure,
    structure_as_dict,
)

# -------------------------------------------------------------------------------------------------
# What `heli identify` takes as given; values stand in config/identify/<aircraft>.yaml.
# -------------------------------------------------------------------------------------------------

NODE_NAME = "identify"


def _row(name: str, description: str, unit: str, upper: float) -> Parameter:
    return Parameter(name, "double", description, unit, lower=0.0, upper=upper, lower_open=True)


TABLE: tuple[Parameter, ...] = (
    _row("mass", "Mass", "kg", 2e4),
    _row("gravity", "Local gravity", "m/s2", 20.0),
    _row("rotor.rho", "Air density", "kg/m3", 3.0),
    _row("rotor.omega", "Rotor speed", "rad/s", 1e3),
    _row("rotor.radius", "Rotor radius", "m", 20.0),
    Parameter("rotor.blades", "int", "Number of blades", lower=1, upper=12),
    _row("rotor.chord", "Blade chord", "m", 2.0),
    _row("rotor.lift_slope", "Lift slope of a blade section", "1/rad", 10.0),
    _row("period_s", "Period of the excitation", "s", 600.0),
    Parameter("periods", "int", "Periods that are evaluated", lower=4, upper=1000),
    Parameter("start_s", "double", "Flight time of the first of them", "s", lower=0.0, upper=1e5),
)
MEASURED = tuple(row.name for row in TABLE if row.name.startswith(("mass", "gravity", "rotor.")))
"""Names of the constants that are measured on the ground."""


@dataclass(frozen=True)
class IdentificationInputs:
    """Constants from the ground, and how the experiments are to be read.

    Attributes
    ----------
    ground : mapping
        mass, gravity, rotor.* by name, SI.
    period_s, start_s : float
    periods : int
    source : str
        File, for people.
    """

    ground: Mapping[str, Any]
    period_s: float
    start_s: float
    periods: int
    source: str

    @property
    def end_s(self) -> float:
        """Flight time of the end of the last evaluated period."""
        return self.start_s + self.periods * self.period_s


def read_given(aircraft: str, params: Sequence[Path]) -> IdentificationInputs:
    """The packaged values of an aircraft under the user's files.

    Parameters
    ----------
    aircraft : str
        Aircraft file or bare name; one that has no packaged values takes those of helion, and the
        user's files must then say what differs.
    params : sequence of path
        rcl parameter files; sections of other nodes are passed over.

    Raises
    ------
    ParameterError
    """
    folder = config_folder("heli_flight") / "identify"
    file = folder / f"{Path(aircraft).stem}.yaml"
    if not file.is_file():
        file = folder / "helion.yaml"
    values = load(TABLE, [file, *params], NODE_NAME)
    ticks = values["period_s"] * TICKS_PER_S
    if abs(ticks - round(ticks)) > 1e-6:
        raise ParameterError(
            f"identify: period_s: {values['period_s']:g} is not allowed; allowed: a multiple of "
            f"{TICK_S:g} s, the tick"
        )
    ground = {name: values[name] for name in MEASURED}
    return IdentificationInputs(
        ground, values["period_s"], values["start_s"], values["periods"], file.name
    )


# -------------------------------------------------------------------------------------------------
# From a bag or a flight's record to the experiment that the fits take; what a bag lacks is named.
#
# Only topics that a real aircraft has are read: navigation, inertial sensors, actuators and the
# excitation. Ground truth is never touched.
# -------------------------------------------------------------------------------------------------

EXCITATION = {"actuators": topics.EXCITATION_ACTUATORS, "gusts": topics.EXCITATION_WIND}
"""Topic that makes a bag one of an experiment."""
_COMMON = (topics.ODOM, topics.IMU, topics.ACTUATORS)
_CHANNELS = {
    "actuators": ACTUATOR_NAMES,
    "gusts": WIND_NAMES,
}
_SENDERS = {
    "actuators": "inner_loop sends it only while its excitation.* is configured",
    "gusts": "plant sends it only while its wind.sines.* is configured",
}
_SMALLEST = 1e-9
_ALL_NEEDED = "every sample of the evaluated periods is needed"


class BagDataError(ValueError):
    """A bag that cannot be identified from; one sentence with the topic and the reason.

    Attributes
    ----------
    coverage : Coverage or None
        What of the evaluated periods is recorded, where that is the reason.
    """

    def __init__(self, sentence: str, coverage: Coverage | None = None) -> None:
        super().__init__(sentence)
        self.coverage = coverage


def evaluated(time_s: NDArray[np.float64], a_priori: IdentificationInputs) -> Coverage:
    """What of the evaluated periods is recorded at times (N,), s: a fit needs every sample."""
    return coverage_of(time_s, [(a_priori.start_s, a_priori.end_s)], few=0)


def experiment_of_record(record: FlightRecord, a_priori: IdentificationInputs) -> Experiment:
    """Experiment out of the one-process loop's record.

    Raises
    ------
    BagDataError
        Nothing was excited in that flight, the excitation was given up, or the flight ended within
        the evaluated periods.
    """
    if record.excitation_u is None or record.gust_ned_mps is None or record.imu is None:
        raise BagDataError(
            "the flight was not excited: neither excitation.* nor wind.sines.* is on"
        )
    held = evaluated(record.time_s, a_priori)
    if not held.is_whole:
        raise BagDataError(f"the flight's record: {held.sentence}: {_ALL_NEEDED}", held)
    sent_s = record.time_s[np.any(record.excitation_u != 0.0, axis=1)]
    if sent_s.size and sent_s[-1] < a_priori.end_s - TICK_S:
        raise BagDataError(
            f"the excitation was given up at {sent_s[-1]:.2f} s: roll or pitch left "
            "excitation.attitude_limit_deg, or an actuator stood at its limit; lower "
            "excitation.amplitude, or the gains of the position loop"
        )
    return _data_experiment(
        record.time_s,
        record.nav_vel_ned_mps,
        record.nav_q_nb,
        record.imu,
        record.u,
        record.excitation_u,
        record.gust_ned_mps,
        a_priori,
    )


def experiment_of_bag(
    path: Path,
    kind: str,
    a_priori: IdentificationInputs,
    start_time_s: float,
    flight: int | None = None,
) -> Experiment:
    """Experiment out of a bag.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or a flight's folder with one in `bag`.
    kind : str
        "actuators" or "gusts".
    a_priori : Given
    start_time_s : float
        Stamp of flight time 0.
    flight : int, optional
        Which flight of a bag whose clock goes back, from 1 on.

    Raises
    ------
    BagDataError
        No bag, one of several flights of which none is named, a topic is missing, its messages
        cannot be used, it is too short, has gaps, or nothing is excited.
    """
    folder = path / "bag" if (path / "bag").is_dir() else path
    try:
        bag = read_bag(folder, flight=flight)
    except BagError as error:
        raise BagDataError(str(error)) from error
    if bag.flights > 1 and flight is None:
        held = f"its clock goes back: it holds {bag.flights} flights"
        raise BagDataError(f"{path}: {held}; --flight N names the one that is meant")
    excitation = EXCITATION[kind]
    needed = (*_COMMON, excitation)
    start_ns = stamp_at(start_time_s)
    first, count = ticks_in(a_priori.start_s), ticks_in(a_priori.periods * a_priori.period_s)
    ticks = np.arange(first, first + count)
    rows = {name: _rows(bag, name, kind, path, start_ns, ticks) for name in needed}
    _refuse_silence(rows[excitation], kind, path, bag)
    nav = rows[topics.ODOM]
    added = rows[excitation] if kind == "actuators" else np.zeros((count, ACTUATOR.size))
    gust = rows[excitation] if kind == "gusts" else np.zeros((count, 3))
    return _data_experiment(
        np.asarray(ticks * TICK_S, np.float64),
        nav[:, NAV.vel],
        nav[:, NAV.quat],
        rows[topics.IMU],
        rows[topics.ACTUATORS],
        added,
        gust,
        a_priori,
    )


def _rows(
    bag: Bag, name: str, kind: str, path: Path, start_ns: int, ticks: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Rows of a topic at the ticks, all of them."""
    stream = bag.streams.get(name)
    if name in bag.refused:
        raise BagDataError(
            f"{path}: '{name}': {bag.refused[name]} messages cannot be used: "
            f"{bag.reasons.get(name, 'unreadable')}"
        )
    if stream is None or not stream.stamp_ns.size:
        hint = f" ({_SENDERS[kind]})" if name == EXCITATION[kind] else ""
        raise BagDataError(f"{path}: no message on '{name}'{hint}")
    known = _ticks_of(stream, name, path, start_ns)
    held = coverage_of(known * TICK_S, [(ticks[0] * TICK_S, (ticks[-1] + 1) * TICK_S)], few=0)
    if not held.is_whole:
        raise BagDataError(f"{path}: '{name}': {held.sentence}: {_ALL_NEEDED}", held)
    return stream.rows[np.searchsorted(known, ticks)]


def _ticks_of(stream: Stream, name: str, path: Path, start_ns: int) -> NDArray[np.int64]:
    ticks, rest = np.divmod(stream.stamp_ns - start_ns, TICK_NS)
    if np.any(rest != 0):
        raise BagDataError(
            f"{path}: '{name}': stamps are not whole multiples of 10 ms after start_time_s = "
            f"{start_ns / NS_PER_S:g} s"
        )
    return ticks


def _refuse_silence(rows: NDArray[np.float64], kind: str, path: Path, bag: Bag) -> None:
    """Every channel must be excited; if it was given up in flight, say why."""
    topic = EXCITATION[kind]
    for remark in bag.remarks:
        if remark.node == "inner_loop" and "excitation was given up" in remark.message:
            raise BagDataError(f"{path}: '{topic}': {remark.message}")
    for name, strength in zip(_CHANNELS[kind], rows.std(axis=0), strict=True):
        if strength < _SMALLEST:
            raise BagDataError(f"{path}: '{topic}': {name} is not excited in the evaluated periods")


def _data_experiment(
    time_s: NDArray[np.float64],
    vel_ned_mps: NDArray[np.float64],
    q_nb: NDArray[np.float64],
    imu: NDArray[np.float64],
    u: NDArray[np.float64],
    excitation_u: NDArray[np.float64],
    gust_ned_mps: NDArray[np.float64],
    a_priori: IdentificationInputs,
) -> Experiment:
    """Velocities into body axes of the navigation's own attitude."""
    R_nb = np.array([quat_to_R_nb(np.ascontiguousarray(q)) for q in q_nb])
    attitude = euler_angles(q_nb)
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return Experiment(
        time_s=time_s,
        u=u,
        excitation_u=excitation_u,
        attitude_rad=attitude,
        rate_body_radps=imu[:, IMU.rate],
        vel_body_mps=np.einsum("nji,nj->ni", R_nb, vel_ned_mps),
        accel_body_mps2=imu[:, IMU.force],
        gust_body_mps=np.einsum("nji,nj->ni", R_nb, gust_ned_mps),
        period_s=a_priori.period_s,
        start_s=a_priori.start_s,
        periods=a_priori.periods,
    )


# -------------------------------------------------------------------------------------------------
# From two experiments to a design: fits, then observer and controllers from identified numbers
# only.
#
# No aircraft file is read here. What comes from elsewhere than flight are the constants of
# `IdentificationInputs`,
# measured on the ground, and the weights and gamma that the user chooses.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Identification:
    """What the experiments tell, and the design made from it.

    Attributes
    ----------
    actuators, gusts : Experiment
    ab, wind, trim, collective : IdentifiedAB, IdentifiedE, IdentifiedTrim, IdentifiedCollective
    a_priori : Given
    design : FinishedDesign
    agreement : tuple of MethodAgreement
        Each entry by both methods; empty where only the frequency domain was asked for.
    """

    actuators: Experiment
    gusts: Experiment
    ab: IdentifiedAB
    wind: IdentifiedE
    trim: IdentifiedTrim
    collective: IdentifiedCollective
    a_priori: IdentificationInputs
    design: FinishedDesign
    agreement: tuple[MethodAgreement, ...] = ()


def identify(
    actuators: Experiment,
    gusts: Experiment,
    a_priori: IdentificationInputs,
    settings: Settings,
    gamma_factor: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
    method: Method = Method.FREQUENCY,
    structure: ModelStructure = FULL,
) -> Identification:
    """Fit A, B, servos and delay, then E, trim and collective; design from them.

    Parameters
    ----------
    actuators, gusts : Experiment
    a_priori : Given
        Constants from the ground.
    settings : Settings
        Weights and gamma of the inner loop; its model and trims are not used.
    gamma_factor : float, optional
        gamma as a multiple of gamma*, instead.
    progress : callable
        Told what comes next, a few words.
    method : Method
        By which A, B and servos are found in the end.
    structure : ModelStructure
        Which states the model has.

    Raises
    ------
    IdentificationError
        A fit is refused; its sentence says why.
    SynthesisError
        No controller exists for the identified model and gamma.
    """
    progress("A, B, servos, delay")
    ab = fit_actuators(actuators, structure=structure)
    ground = a_priori.ground
    rotor = RotorGeometry(
        **{name: ground[f"rotor.{name}"] for name in RotorGeometry.__annotations__}
    )
    progress("collective")
    collective = fit_collective(actuators, ab, ground["mass"], ground["gravity"], rotor)
    progress("E")
    air_w_mps = relative_air_w(gusts, ab, collective)
    wind = fit_gusts(gusts, ab, air_w_mps=air_w_mps)
    mean = wind.E.copy()
    mean[NINE.r, AIR.w] = wind.E_rw["mean"]
    ab = refit_actuators(actuators, ab, mean)
    agreement: tuple[MethodAgreement, ...] = ()
    if method is Method.OUTPUT_ERROR:
        ab, _, agreement = refine(actuators, ab)
    trim = trim_of([actuators, gusts], ab)
    wind = fit_gusts(gusts, ab, air_w_mps=air_w_mps)
    progress("design")
    basis = basis_of(ab, wind, trim, collective, a_priori)
    design = design_of(basis, settings, gamma_factor=gamma_factor)
    return Identification(actuators, gusts, ab, wind, trim, collective, a_priori, design, agreement)


def basis_of(
    ab: IdentifiedAB,
    wind: IdentifiedE,
    trim: IdentifiedTrim,
    collective: IdentifiedCollective,
    a_priori: IdentificationInputs,
) -> Basis:
    """What `design_of` starts from, in identified numbers."""
    return Basis(
        source="identified in flight",
        system=identified_system(ab, wind),
        x_trim=trim.x,
        u_trim=trim.u,
        actuation=Actuation(ab.servo_radps, ab.servo_damping, ab.delay_ticks * TICK_S),
        outer={**a_priori.ground, "rotor.K_col": collective.K_col},
        plant={},
        residual=float("nan"),
    )


# -------------------------------------------------------------------------------------------------
# Identified numbers beside the linearised truth: for checking the method in simulation only.
#
# An entry is significant if its effect, |true entry| times the rms over the excited lines of the
# state or input that it multiplies, is above 1 % of the largest such effect in its row. Targets: 5
# %
# for A, B and servos, 10 % for E, 5 % for the closed loop's norm.
# -------------------------------------------------------------------------------------------------

TARGETS = {"A": 0.05, "B": 0.05, "E": 0.10, "": 0.05, "norm": 0.05}
WIND_COLUMNS = ("u", "v", "w")
_DYNAMIC = range(2, 8)
# -1 by definition: they give a_s, b_s and d_int their scale.
_FIXED = ("A(a_s,q)", "A(b_s,p)", "A(d_int,r)")
_COLUMNS = {"A": STATE_NAMES, "B": INPUT_NAMES, "E": WIND_COLUMNS}


@dataclass(frozen=True)
class ComparisonRow:
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
    design: FinishedDesign

    def matrices(self, structure: ModelStructure) -> tuple[Array, Array, Array]:
        """A (9, 9), B (9, 3), E (9, 3) as that rotor has them; a yaw gyro stays where it is."""
        A, B, E = self.basis.A.copy(), self.basis.B.copy(), self.basis.E.copy()
        if structure.rotor is Rotor.QUASI_STATIC:
            A[FAST, FAST], B[FAST], E[FAST] = at_once(A[FAST, FAST], B[FAST], E[FAST])
        return A, B, E


def truth_of(settings: Settings, aircraft: str | None, gamma: float | None) -> Truth:
    """Trim, linearise and design the aircraft file: the yardstick, never an input.

    `gamma`: the bound of the controller that flies; None: its parameter.
    """
    basis = aircraft_basis(settings, aircraft)
    return Truth(basis, design_of(basis, settings, gamma=gamma))


def table(identification: Identification, truth: Truth | None) -> list[ComparisonRow]:
    """Every identified number beside the truth."""
    return [
        *_matrix_rows(identification, truth),
        *_scalar_rows(identification, truth),
        *(_norm_rows(identification.design, truth) if truth is not None else ()),
    ]


def _matrix_rows(identification: Identification, truth: Truth | None) -> list[ComparisonRow]:
    ab, wind = identification.ab, identification.wind
    parts = (
        ("A", ab.A, ab.A_sigma, truth.matrices(ab.structure)[0] if truth else None),
        ("B", ab.B, ab.B_sigma, truth.matrices(ab.structure)[1] if truth else None),
        ("E", wind.E, wind.E_sigma, truth.matrices(ab.structure)[2] if truth else None),
    )
    dynamic = [_DYNAMIC[i] for i in range(N_FAST) if i not in ab.structure.absent]
    share = shares(identification, truth)
    rows = []
    for group, matrix, sigma, true in parts:
        for i in dynamic:
            for j, column in enumerate(_COLUMNS[group]):
                name = f"{group}({STATE_NAMES[i]},{column})"
                known = float("nan") if true is None else float(true[i, j])
                if matrix[i, j] == 0.0 and (np.isnan(known) or abs(known) < 1e-9):
                    continue
                if name in _FIXED:
                    continue
                rows.append(
                    ComparisonRow(group, name, float(matrix[i, j]), float(sigma[i, j]), known,
                        share.get(name, 0.0), TARGETS[group])
                )  # fmt: skip
    return rows


def fast_of(basis: Basis, matrices: tuple[Array, Array, Array] | None = None) -> FastModel:
    """A basis as the fits describe an aircraft (no kink, no collective); matrices: in place."""
    A9, B9, E9 = matrices or (basis.A, basis.B, basis.E)
    B, E = np.zeros((N_FAST, ACTUATOR.size)), np.zeros((N_FAST, AIR.size))
    B[:, ACTUATOR.attitude], E[:, AIR.velocity] = B9[FAST], E9[FAST]
    at = basis.actuation
    return FastModel(A9[FAST, FAST], B, E, at.servo_radps, at.servo_damping, at.delay_s)


def shares(identification: Identification, truth: Truth | None) -> dict[str, float]:
    """Share of each entry in its row: of A and B in the first experiment, of E in the second.

    Of the true entries where they are known, so that neither an entry that was lost nor one that is
    nothing but error decides by itself whether it counts; else of the identified ones.
    """
    structure = identification.ab.structure
    model = (
        fast_of(truth.basis, truth.matrices(structure))
        if truth is not None
        else fast_of(identification.design.basis)
    )
    rows = [STATE_NAMES[i] for i in _DYNAMIC]
    result: dict[str, float] = {}
    for groups, experiment in (
        (("A", "B"), identification.actuators),
        (("E",), identification.gusts),
    ):
        names = tuple(
            f"{group}({row},{column})"
            for group in groups
            for row in (rows if group != "E" else ("p", "q", "r"))
            for column in _COLUMNS[group]
            if column not in ("phi", "theta", "psi")
        )
        result |= effect_shares(model, spectra_of(experiment), names)
    return result


def _scalar_rows(identification: Identification, truth: Truth | None) -> list[ComparisonRow]:
    ab, trim, basis = identification.ab, identification.trim, truth.basis if truth else None
    nan = float("nan")
    actuation = basis.actuation if basis else None
    rows = [
        ComparisonRow("", "servo frequency, rad/s", ab.servo_radps, ab.servo_radps_sigma,
            actuation.servo_radps if actuation else nan, nan, TARGETS[""]),
        ComparisonRow("", "servo damping", ab.servo_damping, ab.servo_damping_sigma,
            actuation.servo_damping if actuation else nan, nan, TARGETS[""]),
        ComparisonRow("", "delay, s", ab.delay_s, ab.delay_s_sigma,
            actuation.delay_s if actuation else nan, nan, nan),
        ComparisonRow("", "K_col, rad", identification.collective.K_col,
            identification.collective.K_col_sigma,
            basis.outer["rotor.K_col"] if basis else nan, nan, nan),
    ]  # fmt: skip
    absent = [_DYNAMIC[i] for i in ab.structure.absent]
    for i in (place for place in (0, 1, 4, 5) if place not in absent):
        true = float(basis.x_trim[i]) if basis else nan
        rows.append(
            ComparisonRow("", f"trim {STATE_NAMES[i]}, rad", float(trim.x[i]),
                          float(trim.x_sigma[i]), true, nan, nan)
        )  # fmt: skip
    for i, name in enumerate((*INPUT_NAMES, "d_col")):
        true = float(basis.u_trim[i]) if basis else nan
        rows.append(
            ComparisonRow(
                "", f"trim {name}", float(trim.u[i]), float(trim.u_sigma[i]), true, nan, nan
            )
        )
    return rows


def _norm_rows(design: FinishedDesign, truth: Truth) -> list[ComparisonRow]:
    """Norms wind -> h: design against design, and the identified one on the true aircraft."""
    nan = float("nan")
    rows = [
        ComparisonRow(
            "norm", f"norm, {mine.name}", mine.norm, nan, theirs.norm, nan, TARGETS["norm"]
        )
        for mine, theirs in zip(design.reports, truth.design.reports, strict=True)
    ]
    flown = peak_gain(flown_on(design, truth.basis).wind_to_h)[0]
    return [
        *rows,
        ComparisonRow("norm", "norm, identified design, true aircraft, as flown", float(flown),
            nan, truth.design.reports[-1].norm, nan, TARGETS["norm"]),
    ]  # fmt: skip


def flown_on(design: FinishedDesign, basis: Basis) -> Loop:
    """The design's loop as flown with the plant of another basis, judged by the same C and D."""
    model = replace(design.model, A=basis.A, B=basis.B, E=basis.E)
    return replace(design.loops[-1], plant=sampled_plant(model, basis.actuation))


def misses(rows: Sequence[ComparisonRow]) -> list[ComparisonRow]:
    """Significant numbers that miss their target."""
    return [row for row in rows if row.met is False]


# -------------------------------------------------------------------------------------------------
# Command.
# -------------------------------------------------------------------------------------------------

SCENARIOS = {"actuators": "identify_actuators", "gusts": "identify_gusts"}
YAML, JSON, HOVER = "identified.yaml", "identification.json", "hover"
_STEPS = 5


@dataclass(frozen=True)
class IdentifyOrder:
    """What the user asks for.

    Attributes
    ----------
    actuators, gusts : Path or None
        Bags; None: fly.
    aircraft : str or None
        Aircraft file that is flown and compared with.
    params : sequence of Path
    seed : int or None
    gps : str or None
    gamma_factor : float or None
    one_process : bool
    quiet : bool
        Whether nothing is told of its progress.
    flight : int or None
        Which flight of a bag whose clock goes back, from 1 on; None: of such a bag it is asked.
    method : Method
        Of the fit of A, B and servos.
    structure : ModelStructure
        Which states the model has.
    """

    actuators: Path | None = None
    gusts: Path | None = None
    aircraft: str | None = None
    params: Sequence[Path] = ()
    seed: int | None = None
    gps: str | None = None
    gamma_factor: float | None = None
    one_process: bool = False
    quiet: bool = False
    flight: int | None = None
    method: Method = Method.FREQUENCY
    structure: ModelStructure = FULL

    def progress(self, what: str, total: int) -> AbstractContextManager[Callable[[float], None]]:
        """Progress on stderr, or none."""
        return nullcontext(lambda done: None) if self.quiet else steps(what, total)

    @property
    def from_bags(self) -> bool:
        """Whether bags are given."""
        return self.actuators is not None


@dataclass(frozen=True)
class IdentifyOutcome:
    """What was found.

    Attributes
    ----------
    identification : Identification
    truth : Truth or None
        None where the aircraft file is not known.
    rows : sequence of ComparisonRow
    settings : Settings
        Of the first experiment.
    """

    identification: Identification
    truth: Truth | None
    rows: Sequence[ComparisonRow]
    settings: Settings

    @property
    def zeros(self) -> tuple[str, ...]:
        """Entries of A and B that the flight does not tell from zero; E has its own."""
        return tuple(n for n in self.identification.ab.taken_for_zero if not n.startswith("E"))


def layers(wanted: IdentifyOrder) -> list[Path]:
    """Parameter files under which an aircraft flies before it is identified, weakest first.

    A packaged aircraft other than the default has a packaged design; its PID flies the experiments.
    """
    files = list(wanted.params)
    if wanted.aircraft is not None:
        name = f"{Path(wanted.aircraft).stem}.yaml"
        design = config_folder("heli_flight") / "designs" / name
        if design.is_file():
            files.insert(0, design)
    return files


def settings_of(wanted: IdentifyOrder, kind: str) -> Settings:
    """Parameters of an experiment."""
    overrides = {"plant": {"aircraft_file": wanted.aircraft}} if wanted.aircraft else None
    mode = ONE_PROCESS if wanted.one_process else LOCKSTEP
    params = layers(wanted)
    if len(params) > len(wanted.params):
        # above the design, whose position loop is not made for the experiments' PID
        params.insert(1, config_folder("heli_flight") / "identify" / "position_loop.yaml")
    return resolve(SCENARIOS[kind], wanted.gps, wanted.seed, None, mode, params, overrides)


def _with_the_law_to_fly(settings: Settings, wanted: IdentifyOrder) -> Settings:
    """The same with the controller that will fly what is found: the experiments' own is another."""
    inner = settings.nodes["inner_loop"]
    flies = resolve(params=layers(wanted)).nodes["inner_loop"]["controller"]
    return replace(settings, nodes={**settings.nodes, "inner_loop": {**inner, "controller": flies}})


def run(wanted: IdentifyOrder, folder: Path | None) -> IdentifyOutcome:
    """Experiments, fits, design, comparison.

    Parameters
    ----------
    wanted : IdentifyOrder
    folder : Path, optional
        Where flights through the graph leave their bags.

    Raises
    ------
    ParameterError, BagDataError, IdentificationError, SynthesisError, FlightError
        Each with one sentence; BrokenFlightError if a flight of its own came to nothing.
    """
    if (wanted.actuators is None) != (wanted.gusts is None):
        raise ParameterError("--actuators and --gusts: give both bags, or none to fly them")
    settings = _with_the_law_to_fly(settings_of(wanted, "actuators"), wanted)
    a_priori = read_given(
        wanted.aircraft or settings.nodes["plant"]["aircraft_file"], wanted.params
    )
    experiments = {
        kind: _experiment(wanted, kind, a_priori, folder) for kind in ("actuators", "gusts")
    }
    known = not wanted.from_bags or wanted.aircraft is not None
    with wanted.progress("identification", _STEPS) as progress:
        done = [0]

        def tell(_: str) -> None:
            progress(done[0])
            done[0] += 1

        identification = identify(
            experiments["actuators"], experiments["gusts"], a_priori, settings, wanted.gamma_factor,
            tell, wanted.method, wanted.structure,
        )  # fmt: skip
        bound = identification.design.attitude.bound
        gamma = bound.gamma if bound and wanted.gamma_factor is not None else None
        truth = truth_of(settings, None, gamma) if known else None
        progress(_STEPS)
    return IdentifyOutcome(identification, truth, table(identification, truth), settings)


def _experiment(
    wanted: IdentifyOrder, kind: str, a_priori: IdentificationInputs, folder: Path | None
) -> Experiment:
    settings = settings_of(wanted, kind)
    start_time_s = settings.nodes["plant"]["start_time_s"]
    bag = wanted.actuators if kind == "actuators" else wanted.gusts
    if bag is not None:
        return experiment_of_bag(bag, kind, a_priori, start_time_s, wanted.flight)
    length_s = seconds(settings.scenario.n_ticks)
    if length_s < a_priori.end_s:
        raise ParameterError(
            f"identify: periods: {a_priori.periods} of {a_priori.period_s:g} s from "
            f"{a_priori.start_s:g} s on do not fit into the scenario's duration_s = {length_s:g} s"
        )
    with wanted.progress(f"flight: {kind}, s", round(length_s)) as progress:
        if wanted.one_process or folder is None:
            return _fly_alone(settings, a_priori, lambda s: progress(int(s)), wanted.quiet)
        _fly_graph(settings, folder / kind, lambda s: progress(int(s)))
    try:
        return experiment_of_bag(folder / kind, kind, a_priori, start_time_s)
    except BagDataError as error:
        # Nothing was wrong with what the user gave.
        raise BrokenFlightError(str(error)) from error


def _fly_alone(
    settings: Settings, a_priori: IdentificationInputs, progress: Any, quiet: bool
) -> Experiment:
    from heli_flight import loop as closed_loop

    tell_if_it_compiles(silent() if quiet else console(stderr=True))
    flight = closed_loop.simulate(settings, progress=progress)
    if flight.sentence:
        raise BrokenFlightError(f"{settings.scenario_name}: {flight.sentence}")
    return experiment_of_record(flight.record, a_priori)


def _fly_graph(settings: Settings, folder: Path, progress: Any) -> None:
    from heli_flight.graph.flight import fly_graph

    folder.mkdir()
    write_parameters(settings, folder / NAME)
    result, _, _ = fly_graph(settings, folder, progress)
    if result.lost:
        raise BrokenFlightError(f"{settings.scenario_name}: {result.lost}")


def as_dict(outcome: IdentifyOutcome) -> dict[str, Any]:
    """Everything for JSON."""
    identification, a_priori = outcome.identification, outcome.identification.a_priori
    missed, bound = misses(outcome.rows), identification.design.attitude.bound
    return {
        "measured_on_the_ground": dict(a_priori.ground),
        "experiments": {
            "period_s": a_priori.period_s, "periods": a_priori.periods, "start_s": a_priori.start_s,
            "coherence": {**identification.ab.coherence, **identification.wind.coherence},
            "coverage": {
                kind: evaluated(experiment.time_s, a_priori).as_dict()
                for kind, experiment in (("actuators", identification.actuators),
                                         ("gusts", identification.gusts))
            },
        },
        "structure": structure_as_dict(identification.ab),
        "agreement": agreement_as_dict(identification.agreement),
        "taken_for_zero": list(outcome.zeros),
        "delay_ticks": identification.ab.delay_ticks,
        "E_rw": dict(identification.wind.E_rw),
        "collective": asdict(identification.collective),
        "fits": {name: {"cost": fit.cost, "expected_cost": fit.expected_cost,
                        "cost_sigma": fit.cost_sigma}
                 for name, fit in (("actuators", identification.ab.estimate),
                                   ("gusts", identification.wind.estimate))},
        "entries": [row.as_dict() for row in outcome.rows],
        "compared_with": outcome.truth.basis.source if outcome.truth else None,
        "misses": [row.name for row in missed],
        "gamma": bound and bound.gamma,
        "gamma_star": bound and bound.gamma_star.value,
        "observer": {"K": identification.design.observer.K.tolist(),
                     "poles_radps": list(identification.design.observer.poles)},
        "versions": versions(),
    }  # fmt: skip


def print_outcome(outcome: IdentifyOutcome, out: Console) -> None:
    """The table, and what to know of it."""
    known = outcome.truth is not None
    rows = text_table("Identified from flight, two sigma; significant entries", out)
    names = ["", "identified", "+-"] + (["truth", "deviation", ""] if known else [])
    for i, name in enumerate(names):
        rows.add_column(name, justify="right" if i else "left")
    for row in outcome.rows:
        if not row.significant:
            continue
        cells = [row.name, f"{row.value:.5g}", _two_sigma(row)]
        if known:
            mark = {True: "met", False: "MISSED", None: ""}[row.met]
            cells += [f"{row.truth:.5g}", row.deviation_text, mark]
        rows.add_row(*cells)
    out.print(rows)
    print_structure(outcome.identification.ab, out)
    if outcome.identification.agreement:
        print_agreement(outcome.identification.agreement, out)
    if outcome.zeros:
        zero = ", ".join(outcome.zeros)
        out.print(f"not told from zero: {zero}", soft_wrap=True)
    if known:
        judged = [row for row in outcome.rows if row.met is not None]
        missed = misses(outcome.rows)
        out.print(
            f"targets (A, B, servos, norms 5 %, E 10 %): {len(judged) - len(missed)} of "
            f"{len(judged)} met" + "".join(f"; {row.name} missed" for row in missed),
            soft_wrap=True,
        )


def _two_sigma(row: ComparisonRow) -> str:
    return f"{2.0 * row.sigma:.2g}" if np.isfinite(row.sigma) and row.sigma > 0.0 else ""


def fly_hover(wanted: IdentifyOrder, folder: Path, out: Console) -> int:
    """The hover test with what was identified; exit code of the hover test."""
    order = FlightOrder(
        scenario="hover",
        gps=wanted.gps,
        seed=wanted.seed,
        mode=ONE_PROCESS if wanted.one_process else LOCKSTEP,
        params=(*layers(wanted), folder / YAML),
        out=folder / HOVER,
        world=PAPER,
    )
    return fly_and_write(order, out).exit_code
