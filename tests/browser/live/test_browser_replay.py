# SPDX-License-Identifier: Apache-2.0
"""A recorded flight in a real browser: seek, pause, speed, keys, events; one that was cut off."""

import json
import shutil

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.replay import replay_of, served
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from support.record_bag import cut_off, flown_folder

DURATION_S = 8.0
FAULT = "{what: gps, kind: loss, start_s: 3.0, duration_s: 2.0}"
SHOWN = "window.heliView && heliView.scene.drawn && heliView.flight.last?.replay"
STANDS = "heliView.flight.stands"
AT = "document.getElementById('replay-at')"
KEYS = {" ": 32, "ArrowLeft": 37, "ArrowRight": 39, "Home": 36, "End": 35, "n": 78, "p": 80,
        ",": 188, ".": 190, "-": 189, "+": 187}  # fmt: skip


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    settings = resolve(duration_s=DURATION_S, overrides={"plant": {"faults": [FAULT]}})
    folder = flown_folder(tmp_path_factory.mktemp("flown") / "flight", settings)
    windows = {"stretch": "scored windows", "when": "5 to 8 s", "inside": True, "decides": True}
    result = {"flown_s": 8.0, "notes": ["a <b>note</b>"], "verdicts": {"windows": windows}}
    (folder / "result.json").write_text(json.dumps(result))
    (folder / "report.html").write_text(
        "<title>the report</title><script>document.title += window.origin</script>"
    )
    return folder


@pytest.fixture
def shown(flight):
    """The address of the flight's replay."""
    replay, beside = replay_of(flight)
    with served(replay, 0, beside) as server:
        yield server.url


@pytest.fixture(scope="module")
def truth(flight):
    return read_bag(flight / "bag").streams[topics.TRUTH_ODOM]


def press(page, key, shift=False):
    for kind in ("keyDown", "keyUp"):
        text = {"text": key} if kind == "keyDown" and len(key) == 1 else {}
        page.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=8 if shift else 0,
                  windowsVirtualKeyCode=KEYS[key], **text)  # fmt: skip


def seek(page, time_s):
    """Draw the slider there, and wait until the state of that time has come."""
    page.value(f"{AT}.value = {time_s}; {AT}.dispatchEvent(new Event('input'))")
    at(page, time_s)


def at(page, time_s):
    page.wait(f"{STANDS} && Math.abs(heliView.flight.last.t - {time_s}) < 0.004")


def paused(page, url, time_s=0.0, **size):
    page.size(**{"width": 1440, "height": 900, **size})
    page.open(f"{url}#t={time_s}", SHOWN)
    at(page, time_s)


@pytest.mark.slow
def test_it_plays_by_itself_pauses_seeks_and_shows_the_records_values(page, shown, truth):
    page.size(1440, 900)
    page.open(shown, SHOWN)
    page.wait("heliView.flight.last.t > 0.5 && heliView.flight.last.replay.runs")
    press(page, " ")
    page.wait(STANDS)
    for time_s in (6.5, 2.25, 7.99, 0.0, 3.33):
        seek(page, time_s)
        north, east, down = truth.rows[round(100 * time_s), :3]
        assert page.value("heliView.flight.last.truth.p") == pytest.approx(
            [east, north, -down], abs=5e-5
        )
        # What is drawn is that state, not one between, and the charts end there.
        drawn = page.value("heliView.flight.sample(performance.now())")
        assert drawn["t"] == pytest.approx(time_s, abs=1e-9)
        times = page.value("heliView.flight.rows.map(row => row.t)")
        assert times[0] == 0.0 and times == sorted(times)
        assert time_s - 0.071 < times[-1] <= time_s
        for row in page.value("heliView.flight.rows")[:: max(1, len(times) // 5)]:
            n, e, d = truth.rows[round(100 * row["t"]), :3]
            assert row["truth"]["p"] == pytest.approx([e, n, -d], abs=5e-5)
    page.wait("document.getElementById('replay-time').innerText === '3.33 s of 7.99 s'")
    page.wait("document.getElementById('time').innerText === '0:03.3'")
    assert page.text("#connection-text") == "replay, paused"
    page.wait("location.hash === '#t=3.33'")
    assert page.errors == []


def test_seeks_are_answered_in_the_order_of_their_wishes(page, shown):
    """While the slider is drawn, what is shown never goes back to an earlier wish."""
    paused(page, shown)
    page.value(
        "(() => { window.seen = []; const f = heliView.flight, old = f.wind.bind(f);"
        " f.wind = (m) => { seen.push(m.t); old(m); };"
        f" for (let k = 1; k <= 60; k += 1) {{ {AT}.value = 0.1 * k;"
        f" {AT}.dispatchEvent(new Event('input')); }} }})()"
    )
    at(page, 6.0)
    answers = page.value("window.seen")
    assert answers == sorted(answers) and answers[-1] == 6.0
    assert len(answers) < 30, "of the wishes in between only the last is sent"
    assert page.errors == []


@pytest.mark.slow
def test_keys_go_by_seconds_ticks_events_and_change_the_speed(page, shown):
    paused(page, shown, 4.0)
    lands_s = page.value("heliView.flight.events.find(event => event.t > 4.05).t")
    assert 4.0 < lands_s < 5.0
    for key, shift, time_s in (
        ("ArrowRight", False, 5.0), ("ArrowLeft", False, 4.0), (".", False, 4.01),
        (",", False, 4.0), ("n", False, lands_s), ("p", False, 3.0), ("ArrowRight", True, 7.99),
        ("Home", False, 0.0), ("End", False, 7.99),
    ):  # fmt: skip
        press(page, key, shift)
        at(page, time_s)
    press(page, "Home")
    at(page, 0.0)
    for key, speed in (
        ("+", 2),
        ("+", 4),
        ("-", 2),
        ("-", 1),
        ("-", 0.5),
        ("-", 0.25),
        ("-", 0.25),
    ):
        press(page, key)
        page.wait(f"heliView.flight.last.replay.speed === {speed}")
    page.wait("document.getElementById('rtf').innerText === '0.25×'")
    # On the picture the arrows turn the camera; in a choice they choose.
    page.value("document.getElementById('scene').focus()")
    press(page, "ArrowRight")
    page.wait("heliView.scene.view.mode === 'orbit'")
    assert page.value("heliView.flight.last.t") == 0.0
    page.value("document.querySelector('input[name=source]').focus()")
    press(page, "ArrowRight")
    assert page.value("heliView.flight.last.t") == 0.0
    assert page.errors == []


def test_a_wish_outlives_the_connection_that_breaks(page, shown):
    """A loaded machine breaks it now and then: the browser comes back, and goes where it was to."""
    paused(page, shown, 4.0)
    page.value("heliView.connection.socket.close()")
    page.wait("!heliView.connection.open")
    page.value("heliView.connection.longest = 0")
    for key in ("ArrowRight", "ArrowRight", "+"):
        press(page, key)
    at(page, 6.0)
    page.wait("heliView.flight.last.replay.speed === 2")
    press(page, "ArrowLeft")
    at(page, 5.0)
    assert page.errors == []


def test_events_are_marked_listed_and_jumped_to(page, shown):
    paused(page, shown)
    page.wait("document.querySelectorAll('#events li').length > 3")
    texts = page.value("[...document.querySelectorAll('#events li')].map(li => li.innerText)")
    fault = next(i for i, text in enumerate(texts) if "gps loss begins" in text)
    page.value(f"document.querySelectorAll('#events li button')[{fault}].click()")
    at(page, 3.0)
    page.wait(
        f"document.querySelectorAll('#events li')[{fault}].getAttribute('aria-current') === 'true'"
    )
    assert page.value(f"document.querySelectorAll('#events li')[{fault + 1}].dataset.future") == (
        "true"
    )
    page.wait("document.getElementById('faults').innerText.includes('GPS loss')")
    mark = (
        "[...document.querySelectorAll('#replay-marks button')].find(b => b.title.includes('{}'))"
    )
    page.value(mark.format("gps loss ends") + ".click()")
    at(page, 5.0)
    page.wait("document.getElementById('replay-event').innerText.includes('gps loss ends')")
    # Marks stand where the slider's knob is at their time.
    for time_s, words in ((3.0, "gps loss begins"), (7.99, "flight over")):
        box = f"(b => 0.5 * (b.left + b.right))({mark.format(words)}.getBoundingClientRect())"
        left, right = page.value(f"(r => [r.left, r.right])({AT}.getBoundingClientRect())")
        expected = left + 8 + time_s / 7.99 * (right - left - 16)
        assert page.value(box) == pytest.approx(expected, abs=1.0)
    assert page.errors == []


def test_the_end_says_how_it_ended_and_links_the_report(page, shown):
    paused(page, shown, 7.99)
    page.wait("document.getElementById('connection').dataset.state === 'over'")
    assert page.text("#banner-text") == (
        "Flown to its end after 8.00 s. Scored windows (5 to 8 s): inside the paper's figures."
    )
    assert page.value("document.getElementById('banner-report').href") == f"{shown}report.html"
    assert page.text("#replay-notes summary") == "1 note"
    assert page.value("document.querySelector('#replay-notes li').textContent") == "a <b>note</b>"
    # Played on, it begins again.
    page.value("document.getElementById('replay-play').click()")
    page.wait("heliView.flight.last.replay.runs && heliView.flight.last.t < 3")
    page.wait("document.getElementById('banner').hidden")
    page.open(f"{shown}report.html", "document.title.startsWith('the report')")
    # Its scripts run, in an origin of their own.
    assert page.value("document.title") == "the reportnull"
    assert page.errors == []


def test_nothing_can_be_commanded_and_the_page_says_why(page, shown):
    paused(page, shown)
    assert page.value("document.querySelector('#commands').getClientRects().length") == 0
    assert page.text("#permission").startswith("A record: its flight is over")
    page.value("heliView.connection.send({type: 'command', name: 'gust', token: '', args: {}})")
    page.value(
        "(() => { const c = heliView.connection.on; const old = c.answer;"
        " c.answer = (m) => { window.refused = m.text; old(m); }; })()"
    )
    page.value("heliView.connection.send({type: 'command', name: 'gust', token: '', args: {}})")
    page.wait("window.refused === 'a record cannot be commanded: its flight is over'")


@pytest.mark.slow
def test_the_order_stands_at_sixteen_times_and_no_row_is_missing(page, shown):
    """Fast play ends at the end, with every row of the charts, in order."""
    page.size(1440, 900)
    page.open(f"{shown}#t=0", SHOWN)
    press(page, "Home")
    page.value(
        "(s => { s.value = '16'; s.dispatchEvent(new Event('change')); })"
        "(document.getElementById('replay-speed'))"
    )
    page.wait("heliView.flight.last.replay.speed === 16")
    press(page, " ")
    at(page, 7.99)
    times = page.value("heliView.flight.rows.map(row => row.t)")
    assert np.diff(times).max() < 0.0701 and len(set(times)) == len(times)
    assert times[0] == 0.0 and times[-1] == 7.99
    assert page.errors == []


def test_a_record_that_was_cut_off_is_shown_to_its_end(page, flight, tmp_path):
    folder = tmp_path / "cut"
    shutil.copytree(flight, folder)
    (folder / "result.json").unlink()
    cut_off(folder / "bag", 0.6)
    replay, beside = replay_of(folder)
    end_s = round(replay.recording.seconds(replay.recording.last_ns), 3)
    assert 2.0 < end_s < 7.5
    with served(replay, 0, beside) as server:
        paused(page, server.url, end_s)
        page.wait("document.getElementById('banner-text').innerText.startsWith('The record ends')")
        assert page.text("#connection-text") == "record ends"
        assert "is not whole" in page.value("document.getElementById('replay-notes').textContent")
        seek(page, 1.0)
        page.wait("document.getElementById('banner').hidden")
    # Its server has gone; the browser comes back to where it was.
    page.wait("document.getElementById('connection').dataset.state === 'offline'")
    assert "server has ended" in page.text("#banner-text")
    with served(replay, server.port, beside):
        page.wait("document.getElementById('connection').dataset.state === 'replay'")
        at(page, 1.0)
    refused = [error for error in page.errors if "ERR_CONNECTION_REFUSED" not in error]
    assert refused == []


@pytest.mark.parametrize("scheme", [pytest.param("light", marks=pytest.mark.slow), "dark"])
def test_it_fits_a_phone_and_a_screen(page, shown, scheme):
    page.prefer(scheme)
    paused(page, shown, 4.0, width=390, height=844, phone=True)
    assert page.value("document.documentElement.scrollWidth") <= 390
    boxes = page.value(
        "[...document.querySelectorAll('.replay-run > *, .replay-line input')].filter(e =>"
        " e.getClientRects().length).map(e => { const r = e.getBoundingClientRect();"
        " return [r.left, r.top, r.right, r.bottom]; })"
    )
    assert len(boxes) >= 8
    for i, a in enumerate(boxes):
        assert 0 <= a[0] < a[2] <= 390, a
        for b in boxes[i + 1 :]:
            assert (
                a[2] <= b[0] + 0.5 or b[2] <= a[0] + 0.5 or a[3] <= b[1] + 0.5 or b[3] <= a[1] + 0.5
            )
    # What runs it stays in reach while the page is scrolled.
    page.value("scrollTo(0, 1200)")
    assert 0 <= page.value("document.getElementById('replay').getBoundingClientRect().top") < 5
    page.size(1440, 900)
    page.wait("document.documentElement.scrollHeight <= 900")
    ink = page.value("getComputedStyle(document.getElementById('replay-time')).color")
    paper = page.value("getComputedStyle(document.getElementById('replay')).backgroundColor")
    light = [sum(map(float, c[c.index("(") + 1 : -1].split(",")[:3])) for c in (ink, paper)]
    assert (light[0] < light[1]) == (scheme == "light")
    assert page.errors == []


def test_less_motion_begins_standing(page, shown):
    page.call(
        "Emulation.setEmulatedMedia",
        features=[{"name": "prefers-reduced-motion", "value": "reduce"}],
    )
    page.size(1440, 900)
    page.open(shown, SHOWN)
    page.wait("heliView.fps > 0")
    assert page.value(f"{STANDS} && heliView.flight.last.t === 0")
