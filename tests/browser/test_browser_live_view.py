# SPDX-License-Identifier: Apache-2.0
"""The live view's page in a real browser, served by the real server, with states made here."""

import json
import math
import threading
from pathlib import Path

import numpy as np
import pytest

from heli_live_view.access import Access
from heli_live_view.page_server import PageServer
from heli_live_view.parameter_table import BOUNDS as METRIC_OF
from heli_live_view.vehicle import bounds, error_row

WEB = Path(__file__).resolve().parents[2] / "src/heli_live_view/web"
LIVE = "document.getElementById('connection').dataset.state === 'live'"
TOKEN = "token-of-this-test"
BOUNDS = bounds({f"bounds.{name}": -1.0 for name in METRIC_OF})
LIMITS = {
    "altitude_min_m": 2.0, "altitude_max_m": 100.0, "distance_m": 100.0, "speed_mps": 2.0,
    "climb_mps": 1.0, "turn_dps": 10.0, "gust_mps": 10.0, "gust_s": 20.0,
}  # fmt: skip
NODES = ("plant", "observer", "inner_loop", "outer_loop", "live_view")


def hello(commands=False, history=(), realtime=True):
    return {
        "type": "hello", "commands": commands,
        "flight": {"scenario": "hover", "seed": 7, "duration_s": 60.0, "realtime": realtime},
        "aircraft": {"name": "HeLion", "rotor_radius_m": 0.705},
        "bounds": BOUNDS, "limits": LIMITS, "foxglove_url": "ws://127.0.0.1:8765", "state_hz": 30,
        "events": [{"type": "event", "t": 1.5, "level": 1, "source": "observer",
                    "text": "GPS <b>late</b> & wrong"}],
        "history": list(history),
    }  # fmt: skip


def body(t, shift):
    """A vehicle that sways about (0, 0, 10) with its nose to the north, banked by 4 degrees."""
    phi, theta = math.radians(4.0 + math.sin(t)), math.radians(2.0 * math.cos(0.7 * t))
    e, n = shift + 0.5 * math.sin(0.5 * t), 0.3 * math.cos(0.4 * t)
    # FLU -> ENU: yaw of 90 degrees, then pitch (nose down positive in FLU), then roll.
    half = (0.5 * phi, -0.5 * theta, 0.25 * math.pi)
    (cr, cp, cy), (sr, sp, sy) = (tuple(map(f, half)) for f in (math.cos, math.sin))
    q = [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
         cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]  # fmt: skip
    v = [0.25 * math.cos(0.5 * t), -0.12 * math.sin(0.4 * t), 0.1 * math.sin(t)]
    return {
        "p": [e, n, 10.0 + 0.25 * math.sin(t) + 0.5 * shift], "q": q, "v_enu": v,
        "v_body": [v[1], -v[0], v[2]],
        "euler_deg": [math.degrees(phi), math.degrees(theta), 0.0], "rates_dps": [0.0, 0.0, 0.0],
    }  # fmt: skip


def state(t, **changed):
    nodes = {name: {"state": "active", "level": 0, "message": ""} for name in NODES}
    made = {
        "type": "state", "t": round(t, 3), "rtf": 1.0, "truth": body(t, 0.0), "nav": body(t, 0.4),
        "ref": {"p": [0.0, 0.0, 10.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 0.0},
        "setpoint_deg": [4.0, 0.0, 0.0],
        "u": [0.1 * math.sin(t), 0.05, -0.2, 0.35 + 0.05 * math.sin(t)],
        "rotor": {"a_s_deg": 0.5, "b_s_deg": -0.8, "d_int": 0.1},
        "rotor_truth": {"a_s_deg": math.sin(t), "b_s_deg": -1.2, "d_int": 0.1},
        "wind_enu": [-2.5, -2.5, 0.2], "sigma_p": [0.2, 0.25, 0.3], "mode": "hover",
        "nodes": nodes, "alarms": [], "gps": {"age_s": 0.12}, **changed,
    }  # fmt: skip
    return made | {source: with_error(made[source], made["ref"]) for source in ("truth", "nav")}


def with_error(vehicle, ref):
    """The vehicle with its errors from the reference, as the live view's node gives them."""
    if vehicle is None or ref is None:
        return vehicle
    ned = [
        np.array([n, e, -up]) for e, n, up in (vehicle["p"], vehicle["v_enu"], ref["p"], ref["v"])
    ]
    reference = np.hstack([*ned[2:], math.radians(ref["yaw_deg"])])
    return vehicle | {"error": error_row(*ned[:2], reference)}


class Flight:
    """States at 30 Hz through the product's own server; `change` alters what comes next."""

    def __init__(self, port=0, commands=False, start_s=40.0, history_s=35.0, realtime=True):
        self.change, self.received, self._realtime = {}, [], realtime
        self._t, self._commands, self._history_s = start_s, commands, history_s
        access = Access(TOKEN if commands else "")
        self.server = PageServer(WEB, port, access, self._hello, self._on_command)
        self.url, self.port = self.server.url, self.server.port
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)
        self.server.start()
        self._thread.start()

    def _hello(self):
        times = [self._t - 0.1 * k for k in range(round(10 * self._history_s), 0, -1)]
        rows = [state(t, nodes={}) for t in times]
        return json.dumps(hello(self._commands, rows, self._realtime))

    def _on_command(self, command):
        self.received.append((command.name, command.args))
        command.reply(True, f"{command.name} taken")

    def _fly(self):
        while not self._stop.wait(1.0 / 30.0):
            self._t += 1.0 / 30.0
            self.server.send_state(json.dumps(state(self._t, **self.change)))

    def hush(self):
        """Send no more states; the connection stays."""
        self._stop.set()
        self._thread.join()

    def end(self):
        self.hush()
        self.server.stop()


@pytest.fixture
def flown():
    """Make flights that end with the test."""
    made = []

    def make(**options):
        made.append(Flight(**options))
        return made[-1]

    yield make
    for flight in made:
        flight.end()


def text(page, selector):
    return page.value(f"document.querySelector({json.dumps(selector)}).innerText")


def look(page, flight, width=1440, height=900, phone=False, **options):
    page.size(width, height, phone)
    page.open(flight.url, LIVE, **options)


def off_origin(page, flight):
    own = (flight.url, flight.url.replace("http", "ws"))
    return [url for url in page.requests if not url.startswith((*own, "blob:", "data:"))]


def test_page_draws_everything_offline(page, flown):
    flight = flown()
    look(page, flight)
    page.wait("heliView.scene.drawn && heliView.fps > 0")
    blank = page.value(
        "[...document.querySelectorAll('canvas')].filter(c => { const g = c.getContext('2d');"
        " if (!g) return false; const d = g.getImageData(0, 0, c.width, c.height).data;"
        " const seen = new Set(); for (let i = 0; i < d.length; i += 4) seen.add(d[i] * 65536 +"
        " d[i + 1] * 256 + d[i + 2]); return seen.size < 3; }).map(c => c.id || c.className)"
    )
    assert blank == []
    where = page.value("heliView.projected()")
    aircraft, shadow = where["helicopter"], where["shadow"]
    assert aircraft["y"] + 100 < shadow["y"] < where["height"]
    assert 0 < aircraft["y"] and abs(aircraft["x"] - shadow["x"]) < 30
    assert page.value("heliView.pixels(0, 0).colours") > 300
    assert text(page, "#flight-name") == "HeLion · hover · seed 7 · 60 s"
    assert text(page, "#mode") == "hover"
    assert text(page, "#gps") == "0.12 s"
    assert text(page, "#wind-speed") == "3.5 m/s"
    assert text(page, "#wind-from") == "from 45° to 225°"
    assert text(page, "#wind-nose") == "45° right of the nose"
    assert text(page, "#actuators div:nth-child(3) output") == "−0.200"
    page.wait("document.querySelectorAll('#nodes li').length === 5")
    # The history that came with the greeting is in the charts at once.
    assert page.value("heliView.flight.rows.length") > 300
    # What nodes say is text.
    assert "GPS <b>late</b> & wrong" in text(page, "#events")
    assert page.value("document.documentElement.scrollHeight") <= 900
    assert page.errors == []
    assert off_origin(page, flight) == []
    fps = page.value("heliView.fps")
    print(f"{fps:.0f} frames/s, {page.value('heliView.workMs'):.1f} ms of script per frame")


def test_the_page_can_send_to_its_own_server_only(page, flown):
    flight = flown(commands=True)
    look(page, flight)
    page.try_to_send()
    assert off_origin(page, flight) == []
    assert [url.rstrip("/") for url in page.tabs()] == [flight.url.rstrip("/")]
    # Its own connection has lived on.
    before = page.value("heliView.flight.last.t")
    page.wait(f"heliView.flight.last.t > {before}", 5)


def test_errors_beside_the_paper_are_those_of_the_source(page, flown):
    """North-east of the reference by hand-computed numbers; the switch changes the source."""
    flight = flown(history_s=0.0)
    here, there = body(0.0, 0.0), body(0.0, 0.0)
    here |= {"p": [0.3, -0.2, 10.1], "v_enu": [0.11, 0.22, -0.15]}
    there |= {"p": [1.3, 0.9, 10.6]}
    ref = {"p": [0.0, 0.0, 10.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 90.0}
    flight.change = {"truth": here, "nav": there, "ref": ref}
    look(page, flight)
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


def test_a_climb_is_not_compared_with_hover(page, flown):
    """The paper's figures are of hover: what happens while the reference moves does not count."""
    flight = flown(history_s=0.0)
    near = body(0.0, 0.0) | {"p": [0.0, 0.0, 10.1], "v_enu": [0.0, 0.0, 0.0]}
    standing = {"p": [0.0, 0.0, 10.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 0.0}
    flight.change = {"truth": near, "nav": near, "ref": standing}
    look(page, flight)
    cell = "document.querySelector('#bounds tr').cells[{}].innerText"
    told = "document.getElementById('bounds-of').innerText"
    page.wait(f"{cell.format(2)} === '0.10' && {told} === 'ground truth'")
    flight.change |= {"ref": {"p": [0.0, 0.0, 12.0], "v": [0.0, 0.0, 2.5], "yaw_deg": 0.0}}
    page.wait(f"{cell.format(1)} === '−1.90' && {told}.includes('once it hovers')")
    compared = "heliView.flight.rows.filter(row => row.hover)"
    page.wait("heliView.flight.rows.filter(row => !row.hover).length > 10")
    assert page.value(f"{compared}.every(row => Math.abs(row.truth.error.altitude_m) < 0.2)")
    assert page.value(cell.format(2)) == "0.10"
    flight.change |= {"ref": standing}
    page.wait(f"{told} === 'ground truth'")
    assert page.value(cell.format(2)) == "0.10" and page.errors == []


def test_disc_tilts_the_way_the_thrust_does(page, flown):
    """Positive a_s tilts the thrust backwards, positive b_s to the right (FLU: -y)."""
    flight = flown(history_s=0.0)
    flight.change = {"rotor_truth": {"a_s_deg": 2.0, "b_s_deg": 1.0, "d_int": 0.0}}
    look(page, flight)
    page.wait("Math.abs(heliView.scene.helicopter.disc.rotation.y) > 0.17")
    x, y, z = page.value(
        "(() => { const h = heliView.scene.helicopter; h.disc.updateMatrix();"
        " return [8, 9, 10].map(i => h.disc.matrix.elements[i]); })()"
    )
    factor = 5.0
    assert x == pytest.approx(-math.sin(math.radians(2.0 * factor)), abs=0.01)
    assert y == pytest.approx(-math.sin(math.radians(1.0 * factor)), abs=0.01)
    assert z > 0.95


def test_view_says_when_it_is_old_over_or_cut_off_and_comes_back(page, flown):
    flight = flown()
    look(page, flight)
    flight.hush()
    page.wait("document.getElementById('banner-text').innerText.startsWith('No state comes')")
    assert text(page, "#connection-text") == "stale"
    over = {"kind": "over", "text": "flight over after 50 s"}
    flight.server.send_state(json.dumps(state(50.0, mode="over", end=over)))
    page.wait("document.getElementById('connection').dataset.state === 'over'")
    assert text(page, "#banner-text").startswith("The flight is over after 50.0 s.")
    flight.end()
    page.wait("!document.getElementById('retry').hidden")
    assert "Its server has ended" in text(page, "#banner-text")
    # The next flight at the same address begins earlier: what was drawn of the last one is gone.
    flown(port=flight.port, start_s=3.0, history_s=2.0)
    page.wait(LIVE)
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
    look(page, flight, 390, 844, phone=True)
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


def test_theme_and_camera_by_keyboard(page, flown):
    flight = flown()
    page.prefer("dark")
    look(page, flight)
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


def test_view_only_page_has_nothing_to_press(page, flown):
    look(page, flown())
    shown = "document.querySelector('#commands').getClientRects().length"
    assert page.value(shown) == 0
    assert text(page, "#permission").startswith("View only.")


def allowed(page, flight, **options):
    """Look at a flight with the token shown: the commands can be pressed."""
    look(page, flight, **options)
    page.value(f"document.getElementById('token').value = '{TOKEN}'")
    submit(page, "token")
    answered(page, "allowed")
    page.wait("document.querySelectorAll('#commands fieldset:disabled').length === 0")


def answered(page, word):
    page.wait(f"document.getElementById('answer').innerText.includes({json.dumps(word)})")


def submit(page, form):
    page.value(f"document.querySelector('#f-{form} button:not([type=button])').click()")


def press(page, key):
    for kind in ("keyDown", "keyUp"):
        page.call("Input.dispatchKeyEvent", type=kind, key=key, code=key,
                  windowsVirtualKeyCode={"Enter": 13, "Escape": 27, "Tab": 9}[key],
                  text="\r" if key == "Enter" and kind == "keyDown" else "")  # fmt: skip


def test_commands_need_the_token_and_tell_the_answer(page, flown):
    flight = flown(commands=True)
    look(page, flight)
    assert page.value("document.querySelectorAll('#commands fieldset:disabled').length") == 3
    page.value("document.getElementById('token').value = 'guess'")
    submit(page, "token")
    answered(page, "wrong token")
    page.value(f"document.getElementById('token').value = '{TOKEN}'")
    submit(page, "token")
    answered(page, "allowed")
    assert page.value("document.getElementById('token').value") == ""
    page.wait("document.querySelectorAll('#commands fieldset:disabled').length === 0")
    submit(page, "gust")
    answered(page, "gust taken")
    assert page.value("document.getElementById('answer').dataset.ok") == "true"
    page.value("document.getElementById('pick').click()")
    x, y = page.value(
        "(() => { const r = document.getElementById('track').getBoundingClientRect();"
        " const k = 0.5 * Math.min(r.width, r.height) / 2;"
        " return [r.left + r.width / 2 + k, r.top + r.height / 2 - 0.5 * k]; })()"
    )
    page.drag((x, y), (x, y))
    answered(page, "1.0 m east, 0.5 m north picked")
    submit(page, "reference")
    answered(page, "reference taken")
    assert flight.received == [
        ("gust", {"amplitude_mps": 2, "from_deg": 45, "duration_s": 2}),
        ("reference", {"p": [1, 0.5, 10], "yaw_deg": 0}),
    ]
    assert page.errors == []


def test_giving_up_the_hold_asks_first_and_is_no_success_when_done(page, flown):
    flight = flown(commands=True)
    allowed(page, flight)
    told = text(page, "#tells-mode")
    assert "nothing holds position and altitude" in told
    attitude = "document.querySelector('#f-mode [value=attitude]')"
    opened = "document.getElementById('ask').open"

    # By keyboard: the question has the focus on Cancel; Enter and Escape mean no.
    for key in ("Enter", "Escape"):
        page.value(f"{attitude}.focus()")
        press(page, "Enter")
        page.wait(opened)
        assert page.value("document.activeElement.dataset.part") == "no"
        asked = text(page, "#ask-text")
        assert "hits the ground" in asked and " m high now" in asked
        press(page, key)
        page.wait(f"!{opened}")
        answered(page, "mode: not sent")
    assert flight.received == []

    page.value(f"{attitude}.click()")
    page.wait(opened)
    press(page, "Tab")
    assert page.value("document.activeElement.innerText") == "Give up the hold"
    press(page, "Enter")
    answered(page, "mode taken")
    assert flight.received == [("mode", {"mode": "attitude"})]
    assert page.value("document.getElementById('answer').dataset.ok") == "danger"
    bad, good = page.value(
        "['--bad', '--good'].map(name => { const p = document.createElement('p');"
        " p.style.color = `var(${name})`; document.body.append(p);"
        " const c = getComputedStyle(p).color; p.remove(); return c; })"
    )
    colour = page.value("getComputedStyle(document.getElementById('answer')).color")
    assert colour == bad != good

    # While nothing holds it, the page says so on top; back to hover needs no question.
    flight.change = {"mode": "attitude"}
    page.wait("document.getElementById('banner-text').innerText.startsWith('Attitude only')")
    assert page.value(f"{attitude}.disabled")
    page.value("document.querySelector('#f-mode [value=hover]').click()")
    answered(page, "mode taken")
    assert flight.received[1:] == [("mode", {"mode": "hover"})]
    assert not page.value(opened) and page.errors == []


@pytest.mark.parametrize(
    ("form", "values", "word"),
    [
        ("gust", {"amplitude_mps": 9}, "several metres"),
        ("reference", {"u": 2.5}, "bring the helicopter to the ground"),
    ],
)
def test_a_strong_gust_and_a_low_reference_ask_first(page, flown, form, values, word):
    flight = flown(commands=True)
    allowed(page, flight)
    write(page, form, values)
    submit(page, form)
    page.wait("document.getElementById('ask').open")
    assert word in text(page, "#ask-text") and flight.received == []
    page.value("document.querySelector('#ask [data-part=yes]').click()")
    answered(page, f"{form} taken")
    assert [name for name, _ in flight.received] == [form]
    assert page.errors == []


def write(page, form, values):
    """Write into a form as a user does."""
    for name, value in values.items():
        page.value(
            f"(() => {{ const f = document.getElementById('f-{form}').elements.{name};"
            f" f.value = {value}; f.dispatchEvent(new Event('input', {{bubbles: true}})); }})()"
        )


def test_the_reference_form_follows_the_flight_until_it_is_edited(page, flown):
    flight = flown(commands=True)
    flight.change = {"ref": {"p": [1.0, -0.5, 20.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 90.0}}
    allowed(page, flight)
    fields = (
        "['e', 'n', 'u', 'yaw'].map(n => document.getElementById('f-reference').elements[n].value)"
    )
    page.wait(f"{fields}.join() === '1.0,-0.5,20.0,90'")
    assert text(page, "#tells-reference").startswith("The reference stays where it is.")
    flight.change = {"ref": {"p": [0.0, 0.0, 12.0], "v": [0.0, 0.0, 0.0], "yaw_deg": -10.0}}
    page.wait(f"{fields}.join() === '0.0,0.0,12.0,-10'")

    write(page, "reference", {"e": 3, "n": 4, "u": 15})
    flight.change = {"ref": {"p": [0.0, 0.0, 11.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 10.0}}
    page.wait("heliView.flight.last.ref.p[2] === 11")
    expected = "5.0 m to the north-east, 4.0 m up, 20° to the left in 4 s"
    page.wait(f"document.getElementById('tells-reference').innerText.includes('{expected}')")
    assert page.value(fields) == ["3", "4", "15", "-10"]
    page.value("document.getElementById('follow').click()")
    page.wait(f"{fields}.join() === '0.0,0.0,11.0,10'")
    assert flight.received == [] and page.errors == []


@pytest.mark.parametrize(
    ("kind", "word", "sentence"),
    [
        ("lost", "lost", "LOST after "),
        ("over", "flight over", "The flight is over after "),
        ("interrupted", "interrupted", "Interrupted after "),
        ("silent", "signal lost", "Signal lost after "),
    ],
)
def test_the_end_and_its_cause_stand_on_top_and_nothing_can_be_sent(
    page, flown, kind, word, sentence
):
    flight = flown(commands=True)
    allowed(page, flight)
    page.value("document.querySelector('#f-mode [value=attitude]').click()")
    page.wait("document.getElementById('ask').open")
    cause = "The aircraft hit the ground: <too> fast."
    flight.change = {"mode": "over", "end": {"kind": kind, "text": cause}}
    page.wait(f"document.getElementById('connection').dataset.state === '{kind}'")
    # The question about a command that cannot be given any more is taken back.
    page.wait("!document.getElementById('ask').open")
    assert page.value("document.querySelectorAll('#commands fieldset:disabled').length") == 3
    pressable = (
        "[...document.querySelectorAll('#commands button')].filter(b => !b.matches(':disabled'))"
    )
    assert page.value(f"{pressable}.length") == 0
    assert text(page, "#answer").startswith("The flight has ended")
    assert flight.received == []
    assert text(page, "#connection-text").lower() == word
    told = text(page, "#banner-text")
    assert told.startswith(sentence) and (cause in told) == (kind != "over")
    top, bottom = page.value(
        "(() => { const r = document.getElementById('banner').getBoundingClientRect();"
        " return [r.top, r.bottom]; })()"
    )
    assert 0 <= top < bottom < 130
    ground = page.value("getComputedStyle(document.getElementById('banner')).backgroundColor")
    assert (ground == "rgb(176, 68, 0)") == (kind == "lost")
    assert page.value("document.title").startswith("✖ LOST") == (kind == "lost")
    assert page.errors == []


def test_a_flight_in_lockstep_cannot_be_commanded(page, flown):
    flight = flown(commands=True, realtime=False)
    look(page, flight)
    page.value(f"document.getElementById('token').value = '{TOKEN}'")
    submit(page, "token")
    answered(page, "lockstep")
    assert page.value("document.querySelectorAll('#commands fieldset:disabled').length") == 3


def test_on_a_phone_the_question_and_the_loss_fit(page, flown, tmp_path):
    flight = flown(commands=True)
    page.prefer("dark")
    allowed(page, flight, width=390, height=844, phone=True)
    page.value("document.querySelector('#f-mode [value=attitude]').click()")
    page.wait("document.getElementById('ask').open")
    left, right = page.value(
        "(() => { const r = document.getElementById('ask').getBoundingClientRect();"
        " return [r.left, r.right]; })()"
    )
    assert 0 <= left < right <= 390
    flight.change = {"mode": "over", "end": {"kind": "lost", "text": "The aircraft rolled over."}}
    page.wait("document.getElementById('connection').dataset.state === 'lost'")
    # It stays in sight further down, too.
    page.value("window.scrollTo(0, document.body.scrollHeight)")
    assert page.value("document.getElementById('banner').getBoundingClientRect().top") == 0
    assert page.value("document.documentElement.scrollWidth") <= 390
    assert page.errors == []


@pytest.mark.parametrize("size", [(1440, 900), (1366, 768), (1120, 800), (900, 1100)])
def test_commands_cover_nothing(page, flown, size):
    flight = flown(commands=True)
    allowed(page, flight, width=size[0], height=size[1])
    write(page, "reference", {"e": 30, "n": -4, "u": 35})
    flight.change = {"mode": "over", "end": {"kind": "lost", "text": "The aircraft flew away."}}
    page.wait("document.getElementById('connection').dataset.state === 'lost'")
    bottom, top = page.value(
        "[Math.max(...[...document.querySelectorAll('#commands *')].map("
        "e => e.getBoundingClientRect().bottom)),"
        " document.querySelector('footer').getBoundingClientRect().top]"
    )
    assert bottom <= top
    assert page.value("document.documentElement.scrollWidth") <= size[0]
