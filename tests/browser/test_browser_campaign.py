# SPDX-License-Identifier: Apache-2.0
"""A campaign's report in a real browser: no errors, no network, every chart drawn, phone width."""

import numpy as np
import pytest

from heli_core.metrics import METRICS
from heli_flight.cli import app as cli
from heli_studies.campaign.run import Store
from heli_studies.campaign.spec import spec_of

READY = "document.documentElement.dataset.ready === 'true'"
TEXT = """flights: 200
gps: rtk
disperse:
  plant.scale.mass: {uniform: [0.9, 1.1]}
  plant.wind.towards_deg: {uniform: [0.0, 360.0]}
"""


def rows(spec):
    """As flights leave them, of figures that were never flown."""
    rng = np.random.default_rng(1)
    for number, values in enumerate(spec.inputs):
        row = {"flight": number, "seed": number + 1, "cause": "flown", "sentence": ""}
        row["coverage"] = 1.0
        row |= {f"in.{key}": value for key, value in zip(spec.names, values, strict=True)}
        parts = rng.lognormal(-1.2, 0.4, 6) * values[0]
        row["exit_code"] = int(parts.max() > 1.0)
        for metric, part in zip(METRICS["hover"], parts, strict=True):
            for source in ("navigation", "truth"):
                row[f"max.{metric.key} ({source})"] = float(part * metric.paper)
        yield row


@pytest.mark.slow
def test_a_campaigns_page_renders_offline(page, tmp_path, capsys):
    file = tmp_path / "spec.yaml"
    file.write_text(TEXT)
    spec = spec_of(file)
    store = Store.begin(tmp_path / "flown", spec, file)
    store.put(list(rows(spec)))
    assert cli.main(["campaign", "report", str(store.folder)]) == 0
    page.size(390, 844, phone=True)
    page.open(store.folder / "report.html", READY)
    drawn = page.value(
        "[...document.querySelectorAll('.chart')].map(d => [d.id, "
        "d.querySelectorAll('.scatterlayer .trace').length])"
    )
    wanted = {"chart-margin", "chart-failures", *(f"chart-dist_{m.key}" for m in METRICS["hover"])}
    assert wanted <= {name for name, _ in drawn} and all(traces > 0 for _, traces in drawn)
    assert page.value("document.documentElement.scrollWidth") <= 390
    assert page.errors == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))] == []
