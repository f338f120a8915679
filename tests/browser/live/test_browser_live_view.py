# SPDX-License-Identifier: Apache-2.0
"""The live view's page in a real browser: what it shows, how it looks, when it is old or over."""

import math

import pytest


def off_origin(page, flight):
    addresses = (flight.url, flight.url.replace("http", "ws"))
    return [url for url in page.requests if not url.startswith((*addresses, "blob:", "data:"))]


def test_page_draws_everything_offline(page, flown):
    flight = flown()
    flight.open_in(page)
    page.wait("heliView.scene.drawn && heliView.fps > 0")
    # A canvas is drawn with the next words, not with the first picture: wait for each of them.
    page.wait(
        "[...document.querySelectorAll('canvas')].every(c => { const g = c.getContext('2d');"
        " if (!g) return true; const o = new OffscreenCanvas(c.width, c.height);"
        # A copy: Chrome complains of who reads the page's own often, as waiting may.
        " const r = o.getContext('2d', {willReadFrequently: true}); r.drawImage(c, 0, 0);"
        " const d = r.getImageData(0, 0, c.width, c.height).data;"
        " const seen = new Set(); for (let i = 0; i < d.length; i += 4) seen.add(d[i] * 65536 +"
        " d[i + 1] * 256 + d[i + 2]); return seen.size >= 3; })"
    )
    where = page.value("heliView.projected()")
    aircraft, shadow = where["helicopter"], where["shadow"]
    assert aircraft["y"] + 100 < shadow["y"] < where["height"]
    assert 0 < aircraft["y"] and abs(aircraft["x"] - shadow["x"]) < 30
    assert page.value("heliView.pixels(0, 0).colours") > 300
    assert page.text("#flight-name") == "HeLion · hover · seed 7 · 60 s"
    assert page.text("#mode") == "hover"
    assert page.text("#gps") == "0.12 s"
    assert page.text("#wind-speed") == "3.5 m/s"
    assert page.text("#wind-from") == "from 45° to 225°"
    assert page.text("#wind-nose") == "45° right of the nose"
    assert page.text("#actuators div:nth-child(3) output") == "−0.200"
    page.wait("document.querySelectorAll('#nodes li').length === 5")
    # The history that came with the greeting is in the charts at once.
    assert page.value("heliView.flight.rows.length") > 300
    # What nodes say is text.
    assert "GPS <b>late</b> & wrong" in page.text("#events")
    assert page.value("document.documentElement.scrollHeight") <= 900
    assert page.errors == []
    assert off_origin(page, flight) == []
    fps = page.value("heliView.fps")
    print(f"{fps:.0f} frames/s, {page.value('heliView.workMs'):.1f} ms of script per frame")


def test_the_page_can_send_to_its_own_server_only(page, flown):
    flight = flown(commands=True)
    flight.open_in(page)
    page.try_to_send()
    assert off_origin(page, flight) == []
    assert [url.rstrip("/") for url in page.tabs()] == [flight.url.rstrip("/")]
    # Its own connection has lived on.
    before = page.value("heliView.flight.last.t")
    page.wait(f"heliView.flight.last.t > {before}")


def test_errors_beside_the_paper_are_those_of_the_source(page, flown):
    """North-east of the reference by hand-computed numbers; the switch changes the source."""
    flight = flown(history_s=0.0)
    here, there = flight.body(0.0, 0.0), flight.body(0.0, 0.0)
    here |= {"p": [0.3, -0.2, 10.1], "v_enu": [0.11, 0.22, -0.15]}
    there |= {"p": [1.3, 0.9, 10.6]}
    ref = {"p": [0.0, 0.0, 10.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 90.0}
    flight.change = {"truth": here, "nav": there, "ref": ref}
    flight.open_in(page)
    row = "[...document.querySelectorAll('#bounds tr')].map(r => r.cells[1].innerText)"
    # The reference looks east: right is south.
    page.wait(f"{row}[0] === '+0.10'")
    assert page.value(row) == ["+0.10", "−0.15", "+0.11", "−0.22", "+0.20", "+0.30"]
    page.value("document.querySelector('input[value=nav]').click()")
    page.wait(f"{row}[0] === '+0.60'")
    assert page.value(row)[4:] == ["−0.90", "+1.30"]
    outside = "document.querySelectorAll('#bounds tr[data-in=false]').length"
    assert page.value(outside) == 2
    flight.change = {"nav": None, "truth": here, "ref": ref}
    page.wait(f"{row}[0] === '+0.10' && document.querySelector('input[value=nav]').disabled")
    assert page.errors == []


def test_largest_errors_are_the_nodes_of_the_flight_and_of_the_windows(page, flown):
    """The climb counts over the whole flight, not in the windows; the switch changes the record."""
    flight = flown(history_s=0.0)
    flight.change = {"largest": {
        "whole": {"truth": {"altitude_m": 1.93}, "nav": {"altitude_m": 2.01}},
        "windows": {"truth": {"altitude_m": 0.25}, "truth_less_drift": {"altitude_m": 0.31}},
        "since_s": 0.0,
        "climb": {"truth": {"climb_overshoot": 0.17, "climb_time": None, "climb_lag": 0.78}},
    }}  # fmt: skip
    flight.open_in(page)
    cells = "[...document.querySelector('#bounds tr').cells]"
    page.wait(f"{cells}[2].innerText === '1.93'")
    shown = page.value(f"{cells}.slice(2, 6).map(c => [c.innerText, c.dataset.in])")
    assert shown == [["1.93", "false"], ["0.25", "true"], ["0.31", "true"], ["0.40", None]]
    for width in (1440, 1280):
        page.size(width, 900)
        room = (
            "(t => t.parentElement.getBoundingClientRect().right - t.getBoundingClientRect().right)"
        )
        assert page.value(f"{room}(document.querySelector('.bounds'))") > -0.5, (
            "a column is cut off"
        )
    bounds = "document.getElementById('bounds-of').innerText"
    assert page.value(bounds) == "ground truth"
    climb = "document.getElementById('climb')"
    assert page.value(f"{climb}.innerText") == (
        "climb: overshoot 0.17 m, time not reached, lag 0.78 s"
    )
    page.value("document.querySelector('input[value=nav]').click()")
    page.wait(f"{cells}[2].innerText === '2.01' && {cells}[3].innerText === '–'")
    assert page.value(f"{cells}[4].innerText") == "–"
    assert page.value(f"{climb}.hidden")
    # Who came late says so: what was before is not in it.
    flight.change["largest"]["since_s"] = 12.3
    page.wait(f"{bounds} === 'navigation, as in the paper, from 12 s on'")
    assert page.errors == []


def test_disc_tilts_the_way_the_thrust_does(page, flown):
    """Positive a_s tilts the thrust backwards, positive b_s to the right (FLU: -y)."""
    flight = flown(history_s=0.0)
    flight.change = {"rotor_truth": {"a_s_deg": 2.0, "b_s_deg": 1.0, "d_int": 0.0}}
    flight.open_in(page)
    page.wait("Math.abs(heliView.scene.helicopter.disc.rotation.y) > 0.17")
    x, y, z = page.value(
        "(() => { const h = heliView.scene.helicopter; h.disc.updateMatrix();"
        " return [8, 9, 10].map(i => h.disc.matrix.elements[i]); })()"
    )
    factor = 5.0
    assert x == pytest.approx(-math.sin(math.radians(2.0 * factor)), abs=0.01)
    assert y == pytest.approx(-math.sin(math.radians(1.0 * factor)), abs=0.01)
    assert z > 0.95


@pytest.mark.slow
def test_view_says_when_it_is_old_over_or_cut_off_and_comes_back(page, flown):
    flight = flown()
    flight.open_in(page)
    flight.hush()
    page.wait("document.getElementById('banner-text').innerText.startsWith('No state comes')")
    assert page.text("#connection-text") == "stale"
    over = {"kind": "over", "text": "flight over after 50 s"}
    flight.send(50.0, mode="over", end=over)
    page.wait("document.getElementById('connection').dataset.state === 'over'")
    assert page.text("#banner-text").startswith("The flight is over after 50.0 s.")
    flight.end()
    page.wait("!document.getElementById('retry').hidden")
    assert "Its server has ended" in page.text("#banner-text")
    # The next flight at the same address begins earlier: what was drawn of the last one is gone.
    flown(port=flight.port, start_s=3.0, history_s=2.0)
    page.wait(flight.LIVE)
    page.wait("heliView.flight.last.t < 10 && heliView.flight.rows.at(-1).t < 10")
    assert page.value("document.getElementById('banner').hidden")
    refused = [error for error in page.errors if "ERR_CONNECTION_REFUSED" not in error]
    assert refused == []


def test_phone_needs_no_sideways_scrolling(page, flown):
    flight = flown()
    page.call(
        "Emulation.setEmulatedMedia",
        features=[{"name": "prefers-reduced-motion", "value": "reduce"}],
    )
    flight.open_in(page, 390, 844, phone=True)
    page.wait("heliView.scene.drawn")
    assert page.value("document.documentElement.scrollWidth") <= 390
    # Labels in space, chart insides and meters are cut off at their own edges.
    widest = page.value(
        "Math.max(...[...document.querySelectorAll('main *')].filter(e => e.getClientRects().length"
        " && !e.closest('.plot, .labels, .meter')).map(e => e.getBoundingClientRect().right))"
    )
    assert widest <= 390
    where = page.value("heliView.projected()")
    assert 0 < where["helicopter"]["y"] < where["shadow"]["y"] < where["height"]
    # Who asked for less motion sees a rotor that stands.
    assert page.value("heliView.scene.helicopter.blades.rotation.z") == 0
    assert page.errors == []


@pytest.mark.slow
def test_theme_and_camera_by_keyboard(page, flown):
    flight = flown()
    page.prefer("dark")
    flight.open_in(page)
    dark = page.value("getComputedStyle(document.body).backgroundColor")
    page.value("document.getElementById('theme').click()")
    assert page.value("getComputedStyle(document.body).backgroundColor") != dark
    page.value("document.getElementById('scene').focus()")
    for key, mode in (("2", "orbit"), ("3", "top"), ("4", "close"), ("1", "chase")):
        page.call("Input.dispatchKeyEvent", type="keyDown", key=key)
        assert page.value("document.querySelector('[aria-pressed=true]').dataset.camera") == mode
    page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
    assert page.value("heliView.scene.view.mode") == "orbit"
    # Everything that can be pressed or filled in has a name.
    nameless = page.value(
        "[...document.querySelectorAll('button, input')].filter(e => !(e.innerText ||"
        " e.ariaLabel || e.labels?.[0]?.innerText)).length"
    )
    assert nameless == 0
    assert page.errors == []


@pytest.mark.slow
def test_charts_keep_both_bounds_in_view(page, flown):
    """Also where the lines are far on one side; about the setpoint where the bound is so."""
    flight = flown(history_s=0.0)
    away = flight.body(0.0, 0.0) | {"p": [0.0, 0.0, 13.0]}
    flight.change = {"truth": away, "nav": away, "setpoint_deg": [-12.0, 9.0, 0.0]}
    flight.open_in(page)
    charts = "heliView.parts.charts.charts"
    page.wait(f"{charts}.every(c => c.data[0].length > 3) && {charts}[0].range[1] > 3")
    shown = page.value(f"{charts}.map(c => [c.plot.scales.y.min, c.plot.scales.y.max, c.bound])")
    for low, high, bound in shown[:3]:
        assert low < -bound < bound < high
    assert shown[0][1] > 3.0 and shown[0][0] > -1.0, "not symmetric for its own sake"
    for (low, high, bound), asked, flies in zip(shown[3:5], (-12.0, 9.0), (4.0, 2.0), strict=True):
        assert low < asked - bound and asked + bound < high and low < flies < high
    # The actuators' limits are none of the paper's figures: small movements stay large.
    assert shown[5][1] - shown[5][0] < 2.0
    assert page.errors == []
