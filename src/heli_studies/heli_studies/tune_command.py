# SPDX-License-Identifier: Apache-2.0
"""The command `heli tune`; what it needs it imports when it runs."""

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from heli_core.folders import write_whole
from heli_flight.cli import common
from heli_flight.cli.common import Json

if TYPE_CHECKING:
    from rich.console import Console

TUNE_EPILOG = (
    "\b\nexample:\n  heli tune --out tuned\n"
    "  heli tune --structure output:4 --starts 3 --goal cost=4.0 --out tuned\n"
    "  heli hover --control-preset pid --params tuned/tuned.yaml\n\n"
    "exit code: 0 every hard goal is kept, 1 one is not, or --check found a difference, 2 bad "
    "input (one line)"
)


def _structures(incomplete: str) -> list[str]:
    return common.beginning(
        incomplete, ["pid", "state", "cascade", "output:0", "output:3", "output:6"]
    )


def _bound(text: str) -> tuple[str, float]:
    from heli_core.rcl_yaml import ParameterError

    name, _, bound = text.rpartition("=")
    try:
        return name, float(bound)
    except ValueError:
        raise ParameterError(f"--goal {text!r} is not allowed; allowed: NAME=BOUND") from None


def tune(
    structure: Annotated[
        str,
        typer.Option(
            metavar="S",
            help="pid; state: F and G of eq. (17); output:N: output feedback of order N; cascade: "
            "PID and position controller",
            autocompletion=_structures,
        ),
    ] = "pid",
    aircraft: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="helion, xcell60, logo600, or a YAML file; repeatable: one for all (default: "
            "the plant's)",
            autocompletion=common.aircraft,
        ),
    ] = None,
    world: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="paper, honest, hard, or a YAML file; repeatable (default: paper and honest)",
            autocompletion=common.worlds,
        ),
    ] = None,
    goals: Annotated[
        Path | None, typer.Option(metavar="FILE", help="YAML file of goals (default: packaged)")
    ] = None,
    goal: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=BOUND", help="another bound of one of the goals; repeatable"),
    ] = None,
    starts: Annotated[
        int, typer.Option(min=1, max=1000, metavar="N", help="descents, from other numbers each")
    ] = 1,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="of the starts")] = 0,
    iterations: Annotated[
        int, typer.Option(min=1, max=100000, metavar="N", help="at most, of each start")
    ] = 400,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder for tuned.yaml and tuned.json; must not exist"),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check", help="tune the packaged PID of the tuner anew and compare (code 1)"
        ),
    ] = False,
    as_json: Json = False,
) -> int:
    """Tune a controller of given structure to soft and hard goals, for many aircraft."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.terminal import answer, being_filled, console, json_text, refuse_existing
    from heli_studies import tune as tuning

    refuse_existing(out)
    tell = partial(_tell, console(stderr=True))
    if check:
        differing = tuning.check(tell).differences
        for line in differing or [f"{tuning.PACKAGED} holds what the tuner finds"]:
            console().print(line, soft_wrap=True, markup=False)
        return 1 if differing else 0
    order = tuning.TuneOrder(
        structure, tuple(aircraft or ()), tuple(world or tuning.WORLDS), goals,
        dict(_bound(text) for text in goal or ()), starts, seed, iterations,
    )  # fmt: skip
    result = tuning.run(order, tell)
    if out is not None:
        with being_filled(out):
            tuning.write_tuned(result, out / "tuned.yaml")
            write_whole(out / "tuned.json", json_text(tuning.as_dict(result)))
    preset = tuning.preset_of(structure)
    preset = "" if preset == "packaged" else f"--control-preset {preset} "
    written = f"written: {out} (fly it: heli hover {preset}--params {out}/tuned.yaml)"
    show = partial(tuning.print_result, result)
    answer(tuning.as_dict(result), as_json, show, written if out else "")
    return result.exit_code


def _tell(out: "Console", line: str) -> None:
    out.print(f"tune: {line}", soft_wrap=True, markup=False, highlight=False)
