# SPDX-License-Identifier: Apache-2.0
"""Tables of a campaign's report."""

import math
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from heli_flight.loop.scoring import SOURCE_NAMES
from heli_flight.report.tables import Table
from heli_flight.studies.dispersion.explain import Influence, explained
from heli_flight.studies.dispersion.report_charts import column
from heli_flight.studies.dispersion.row import CAUSE, FIGURE, SENTENCE, Cause
from heli_flight.studies.dispersion.told import SHOWN, Told
from heli_flight.studies.dispersion.worst import worst
from heli_math.paper_metrics import BY_KEY

_SURE = 0.01
"""Correlations that chance makes less often than so stand out."""
_NONE = "–"


def percent(share: float) -> str:
    """A share as per cent with three digits, however small."""
    return f"{100.0 * share:.3g} %"


def _number(value: float) -> str:
    return _NONE if math.isnan(value) else f"{value:.3g}".replace("-", "−")


def quantiles_table(told: Told) -> Table:
    """Quantiles of each figure from each record, its bound, and how many flights are beyond."""
    head = ["metric", "median", "95 %", "99 %", "largest", "bound", "outside", "record"]
    rows = []
    for name, values in told.summary.quantiles.items():
        key, _, source = name.removesuffix(")").partition(" (")
        metric, figures = BY_KEY[key], column(told.table, FIGURE + name)
        beyond = int((figures > metric.paper).sum())
        rows.append(
            [
                f"{metric.label}, {metric.unit}", *map(_number, values), f"{metric.paper:g}",
                _coloured(beyond), SOURCE_NAMES[source],
            ]
        )  # fmt: skip
    caption = (
        "Quantiles over the flights that ended in the air, largest magnitude in the scored "
        "windows. Ground truth decides where the receiver can know it (rtk)."
    )
    return Table(head, rows, caption)


def _coloured(count: int) -> str:
    return Markup('<span class="{}">{}</span>').format("out" if count else "in", count)


def causes_table(told: Told) -> Table:
    """How the flights ended."""
    outside = sum(case.failed for case in told.cases if case.cause == Cause.FLOWN)
    rows = [[str(cause), str(count), _share(count, told), _example(told, str(cause))]
            for cause, count in Counter(told.table[CAUSE].to_pylist()).most_common()]  # fmt: skip
    if outside:
        rows.append(["of those flown, outside the bounds", str(outside), _share(outside, told), ""])
    return Table(["how they ended", "flights", "share", "first of them"], rows)


def _share(count: int, told: Told) -> str:
    return percent(count / told.table.num_rows)


def _example(told: Told, cause: str) -> str:
    causes, sentences = told.table[CAUSE].to_pylist(), told.table[SENTENCE].to_pylist()
    return next(s for c, s in zip(causes, sentences, strict=True) if c == cause)


def correlations_table(told: Told, strongest: Mapping[str, Sequence[Influence]]) -> Table | None:
    """Influence of each input on each judged figure; None if nothing can be said."""
    inputs = told.inputs
    figures = [name for name, found in strongest.items() if found]
    if not inputs or not figures:
        return None
    by_name = {f: {one.name: one for one in strongest[f]} for f in figures}
    rows: list[list[str]] = [
        [name, *(_correlation(by_name[figure][name]) for figure in figures)] for name in inputs
    ]
    shares = [explained(inputs, told.figures[figure][1]) for figure in figures]
    rows.append(["all together explain", *(_NONE if math.isnan(s) else f"{s:.0%}" for s in shares)])
    caption = (
        "Spearman's rank correlation of each input with each judged figure over the flights that "
        f"ended in the air; strong print where chance makes one as large in less than {_SURE:.0%}. "
        "Last row: share of the ranks' variance that the inputs explain linearly together "
        "(adjusted); the rest is what the seed draws, wind and noise, and what is not monotonic. "
        "Of a choice between names: the root of the share of variance between them."
    )
    return Table(["input", *figures], rows, caption)


def _correlation(one: Influence) -> str:
    if math.isnan(one.rank_correlation):
        return _NONE
    text = f"{one.rank_correlation:+.2f}".replace("-", "−")
    return Markup("<strong>{}</strong>").format(text) if one.p_value < _SURE else text


def worst_table(told: Told) -> Table:
    """The worst cases, each with the command that flies it again."""
    rows = []
    for case in worst(told.cases, SHOWN):
        figure = "" if not case.figure else f"{case.figure} {_number(case.value)}"
        share = _NONE if math.isnan(case.share) else f"{percent(case.share)} of its bound"
        what = f"{figure}, {share}" if figure else case.sentence or _NONE
        again = told.again.get(case.number)
        command = Markup("<code>{}</code>").format(
            f"./heli hover --params {shlex.quote(str(again))}") if again else _NONE  # fmt: skip
        how = "outside" if case.failed and case.cause == Cause.FLOWN else case.cause
        rows.append([str(case.number), str(case.seed), how, what, command])
    return Table(["flight", "seed", "end", "farthest", "fly it again"], rows, words=True)


def dispersed_table(told: Told) -> Table:
    """Distribution and flown range of each parameter."""
    rows = []
    inputs = told.inputs
    for name, how in told.about["disperse"].items():
        values: list[Any] = inputs.get(name, [])
        rows.append([name, how, _range(values) if values else _NONE])
    return Table(["parameter", "distribution", "flown"], rows, words=True)


def _range(values: list[Any]) -> str:
    if isinstance(values[0], str):
        return ", ".join(sorted(set(values)))
    return f"{_end(min(values))} to {_end(max(values))}"


def _end(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
