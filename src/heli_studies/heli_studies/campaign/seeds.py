# SPDX-License-Identifier: Apache-2.0
"""`heli campaign --seeds`: a scenario on many seeds in this process."""

import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from heli_flight.flight_file import fault_overrides, flown_faults
from heli_flight.fly import tell_if_it_compiles
from heli_flight.layers import GPS_PRESETS, hover_test_world, section_of
from heli_flight.result import fault_words, judged_by
from heli_flight.scoring import STRETCHES
from heli_flight.settings import Settings, resolve
from heli_flight.terminal import console, json_text, steps
from heli_studies.campaign import run as many


@dataclass(frozen=True)
class SeedFlightOptions:
    """What the options of `heli hover` say, the same for every seed; None: their defaults."""

    scenario: str | None
    gps: str | None
    world: str | None
    laws: str | None
    duration_s: float | None
    params: Sequence[Path]
    faults: Path | None

    def settings(self, gps: str) -> Settings:
        """What is flown with a receiver; raises ParameterError."""
        over = fault_overrides(self.faults)
        world = hover_test_world(self.world, self.scenario, self.params)
        return resolve(
            self.scenario, gps, duration_s=self.duration_s, params=self.params, overrides=over,
            world=world, laws=self.laws,
        )  # fmt: skip

    def again(self, gps: str, seed: int) -> str:
        """The command that flies one of its flights again, recorded in full."""
        options: dict[str, Any] = {"--scenario": self.scenario, "--gps": gps, "--world": self.world}
        options |= {"--control-preset": self.laws, "--duration": self.duration_s, "--seed": seed}
        options |= {"--faults": self.faults}
        words = ["./heli", "hover", "--one-process"]
        for name, value in options.items():
            words += [] if value is None else [name, str(value)]
        for file in self.params:
            words += ["--params", str(file)]
        return shlex.join(words)


def many_seeds(seeds: str, asked: SeedFlightOptions, as_json: bool) -> int:
    """Fly them; the largest value of each metric, and how many survived their faults."""
    numbers = many.parse_seeds(seeds)
    asked = replace(asked, gps=asked.gps or section_of(asked.params).get("gps"))
    presets = [asked.gps] if asked.gps else list(GPS_PRESETS)
    settings = {name: asked.settings(name) for name in presets}
    start, columns, done = time.monotonic(), {}, 0
    tell_if_it_compiles(console(stderr=True))
    with steps("flights", len(numbers) * len(presets)) as progress:
        for name in presets:
            report_done = partial(_report_total, progress, done)
            columns[name] = many.fly_seeds(settings[name], numbers, report_done)
            done += len(numbers)
    code = max(f.exit_code(name) for name, flights in columns.items() for f in flights)
    if as_json:
        print(json_text(_content(columns, settings, numbers, code)), end="")
        return code
    out, first = console(), settings[presets[0]]
    out.print(f"{first.scenario_name}, seeds {seeds}: largest magnitude over seeds", soft_wrap=True)
    for stretch in STRETCHES:
        out.print(many.seeds_table(columns, first.scenario.kind, out, stretch))
    for name in presets:
        out.print(f"judged, {name}: {judged_by(settings[name])}", soft_wrap=True)
    lines = [*first.remarks, *many.remarks(columns, first.scenario.kind)]
    lines += _survival(columns, settings, asked)
    for line in lines:
        out.print(line, soft_wrap=True, markup=False, highlight=False)
    out.print(f"{done} flights in {time.monotonic() - start:.1f} s")
    return code


def _report_total(progress: Callable[[int], None], first: int, count: int) -> None:
    progress(first + count)


def _content(
    columns: Mapping[str, Sequence[many.FlownSeed]],
    settings: Mapping[str, Settings],
    seeds: Sequence[int],
    code: int,
) -> dict[str, Any]:
    """For --json."""
    first = next(iter(settings.values()))
    content: dict[str, Any] = {"scenario": first.scenario_name, "world": first.world}
    content |= {"laws": first.laws, "seeds": seeds, "exit_code": code}
    receivers = many.seeds_as_dict(columns, settings)
    faults = flown_faults(first)
    if faults:
        content["faults"] = [fault.as_dict() for fault in faults]
        for name, flights in columns.items():
            share = many.survived(flights)
            receivers[name]["survived"] = {
                "flights": share.hits, "of": share.flights, "interval": list(share.interval)
            }  # fmt: skip
    return content | {"receivers": receivers}


def _survival(
    columns: Mapping[str, Sequence[many.FlownSeed]],
    settings: Mapping[str, Settings],
    asked: SeedFlightOptions,
) -> list[str]:
    """How many survived the faults, if there are any, and how a lost flight is flown again."""
    lines = []
    for name, flights in columns.items():
        if words := fault_words(settings[name]):
            lines.append(f"survived, {name}: {many.survived(flights).words}; faults: {words}")
        lines += [f"again: {asked.again(name, f.seed)}" for f in flights if f.lost]
    return lines
