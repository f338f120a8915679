# SPDX-License-Identifier: Apache-2.0
"""The report in a real browser: no errors, no network, plots that respond, phone width."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest

from heli_flight.loop import simulate
from heli_flight.report.data import DiagnosticEvent
from heli_flight.report.write import write_report
from heli_flight.result import Result
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_studies.identify_report import PAGE

READY = "document.documentElement.dataset.ready === 'true'"
OPEN_ALL = "document.getElementById('all')?.click()"
EVENTS = (
    DiagnosticEvent(0.0, "observer", 0, "active"),
    DiagnosticEvent(7.0, "observer", 1, "GPS <timeout> & more"),
    DiagnosticEvent(9.0, "observer", 0, "active"),
)
# The page is about 2.2 MB, 1.2 of them Plotly.
LARGEST_PAGE_BYTES = 3_000_000
BUTTONS = {
    "Download plot", "Zoom", "Pan", "Zoom in", "Zoom out", "Reset axes",
}  # fmt: skip


FAULTS = ("{what: gps, kind: loss, start_s: 8, duration_s: 4}",)


def written(folder, scenario, **options):
    settings = resolve(scenario, **options)
    flight = simulate(settings)
    result = Result(
        score(flight.record, settings.scenario), flight.sentence, len(flight.record) / 100.0, 1.0
    )
    start = time.monotonic()
    page = write_report(
        flight.record, settings, result, folder, "one process", EVENTS, figures=scenario == "hover"
    )
    seconds = time.monotonic() - start
    print(f"{scenario}: report in {seconds:.2f} s, {page.stat().st_size / 1e6:.2f} MB")
    return page


@pytest.fixture(scope="module")
def hover(tmp_path_factory):
    return written(tmp_path_factory.mktemp("hover"), "hover")


@pytest.fixture(scope="module")
def attitude(tmp_path_factory):
    return written(tmp_path_factory.mktemp("attitude"), "attitude", duration_s=12.0)


@pytest.fixture(scope="module")
def identification(identified_once):
    return identified_once[1] / PAGE


@pytest.fixture(
    params=["hover", "attitude", pytest.param("identification", marks=pytest.mark.slow)]
)
def any_page(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="module")
def drawn(new_page):
    """A report's page in a tab that is only looked at: it is drawn once for all who do."""
    tabs = {}

    def shown(path):
        if path not in tabs or tabs[path].browser.broken:
            tabs[path] = new_page()
            tabs[path].size(1280, 900)
            open_all(tabs[path], path)
        return tabs[path]

    yield shown
    for tab in tabs.values():
        tab.close()


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    """A flight with a fault and two modes."""
    over = {"plant": {"faults": FAULTS}, "outer_loop": {"failsafe.land_astray_m": 1e4}}
    settings = resolve(duration_s=20.0, overrides=over)
    flight = simulate(settings)
    mode = np.where(flight.record.time_s < 15.0, "hover", "land")
    result = Result(score(flight.record, settings.scenario), flight.sentence, 20.0, 1.0)
    record, folder = replace(flight.record, mode=mode), tmp_path_factory.mktemp("faulty")
    return write_report(record, settings, result, folder, "one process", EVENTS)


def open_all(page, path):
    """The page with every section open and every chart drawn."""
    page.open(path, READY)
    page.value(OPEN_ALL)
    page.wait(READY)


def foreign_requests(page):
    return [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))]


def test_hover_report_renders_offline(drawn, hover):
    assert hover.stat().st_size < LARGEST_PAGE_BYTES
    page = drawn(hover)
    charts = page.value(
        "[...document.querySelectorAll('.chart')].map(d => [d.id, d.data.length, "
        "d.querySelectorAll('.scatterlayer .trace').length, d._fullLayout.width])"
    )
    names = {name for name, *_ in charts}
    assert {
        "chart-fig5_v_z", "chart-fig6_v_x", "chart-fig7_v_y", "chart-fig8_altitude",
        "chart-fig9_track", "chart-wind", "chart-actuators", "chart-estimate_position",
        "chart-estimate_velocity", "chart-rotor", "chart-singular_values", "chart-timeline",
    } <= names  # fmt: skip
    for name, traces, lines, width in charts:
        assert traces and lines == traces, name
        least = 300 if name.startswith("chart-first_") else 500
        assert least < width < 1280, name
    assert page.errors == []
    assert foreign_requests(page) == []


@pytest.mark.slow
def test_no_page_can_send_anything(page, any_page):
    page.open(any_page, READY)
    page.try_to_send()
    where = page.tabs()
    # Plotly's own upload, as its button would call it, and any other window.
    page.value(
        "Plotly.Plots.sendDataToCloud(document.querySelector('.chart'), 'https://example.org/');"
        " window.open('https://example.org/')"
    )
    assert foreign_requests(page) == []
    assert page.tabs() == where == [any_page.as_uri()]


def test_the_tracks_legend_and_buttons_do_not_touch(drawn, hover):
    page = drawn(hover)
    legend, buttons = page.value(
        "['.legend', '.modebar-container > div'].map(part => {"
        " const r = document.querySelector(`#chart-fig9_track ${part}`).getBoundingClientRect();"
        " return [r.left, r.top, r.right, r.bottom]; })"
    )
    assert buttons[2] > buttons[0] and buttons[3] > buttons[1] and legend[2] > legend[0]
    apart = legend[2] < buttons[0] or legend[3] < buttons[1] or buttons[3] < legend[1]
    assert apart, (legend, buttons)


def test_charts_offer_no_upload(drawn, any_page):
    page = drawn(any_page)
    titles = page.value(
        "[...document.querySelectorAll('.chart .modebar-btn')].map(b => b.dataset.title)"
    )
    assert set(titles) == BUTTONS
    assert foreign_requests(page) == [] and page.errors == []


@pytest.mark.slow
def test_bode_charts_have_frequency_ticks(drawn, identification):
    page = drawn(identification)
    shown = page.value(
        "[...document.querySelectorAll('[id^=chart-bode_]')].map(d => [d.id,"
        " [...d.querySelectorAll('.xaxislayer-above text')].map(t => Number(t.textContent))])"
    )
    assert len(shown) >= 10
    for name, ticks in shown:
        assert len(ticks) >= 3 and all(0.05 < tick < 50.0 for tick in ticks), (name, ticks)
        assert ticks == sorted(ticks), name
    assert page.errors == []


def test_attitude_report_shows_both_laws(drawn, attitude):
    page = drawn(attitude)
    assert page.value("document.querySelectorAll('#paper figure').length") == 2
    for key, bound in (("fig3_attitude_pid", 4.8), ("fig4_attitude_hinf_output", 1.7)):
        levels = page.value(
            f"document.getElementById('chart-{key}').calcdata.flat()"
            ".filter(p => p.trace && p.trace.meta.role === 'bound').length"
        )
        lines = page.value(
            f"document.getElementById('chart-{key}')._fullData"
            ".filter(t => t.meta.role === 'bound').map(t => Math.max(...t.y.filter(isFinite)))"
        )
        assert levels and lines == pytest.approx([bound, bound])
    assert page.errors == []


def test_drawn_samples_are_the_flight(drawn, hover):
    """The browser reads the numbers that were written: the reference climbs from 10 to 20 m."""
    page = drawn(hover)
    reference = page.value(
        "document.getElementById('chart-fig8_altitude')._fullData"
        ".filter(t => t.name === 'reference').map(t => [t.y[0], t.y[t.y.length - 1]])[0]"
    )
    assert reference == pytest.approx([10.0, 20.0])


@pytest.mark.slow
def test_zoom_is_shared_by_the_charts_of_time(page, hover):
    page.size(1280, 900)
    open_all(page, hover)
    area = page.value(
        "(() => { const d = document.getElementById('chart-fig6_v_x');"
        " d.scrollIntoView({behavior: 'instant', block: 'center'});"
        " const r = d.querySelector('.nsewdrag').getBoundingClientRect();"
        " return [r.left, r.top, r.width, r.height]; })()"
    )
    left, top, width, height = area
    middle = top + 0.5 * height
    page.drag((left + 0.25 * width, middle), (left + 0.5 * width, middle))

    def shown(key):
        return f"document.getElementById('chart-{key}')._fullLayout.xaxis.range"

    page.wait(f"{shown('fig6_v_x')}[0] > 10 && Math.abs({shown('wind')}[0] - "
              f"{shown('fig6_v_x')}[0]) < 1e-6")  # fmt: skip
    low, high = page.value(shown("wind"))
    assert (low, high) == pytest.approx((15.0, 30.0), abs=1.0)
    # The track has no time axis: it stays.
    assert page.value(shown("fig9_track"))[0] < -1.0
    assert page.errors == []


def hover_over(page, key, share):
    """Move the pointer over a chart's first panel; what the chart then tells."""
    left, top, width, height = page.value(
        f"(() => {{ const d = document.getElementById('chart-{key}');"
        " d.scrollIntoView({behavior: 'instant', block: 'center'});"
        " const r = d.querySelector('.nsewdrag').getBoundingClientRect();"
        " return [r.left, r.top, r.width, r.height]; })()"
    )
    at = {"x": left + share * width, "y": top + 0.5 * height}
    page.call("Input.dispatchMouseEvent", type="mouseMoved", **at)
    script = (
        f"[...document.querySelectorAll('#chart-{key} .hoverlayer text')].map(e => e.textContent)"
    )
    page.wait(f"{script}.length > 1")
    return page.value(script)


@pytest.mark.slow
def test_bands_are_shaded_named_and_told_in_every_chart_over_time(page, faulty):
    page.size(1280, 900)
    open_all(page, faulty)
    charts = page.value(
        "[...document.querySelectorAll('.chart')].map(d => [d.id,"
        " Object.values(d._fullLayout).some(a => a?.title?.text === 'flight time, s'),"
        " d._fullLayout.shapes.filter(s => s.x0 === 8 && s.x1 === 12).length,"
        " d.parentElement.querySelectorAll('.bands .key').length])"
    )
    over_time = [row for row in charts if row[1] and row[0] != "chart-timeline"]
    assert len(over_time) > 8
    assert all(shaded >= 1 and named == 4 for _, _, shaded, named in over_time), over_time
    assert all(row[2:] == [0, 0] for row in charts if row not in over_time)
    inside = hover_over(page, "wind", 0.5)
    number, unit = inside[0].split()
    assert float(number) == pytest.approx(10.0, abs=0.1) and unit == "s"
    assert "wind at the aircraft : " in inside[1]
    assert inside[1].endswith(" m/s")
    assert "mode: hover" in inside[-1] and "fault: gps loss, 8.00 to 12.00 s" in inside[-1], inside
    after = hover_over(page, "attitude", 0.9)
    assert "mode: land" in after[-1] and "gps loss" not in after[-1] and "°" in after[1], after
    assert page.errors == []


def test_what_is_looked_at_is_drawn_first(page, hover):
    """At an anchor far down the charts there come first, and nothing moves when others come."""
    page.size(1280, 900)
    page.call("Page.addScriptToEvaluateOnNewDocument", source=(
        "new MutationObserver(() => { const first = document.querySelector('.chart .scatterlayer');"
        " if (first && !window.firstDrawn) window.firstDrawn = first.closest('.chart').id;"
        " if (document.documentElement?.dataset.view && !window.placed) window.placed ="
        " document.getElementById('rotor').offsetTop; })"
        ".observe(document, {subtree: true, childList: true, attributes: true})"
    ))  # fmt: skip
    page.open(f"{hover.as_uri()}#rotor", READY)
    assert page.value("window.firstDrawn") in ("chart-rotor", "chart-estimate_attitude")
    assert page.value("document.getElementById('rotor').offsetTop - window.placed") == 0
    assert page.errors == []


@pytest.mark.slow
def test_theme_follows_the_system_and_the_button(page, hover):
    def background():
        return page.value("getComputedStyle(document.body).backgroundColor")

    def line():
        return page.value("document.getElementById('chart-wind').data[0].line.color")

    page.prefer("dark")
    open_all(page, hover)
    assert page.value("document.documentElement.dataset.theme") == "dark"
    dark = background(), line()
    page.value("document.getElementById('theme').click()")
    page.wait(f"document.getElementById('chart-wind').data[0].line.color !== '{dark[1]}'")
    assert page.value("document.documentElement.dataset.theme") == "light"
    assert background() != dark[0]
    assert page.errors == []


@pytest.mark.slow
def test_phone_needs_no_sideways_scrolling(page, hover):
    page.size(390, 844, phone=True)
    open_all(page, hover)
    assert page.value("document.documentElement.scrollWidth") <= 390
    widths = page.value(
        "[...document.querySelectorAll('.chart')].map(d => d.getBoundingClientRect().right)"
    )
    assert max(widths) <= 390
    # A finger scrolls the page; it does not zoom a chart.
    assert page.value("document.getElementById('chart-wind')._fullLayout.dragmode") is False
    assert page.errors == []


@pytest.mark.slow
def test_charts_are_no_stops_of_the_tab_key(page, hover):
    """What Tab reaches is read on the page: links, buttons, tables that scroll; no chart's."""
    open_all(page, hover)
    inside = "[...document.querySelectorAll('.chart *')].filter(e => e.tabIndex >= 0).length"
    assert page.value("document.querySelectorAll('.chart .modebar-btn').length") > 10
    assert page.value(inside) == 0
    # A zoom and another theme draw anew.
    page.value("document.getElementById('theme').click()")
    page.wait("document.getElementById('chart-wind')._fullLayout.width > 0")
    page.value("Plotly.relayout('chart-wind', {'xaxis.range': [5, 9]}).then(() => true)")
    assert page.value(inside) == 0
    named = "[...document.querySelectorAll('.chart')].every(e => e.getAttribute('aria-label'))"
    assert page.value(named)


@pytest.mark.slow
def test_a_table_that_scrolls_says_so_and_no_other_does(page, hover):
    boxes = """[...document.querySelectorAll('.scroll')].filter(e => e.offsetParent).map(e => [
      e.scrollWidth > e.clientWidth, e.tabIndex === 0, e.getAttribute('role') === 'region',
      getComputedStyle(e.previousElementSibling).display !== 'none'])"""
    wide = {}
    for width in (390, 1280):
        page.size(width, 844, phone=width == 390)
        open_all(page, hover)
        tables = page.value(boxes)
        assert tables and all(len(set(marks)) == 1 for marks in tables), tables
        wide[width] = sum(marks[0] for marks in tables)
    assert wide[390] > wide[1280]
    # Tables that are opened are looked at when they are.
    page.size(390, 844, phone=True)
    open_all(page, hover)
    page.value("document.querySelectorAll('details').forEach(e => { e.open = true; })")
    page.wait(f"{boxes}.every(said => new Set(said).size === 1)")
    assert page.errors == []


def test_the_first_screen_shows_verdict_numbers_and_both_charts(page, hover):
    """At 1280 x 900 all of it is in sight; the rest is folded and the page is short."""
    page.size(1280, 900)
    page.open(hover, READY)
    assert page.value("document.querySelectorAll('.verdict').length") == 1
    assert page.value("document.querySelectorAll('.numbers > div').length") == 4
    bottoms = page.value(
        "['.verdict', '.numbers', '#chart-first_altitude', '#chart-first_track', '.links'].map("
        "s => document.querySelector(s).getBoundingClientRect().bottom)"
    )
    assert bottoms[0] < bottoms[1] < min(bottoms[2:4]) and max(bottoms) == bottoms[-1] < 900
    assert page.value("document.documentElement.scrollHeight") < 2000
    assert page.value("document.querySelectorAll('details.section[open]').length") == 0
    # A section that is opened draws its charts; the others are not drawn for it.
    page.value("document.querySelector('#timeline details').open = true")
    page.wait("document.querySelector('#chart-timeline .scatterlayer .trace')")
    assert not page.value("Boolean(document.querySelector('#chart-wind .scatterlayer'))")
    assert page.errors == []


def test_the_header_has_commit_and_changed_parameters(drawn, hover):
    facts = drawn(hover).text(".facts")
    assert re.search(r"Commit\s+([0-9a-f]{10}|unknown)", facts)
    assert re.search(r"Changed\s+nothing", facts)


def test_what_nodes_said_is_text_not_markup(drawn, hover):
    text = drawn(hover).value("document.getElementById('timeline').innerText")
    assert "GPS <timeout> & more" in text


def test_nothing_of_the_page_points_outside(hover):
    text = hover.read_text(encoding="utf-8")
    markup = re.sub(r"<script.*?</script>", "", text, flags=re.S)
    targets = re.findall(r'(?:src|href)="([^"]+)"', markup)
    assert targets
    assert all(t.startswith(("#", "figures/")) for t in targets)
    assert {t for t in targets if t.startswith("figures/")} <= {
        f"figures/{path.name}" for path in (hover.parent / "figures").iterdir()
    }
