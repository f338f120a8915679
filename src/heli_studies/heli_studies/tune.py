# SPDX-License-Identifier: Apache-2.0
"""`heli tune`: a controller of a given structure for several aircraft and worlds at once.

Goals come from a YAML file, the aircraft from aircraft files, what a world changes of them (its
flap-back, its delay) from the worlds; `heli_inner_hinf.fixed_structure` finds the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_core.command_line import config_folder
from heli_core.errors import SynthesisError
from heli_core.folders import write_whole
from heli_core.foreign_files import FileError, read_yaml
from heli_core.rcl_yaml import ParameterError, dump_all, file_refusal
from heli_core.ticks import TICK_S
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.trim import flap_back_in_hover, linearize, trim
from heli_flight.settings import resolve
from heli_flight.terminal import table
from heli_inner_hinf.attitude_goals import (
    COST,
    DISK_MARGIN_AT,
    INPUT_GROUPS,
    OUTPUT_GROUPS,
    SURROUNDINGS,
    StateFeedbackLaw,
    flyable,
    loop_plant,
    margin_plant,
    output_scale,
    output_start,
    output_structure,
    pid_structure,
    surroundings_plant,
)
from heli_inner_hinf.controller_state import MAX_ORDER, Actuation, ObserverInput, OutputLaw
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.fixed_structure import (
    KEPT,
    Goal,
    GoalKind,
    LawStructure,
    Reached,
    Start,
    StructuredPlant,
    Tuned,
    TuningProblem,
    Vector,
)
from heli_inner_hinf.fixed_structure import tune as tune_problem
from heli_inner_hinf.loops import N_Y, Model
from heli_inner_hinf.regular_form import N_H, N_U, N_X
from heli_inner_hinf.tuning import (
    CostScales,
    SampledAircraft,
    Surroundings,
    choose_observer_gain,
    gains_of,
    tune_pid,
)
from heli_outer_pd.parameters import largest_K_D
from heli_studies.design.cascade import COSTS, MARGINS_AT, CascadeAircraft, cascade_aircraft
from heli_studies.robust import with_values
from heli_studies.tune_flown import FLOWN, FlownGoal, FlownReached, checked_seeds, fly

WORLDS = ("paper", "honest")
"""Where the controller has to do unless others are named: the rotor flaps back in the second."""
PID, STATE, OUTPUT, CASCADE = "pid", "state", "output", "cascade"
_GAINS = ("pid.K_P", "pid.K_I", "pid.K_D")
_OF_POSITION = ("K_P", "K_D")
_SHORT_OF = 0.999
"""A tuned `K_D` down stays so much below the largest one, where a file rounds it."""
_KEYS = {"name", "kind", "bound", "hard", "from", "to", "at", "further_ticks", "seeds"}
_MOST_TICKS = 10
SAME = 0.01
"""Relative difference of the worst soft share below which two controllers are equally good."""


@dataclass(frozen=True)
class TuneOrder:
    """What is asked for.

    Attributes
    ----------
    structure : str
        "pid"; "state" for F and G of eq. (17); "output:N" for output feedback of order N; "cascade"
        for PID and position controller.
    aircraft : tuple of str
        Names or files; empty: the plant's.
    worlds : tuple of str
    goals : path, optional
        Default: the packaged file.
    bounds : mapping of str to float
        By name of a goal, over the file's.
    starts, seed, iterations : int
        As of `fixed_structure.tune`.
    """

    structure: str = PID
    aircraft: tuple[str, ...] = ()
    worlds: tuple[str, ...] = WORLDS
    goals: Path | None = None
    bounds: Mapping[str, float] | None = None
    starts: int = 1
    seed: int = 0
    iterations: int = 400


@dataclass(frozen=True)
class TuneResult:
    """What came of it.

    Attributes
    ----------
    order : TuneOrder
    tuned : Tuned
    before : tuple of Reached
        The same goals with the controller that the search began with.
    values : mapping of node to mapping of parameter to value
        What flies the controller.
    gains : mapping of str to array
        The structure's own numbers, by name.
    flown, flown_before : tuple of FlownReached
        The goals that are flown, likewise.
    """

    order: TuneOrder
    tuned: Tuned
    before: tuple[Reached, ...]
    values: Mapping[str, Mapping[str, Any]]
    gains: Mapping[str, Vector]
    flown: tuple[FlownReached, ...] = ()
    flown_before: tuple[FlownReached, ...] = ()

    @property
    def exit_code(self) -> int:
        """0 where every hard goal is kept."""
        return 0 if all(one.met for one in self.tuned.reached if one.goal.hard) else 1


# -------------------------------------------------------------------------------------------------
# What is asked for.
# -------------------------------------------------------------------------------------------------


def _order_of(structure: str) -> int | None:
    """Order of output feedback; None of the other structures.

    Raises
    ------
    ParameterError
    """
    if structure in (PID, STATE, CASCADE):
        return None
    name, _, order = structure.partition(":")
    if name == OUTPUT and order.isdecimal() and int(order) <= MAX_ORDER:
        return int(order)
    raise ParameterError(
        f"--structure {structure!r} is not allowed; allowed: {PID}, {STATE}, {CASCADE}, "
        f"{OUTPUT}:N with N from 0 to {MAX_ORDER}"
    )


def aircraft_of(order: TuneOrder) -> tuple[SampledAircraft, ...]:
    """Every aircraft as it flies in every world; those that are alike once.

    Raises
    ------
    ParameterError, AircraftError, TrimError
    """
    found: list[SampledAircraft] = []
    for name in order.aircraft or (None,):
        for world in order.worlds:
            plant = resolve(world=world).nodes["plant"]
            file = name or plant["aircraft_file"]
            helicopter = HelicopterParameters.from_yaml(file)
            if plant["terms.flap_back"]:
                values = {"flap_back": flap_back_in_hover(helicopter)}
                helicopter = with_values(helicopter, values)
            linear = linearize(helicopter, trim(helicopter))
            actuation = Actuation(
                helicopter.servo_bandwidth_radps,
                helicopter.servo_damping,
                int(plant["delay_ticks"]) * TICK_S,
            )
            one = SampledAircraft(
                f"{Path(file).stem}, {Path(world).stem}", linear.A, linear.B, linear.E, actuation
            )
            if not any(_alike(one, other) for other in found):
                found.append(one)
    return tuple(found)


def _alike(one: SampledAircraft, other: SampledAircraft) -> bool:
    same = all(np.array_equal(getattr(one, k), getattr(other, k)) for k in "ABE")
    return same and one.actuation == other.actuation


def read_goals(order: TuneOrder) -> list[dict[str, Any]]:
    """The checked rows of the goals' file, with the order's bounds.

    Raises
    ------
    ParameterError
        One sentence that names file, goal and key.
    """
    cascade = order.structure == CASCADE
    packaged = "tune_cascade.yaml" if cascade else "tune.yaml"
    path = order.goals or config_folder("heli_flight") / packaged
    try:
        content = read_yaml(path)
    except FileError as error:
        raise file_refusal(error, path, "goals") from None
    rows = content.get("goals") if isinstance(content, Mapping) else None
    if not isinstance(rows, list) or not rows or not all(isinstance(r, Mapping) for r in rows):
        raise ParameterError(f"{path}: holds no list `goals` of goals with name, kind and bound")
    checked = [_checked(dict(row), f"{path}: goal {i + 1}", cascade) for i, row in enumerate(rows)]
    bounds = dict(order.bounds or {})
    for row in checked:
        row["bound"] = bounds.pop(row["name"], row["bound"])
        if not row["bound"] > 0.0:
            raise ParameterError(f"goal {row['name']!r}: bound {row['bound']} is not above 0")
    for name in bounds:
        raise ParameterError(
            f"--goal {name!r} is none of: {', '.join(sorted({row['name'] for row in checked}))}"
        )
    if all(row["hard"] or row["kind"] == FLOWN for row in checked):
        raise ParameterError(
            f"{path}: every goal is hard or flown; at least one has to be soft and not flown"
        )
    if order.aircraft and any(row["kind"] == FLOWN for row in checked):
        raise ParameterError(
            f"{path}: a goal is flown, which is with the plant's aircraft; --aircraft does not go "
            "with it"
        )
    return checked


def _checked(row: dict[str, Any], where: str, cascade: bool) -> dict[str, Any]:
    unknown = sorted(str(key) for key in row.keys() - _KEYS)
    if unknown:
        raise ParameterError(f"{where}: {unknown[0]!r} is none of {', '.join(sorted(_KEYS))}")
    kinds = [*(kind.value for kind in GoalKind), FLOWN]
    name, kind, bound = row.get("name"), row.get("kind"), row.get("bound")
    hard, ticks = row.get("hard", False), row.get("further_ticks", 0)
    if not isinstance(name, str) or not name:
        raise ParameterError(f"{where}: name {name!r} is not allowed; allowed: a word or more")
    if kind not in kinds:
        raise ParameterError(f"{where}: kind {kind!r} is none of {', '.join(kinds)}")
    number = isinstance(bound, (int, float)) and not isinstance(bound, bool)
    bound = float(bound) if number and bound is not None else np.nan
    if not np.isfinite(bound):
        raise ParameterError(
            f"{where}: bound {row.get('bound')!r} is not allowed; allowed: a number above 0"
        )
    if kind == GoalKind.DAMPING.value and not bound < 1.0:
        raise ParameterError(f"{where}: bound {bound!r} of a damping is not below 1")
    if not isinstance(hard, bool):
        raise ParameterError(f"{where}: hard {hard!r} is neither true nor false")
    if not isinstance(ticks, int) or not 0 <= ticks <= _MOST_TICKS:
        raise ParameterError(f"{where}: further_ticks {ticks!r}; allowed: 0 to {_MOST_TICKS}")
    row = {**row, "bound": bound, "hard": hard, "further_ticks": ticks}
    margins = MARGINS_AT if cascade else tuple(DISK_MARGIN_AT)
    if kind == FLOWN:
        row["seeds"] = checked_seeds(row, where)
    elif kind in (GoalKind.H2.value, GoalKind.HINF.value):
        come, go = row.get("from"), row.get("to")
        if cascade and (come != [SURROUNDINGS] or go not in [[cost] for cost in COSTS]):
            raise ParameterError(
                f"{where}: from {come!r}, to {go!r}; allowed for a cascade: from [{SURROUNDINGS}] "
                f"to [{'] or ['.join(COSTS)}]"
            )
        if not cascade and (come, go) != ([SURROUNDINGS], [COST]):
            for key, groups, known in (("from", come, INPUT_GROUPS), ("to", go, OUTPUT_GROUPS)):
                named = isinstance(groups, list) and all(isinstance(g, str) for g in groups)
                if not named or not groups or not set(groups) <= set(known):
                    raise ParameterError(
                        f"{where}: {key} {groups!r}; allowed: a list of {', '.join(known)}, or "
                        f"from [{SURROUNDINGS}] to [{COST}]"
                    )
    elif kind == GoalKind.DISK_MARGIN.value and row.get("at") not in margins:
        raise ParameterError(f"{where}: at {row.get('at')!r} is none of {', '.join(margins)}")
    return row


def _plant(row: Mapping[str, Any], one: SampledAircraft | CascadeAircraft) -> StructuredPlant:
    one = one.later(row["further_ticks"]) if row["further_ticks"] else one
    if isinstance(one, CascadeAircraft):
        if row["kind"] in (GoalKind.H2.value, GoalKind.HINF.value):
            return one.surroundings_plant(row["to"][0])
        return one.margin_plant(row.get("at", "input"))
    if row["kind"] == GoalKind.DISK_MARGIN.value:
        return margin_plant(one, row["at"])
    if row["kind"] not in (GoalKind.H2.value, GoalKind.HINF.value):
        return margin_plant(one, "input")
    if row["from"] == [SURROUNDINGS]:
        return surroundings_plant(one, CostScales(), Surroundings())
    return loop_plant(one, row["from"], row["to"])


def goals_of(
    rows: Sequence[Mapping[str, Any]], aircraft: Sequence[SampledAircraft | CascadeAircraft]
) -> tuple[Goal, ...]:
    """Every goal for every aircraft but those that are flown."""
    return tuple(
        Goal(
            row["name"],
            GoalKind(row["kind"]),
            _plant(row, one),
            row["bound"],
            row["hard"],
            one.name,
        )
        for one in aircraft
        for row in rows
        if row["kind"] != FLOWN
    )


def flown_goals_of(order: TuneOrder, rows: Sequence[Mapping[str, Any]]) -> tuple[FlownGoal, ...]:
    """Every goal that is flown, in every world."""
    return tuple(
        FlownGoal(row["name"], world, row["seeds"], row["bound"], Path(world).stem)
        for world in order.worlds
        for row in rows
        if row["kind"] == FLOWN
    )


# -------------------------------------------------------------------------------------------------
# Tuning.
# -------------------------------------------------------------------------------------------------


def packaged_gains() -> Vector:
    """K_P, K_I, K_D (9,) of the preset `pid`."""
    inner = resolve(laws=PID).nodes["inner_loop"]
    return np.concatenate([np.asarray(inner[key], float) for key in _GAINS])


def _first_gains(order: TuneOrder, aircraft: Sequence[SampledAircraft]) -> Vector:
    """The packaged PID, or that of the rule for the first of other aircraft."""
    if not order.aircraft:
        return packaged_gains()
    one = aircraft[0]
    nothing = np.zeros((N_H, N_X)), np.zeros((N_H, N_U))
    model = Model(one.A, one.B, one.E, *nothing, np.zeros((N_U, N_X)), np.zeros((N_U, N_U)))
    gains = gains_of(tune_pid(model, one.actuation))
    return np.concatenate([gains[key] for key in ("K_P", "K_I", "K_D")])


@dataclass(frozen=True)
class _Tunable:
    """What a structure's numbers are.

    Attributes
    ----------
    structure : LawStructure
    start, scale : (m,) arrays
    law : callable
        What flies the numbers: parameters by node.
    gains : callable
        The numbers by name.
    flyable : callable
        The nearest numbers that the nodes take.
    """

    structure: LawStructure
    start: Vector
    scale: Vector | None
    values: Callable[[Vector], dict[str, dict[str, Any]]]
    gains: Callable[[Vector], dict[str, Vector]] = lambda _: {}
    flyable: Callable[[Vector], Vector] = lambda numbers: numbers


def _pid(order: TuneOrder, aircraft: Sequence[SampledAircraft]) -> _Tunable:
    start = _first_gains(order, aircraft)
    return _Tunable(pid_structure(), start, None, _pid_values)


def _pid_values(numbers: Vector) -> dict[str, dict[str, Any]]:
    gains = dict(zip(_GAINS, numbers.reshape(3, N_U), strict=True))
    return {"inner_loop": {"controller": PID, **gains}}


def _output(order: TuneOrder, aircraft: Sequence[SampledAircraft], states: int) -> _Tunable:
    structure = output_structure(states)
    start = output_start(_first_gains(order, aircraft), states)
    scale = output_scale(states)
    return _Tunable(structure, start, scale, lambda x: _of_law(flyable(structure.law(x))))


def _of_law(law: OutputLaw) -> dict[str, dict[str, Any]]:
    matrices = {f"law.{key}": np.ravel(value) for key, value in law._asdict().items()}
    return {"inner_loop": {"controller": "matrices", **matrices}}


def _state(order: TuneOrder, aircraft: Sequence[SampledAircraft]) -> _Tunable:
    """F and G of the packaged weights' synthesis, for the first aircraft, behind its observer."""
    one, nodes = aircraft[0], resolve().nodes
    config = AttitudeConfig.from_parameters({**nodes["inner_loop"], "controller": PID})
    synthesis = replace(config, A=one.A, B=one.B, E=one.E).synthesis
    feed, prediction_s = ObserverInput.from_parameters(nodes["observer"]), config.prediction_s
    K = np.reshape(nodes["observer"]["K"], (N_U, N_Y))
    if order.aircraft:
        servo = one.actuation.servo_radps, one.actuation.servo_damping
        feed = ObserverInput(round(one.actuation.delay_s / TICK_S), *servo)
        prediction_s = one.actuation.known_lag_s
        model = Model(one.A, one.B, one.E, config.C, config.D, synthesis.F, synthesis.G)
        K = choose_observer_gain(model, prediction_s, one.actuation, feed)[0].K
    law = StateFeedbackLaw(one, K, prediction_s, feed)
    return _Tunable(
        law.structure,
        synthesis.F.ravel(),
        law.scale,
        lambda x: _of_law(law.flyable(x)),
        lambda x: dict(zip("FG", law.gains(x), strict=True)),
    )


def _cascades(order: TuneOrder, aircraft: Sequence[SampledAircraft]) -> list[CascadeAircraft]:
    """One for every world: mean wind and turbulence differ where the attitude loop does not."""
    if order.aircraft:
        raise ParameterError(
            f"--aircraft does not go with --structure {CASCADE}: its position controller is the "
            "plant's aircraft's"
        )
    found = []
    for world in order.worlds:
        (one,) = aircraft_of(replace(order, worlds=(world,)))
        nodes = resolve(laws=PID, world=world).nodes
        model, gains = (one.A, one.B, one.E), packaged_gains()
        made = cascade_aircraft(
            one.name, nodes["plant"], nodes["outer_loop"], model, gains, one.actuation
        )
        found.append(made)
    return found


def cascade_numbers(one: CascadeAircraft) -> _Tunable:
    """The PID's nine gains, K_P and K_D of the position controller; down as far as it flies."""
    start = np.concatenate([packaged_gains(), one.kernel.K_P, one.kernel.K_D])
    most = largest_K_D(resolve(laws=PID).nodes["outer_loop"])

    def values(numbers: Vector) -> dict[str, dict[str, Any]]:
        pid, *of_position = np.split(numbers, [3 * N_U, 3 * N_U + 3])
        outer = dict(zip(_OF_POSITION, of_position, strict=True))
        return {**_pid_values(pid), "outer_loop": outer}

    def flyable(numbers: Vector) -> Vector:
        return np.append(numbers[:-1], min(numbers[-1], _SHORT_OF * most))

    return _Tunable(one.structure, start, None, values, flyable=flyable)


def preset_of(structure: str) -> str:
    """The control preset that the tuned parameters are laid over."""
    return PID if structure in (PID, CASCADE) else "packaged"


def run(order: TuneOrder, tell: Callable[[str], None] = lambda _: None) -> TuneResult:
    """Tune.

    Parameters
    ----------
    order : TuneOrder
    tell : callable
        Told what comes next, a few words.

    Raises
    ------
    ParameterError, AircraftError, TrimError, SynthesisError
        Each with one sentence.
    """
    n, rows = _order_of(order.structure), read_goals(order)
    aircraft = aircraft_of(order)
    loops: Sequence[SampledAircraft | CascadeAircraft] = aircraft
    try:
        if order.structure == CASCADE:
            cascades = _cascades(order, aircraft)
            loops, tunable = cascades, cascade_numbers(cascades[0])
        elif order.structure == STATE:
            tunable = _state(order, aircraft)
        else:
            tunable = _pid(order, aircraft) if n is None else _output(order, aircraft, n)
    except ParameterError:
        raise
    except ValueError as error:
        raise SynthesisError(str(error)) from None
    tell(f"{order.structure} for {'; '.join(one.name for one in loops)}")
    problem = TuningProblem(tunable.structure, goals_of(rows, loops))
    tuned = tune_problem(
        problem, tunable.start, tunable.scale, order.starts, order.seed, order.iterations, tell=tell
    )
    before = problem.reached(problem.scaled_start(tunable.start))
    tuned = flyable_of(tunable, tuned)
    tuned, flown, flown_before = _flown(order, rows, tunable, tuned, tell)
    x = tuned.parameters
    return TuneResult(
        order, tuned, before, tunable.values(x), tunable.gains(x), flown, flown_before
    )


def flyable_of(tunable: _Tunable, tuned: Tuned) -> Tuned:
    """The best start, and every other, moved to numbers that the nodes take."""
    m = tuned.problem.structure.size

    def moved(x: Vector) -> Vector:
        return np.concatenate([tunable.flyable(x[:m]), x[m:]])

    if all((moved(end.x) == end.x).all() for end in tuned.starts):
        return tuned
    starts = []
    for end in tuned.starts:
        x = moved(end.x)
        one = replace(tuned, x=x, reached=tuned.problem.reached(x))
        starts.append(replace(end, x=x, soft=one.soft, hard=one.hard))
    best = min(starts, key=lambda end: (max(end.hard, 1.0 + KEPT), end.soft))
    reached = tuned.problem.reached(best.x)
    return replace(tuned, x=best.x, reached=reached, starts=tuple(starts))


def _flown(
    order: TuneOrder,
    rows: Sequence[Mapping[str, Any]],
    tunable: _Tunable,
    tuned: Tuned,
    tell: Callable[[str], None],
) -> tuple[Tuned, tuple[FlownReached, ...], tuple[FlownReached, ...]]:
    """The start that is best with what is flown, and what is flown of it and of the beginning."""
    goals, laws = flown_goals_of(order, rows), preset_of(order.structure)
    if not goals:
        return tuned, (), ()
    m = tuned.problem.structure.size

    def of(numbers: Vector) -> tuple[FlownReached, ...]:
        return fly(goals, laws, tunable.values(numbers), tell)

    def rank(judged: tuple[Start, tuple[FlownReached, ...]]) -> tuple[float, float]:
        end, flown = judged
        return max(end.hard, 1.0 + KEPT), max(end.soft, *(one.share for one in flown))

    kept = [end for end in tuned.starts if end.hard <= 1.0 + KEPT] or list(tuned.starts)
    best, flown = min(((end, of(end.x[:m])) for end in kept), key=rank)
    chosen = replace(tuned, x=best.x, reached=tuned.problem.reached(best.x))
    return chosen, flown, of(tunable.start)


def write_tuned(result: TuneResult, path: Path) -> None:
    """Write the parameter file that flies the controller: `heli hover --params FILE`."""
    order = result.order
    goals = f" --goals {order.goals}" if order.goals else ""
    dump_all(result.values, path)
    head = (
        f"# By heli tune --structure {order.structure} --starts {order.starts} --seed "
        f"{order.seed}{goals}, for {'; '.join(dict.fromkeys(g.where for g in _goals(result)))}.\n"
        + "".join(
            f"# {one.goal.name} ({one.goal.where}): {one.value:.5g}, bound {one.goal.bound:g}\n"
            for _, one in _before_and_after(result)
        )
        + "# Arrays are flat, row by row; units and meaning: inner_loop.yaml.\n"
    )
    write_whole(path, head + path.read_text(encoding="utf-8"))


def _goals(result: TuneResult) -> tuple[Goal, ...]:
    return result.tuned.problem.goals


# -------------------------------------------------------------------------------------------------
# `heli tune --check`: whether the packaged file holds what the tuner finds.
# -------------------------------------------------------------------------------------------------

PACKAGED = "tuned_pid.yaml"


@dataclass(frozen=True)
class Check:
    """The packaged controller beside the one that was tuned anew.

    Attributes
    ----------
    packaged, anew : tuple of Reached
    """

    packaged: tuple[Reached, ...]
    anew: tuple[Reached, ...]

    @property
    def differences(self) -> list[str]:
        """Where the packaged controller misses a hard goal or is not as good, a sentence each."""
        lines = [
            f"{PACKAGED}: {one.goal.name} ({one.goal.where}) is {one.value:.5g}, bound "
            f"{one.goal.bound:g}"
            for one in self.packaged
            if one.goal.hard and not one.met
        ]
        kept, found = (
            max(one.share for one in of if not one.goal.hard) for of in (self.packaged, self.anew)
        )
        if abs(kept / found - 1.0) > SAME:
            lines.append(
                f"{PACKAGED}: the worst soft goal is {kept:.5g} of its bound, the tuner finds "
                f"{found:.5g}"
            )
        return lines


def check(tell: Callable[[str], None] = lambda _: None) -> Check:
    """Tune anew as `PACKAGED` was made, and compare by the goals.

    Gains are not compared: where a valley is flat they differ with the processor.
    """
    anew = run(TuneOrder(), tell)
    file = config_folder("heli_flight") / PACKAGED
    inner = resolve(params=[file]).nodes["inner_loop"]
    gains = np.concatenate([np.asarray(inner[key], float) for key in _GAINS])
    problem = anew.tuned.problem
    scaled = anew.tuned.x.copy()
    scaled[: problem.structure.size] = gains
    return Check(problem.reached(scaled), anew.tuned.reached)


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------


def as_dict(result: TuneResult) -> dict[str, Any]:
    """Everything, for JSON."""
    tuned, order = result.tuned, replace(result.order, goals=None)
    return {
        "structure": order.structure,
        "seed": order.seed,
        "worst_soft_share": tuned.soft,
        "worst_hard_share": tuned.hard,
        "goals": [
            {
                "name": now.goal.name,
                "aircraft": now.goal.where,
                "kind": now.goal.kind.value if isinstance(now, Reached) else FLOWN,
                "hard": isinstance(now, Reached) and now.goal.hard,
                "bound": now.goal.bound,
                "before": was.value,
                "value": now.value,
                "met": now.met,
            }
            for was, now in _before_and_after(result)
        ],
        "starts": [
            {key: value for key, value in vars(start).items() if key != "x"}
            for start in tuned.starts
        ],
        "gains": {name: np.asarray(value).tolist() for name, value in result.gains.items()},
        "parameters": {
            node: {
                key: value if isinstance(value, str) else np.ravel(value).tolist()
                for key, value in of.items()
            }
            for node, of in result.values.items()
        },
    }


def _before_and_after(
    result: TuneResult,
) -> list[tuple[Reached | FlownReached, Reached | FlownReached]]:
    linear = zip(result.before, result.tuned.reached, strict=True)
    return [*linear, *zip(result.flown_before, result.flown, strict=True)]


def print_result(result: TuneResult, out: Console) -> None:
    """The goals, then how the starts ended."""
    rows = table(f"Goals of {result.order.structure}", out)
    for head in ("goal", "aircraft"):
        rows.add_column(head)
    for head in ("bound", "began with", "tuned", "met"):
        rows.add_column(head, justify="right")
    least = (GoalKind.DECAY, GoalKind.DAMPING, GoalKind.DISK_MARGIN)
    for was, now in _before_and_after(result):
        linear = now.goal if isinstance(now, Reached) else None
        rows.add_row(
            f"{now.goal.name}{', hard' if linear and linear.hard else ''}",
            now.goal.where,
            f"{'>=' if linear and linear.kind in least else '<='} {now.goal.bound:g}",
            f"{was.value:.4g}",
            f"{now.value:.4g}",
            "yes" if now.met else "no",
        )
    out.print(rows)
    for number, start in enumerate(result.tuned.starts, 1):
        out.print(
            f"start {number}: soft {start.soft:.4f}, hard {start.hard:.4f} of the bound; "
            f"{start.iterations} iterations, {start.evaluations} evaluations, stationarity "
            f"{start.stationarity:.1e}"
        )
