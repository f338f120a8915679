# SPDX-License-Identifier: Apache-2.0
"""The report on paper: what a printer gets, and `heli report --pdf`."""

import json
import re

import pytest

from heli_flight.cli import app as cli
from heli_flight.flight_file import write_parameters
from heli_flight.loop import simulate
from heli_flight.record import write_record
from heli_flight.settings import resolve

READY = "document.documentElement.dataset.ready === 'true'"
# A4 without the margins of the style sheet, CSS pixels.
WIDTH, HEIGHT = 703, 1032


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    folder = tmp_path_factory.mktemp("printed")
    over = {"plant": {"faults": ("{what: gps, kind: loss, start_s: 8, duration_s: 4}",)}}
    settings = resolve(duration_s=30.0, overrides=over)
    write_parameters(settings, folder / "params.yaml")
    write_record(simulate(settings).record, folder)
    assert cli.main(["report", str(folder)]) == 0
    return folder


@pytest.mark.slow
def test_paper_gets_light_charts_that_fit_and_leave_no_half_page(page, flown):
    page.prefer("dark")
    page.size(WIDTH, HEIGHT)
    page.open(flown / "report.html", READY)
    page.call("Emulation.setEmulatedMedia", media="print")
    page.value("window.dispatchEvent(new Event('beforeprint'))")
    assert page.value("document.documentElement.dataset.theme") == "light"
    assert page.value("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.value("document.documentElement.scrollWidth") <= WIDTH
    boxes = page.value(
        "[...document.querySelectorAll('figure')].map(f => [f.id,"
        " f.getBoundingClientRect().height,"
        " f.querySelector('.main-svg').getBoundingClientRect().right,"
        " f.querySelectorAll('.scatterlayer .trace').length])"
    )
    assert len(boxes) > 10
    for name, height, right, traces in boxes:
        # What does not fit any more leaves less than half of a page empty.
        assert height < 0.5 * HEIGHT and right <= WIDTH and traces, name
    hidden = page.value(
        "['.tools', 'nav', '.modebar-container'].every(part =>"
        " [...document.querySelectorAll(part)].every(e => e.getClientRects().length === 0))"
    )
    assert hidden
    # On the screen again everything is as it was.
    page.call("Emulation.setEmulatedMedia", media="screen", features=[
        {"name": "prefers-color-scheme", "value": "dark"}])  # fmt: skip
    page.value("window.dispatchEvent(new Event('afterprint'))")
    assert page.value("document.documentElement.dataset.theme") == "dark"
    paint = "document.getElementById('chart-first_altitude').data[0].line.color"
    page.wait(f"{paint} === JSON.parse(document.getElementById('palette').textContent).truth[1]")
    assert page.value("document.querySelectorAll('details.section[open]').length") == 0
    assert page.errors == []


@pytest.mark.slow
def test_a_page_that_is_printed_before_it_is_drawn_is_whole(page, flown):
    """Whoever prints at once gets every chart."""
    page.size(1280, 900)
    page.call("Page.addScriptToEvaluateOnNewDocument", source=(
        "addEventListener('DOMContentLoaded', () => dispatchEvent(new Event('beforeprint')))"
    ))  # fmt: skip
    page.open(flown / "report.html", "document.readyState === 'complete'")
    undrawn = (
        "[...document.querySelectorAll('.chart')]"
        ".filter(c => !c.querySelector('.scatterlayer .trace')).length"
    )
    page.wait(f"{undrawn} === 0")
    assert page.errors == []


@pytest.mark.slow
def test_the_command_prints(chromium, flown, capsys):
    assert cli.main(["report", str(flown), "--pdf", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    pdf = flown / "report.pdf"
    assert content["pdf"] == str(pdf)
    raw = pdf.read_bytes()
    pages = len(re.findall(rb"/Type\s*/Page\b", raw))
    print(f"{pages} pages, {len(raw) / 1e6:.2f} MB")
    assert raw.startswith(b"%PDF-") and 5 <= pages <= 14
    boxes = {
        tuple(map(float, box.split())) for box in re.findall(rb"/MediaBox\s*\[([^\]]+)\]", raw)
    }
    (box,) = boxes
    assert box[2:] == pytest.approx((595.0, 842.0), abs=1.0)
