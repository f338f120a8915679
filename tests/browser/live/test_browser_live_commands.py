# SPDX-License-Identifier: Apache-2.0
"""Commands on the live view's page: who may give them, what asks first, what the end takes away."""

import json

import pytest


def test_view_only_page_has_nothing_to_press(page, flown):
    flown().open_in(page)
    shown = "document.querySelector('#commands').getClientRects().length"
    assert page.value(shown) == 0
    assert page.text("#permission").startswith("View only.")


def allowed(page, flight, **options):
    """Look at a flight with the token shown: the commands can be pressed."""
    flight.open_in(page, **options)
    page.value(f"document.getElementById('token').value = '{flight.TOKEN}'")
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
    flight.open_in(page)
    assert page.value("document.querySelectorAll('#commands fieldset:disabled').length") == 5
    page.value("document.getElementById('token').value = 'guess'")
    submit(page, "token")
    answered(page, "wrong token")
    page.value(f"document.getElementById('token').value = '{flight.TOKEN}'")
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


@pytest.mark.slow
def test_giving_up_the_hold_asks_first_and_is_no_success_when_done(page, flown):
    flight = flown(commands=True)
    allowed(page, flight)
    mode_text = page.text("#tells-mode")
    assert "nothing holds position and altitude" in mode_text
    attitude = "document.querySelector('#f-mode [value=attitude]')"
    opened = "document.getElementById('ask').open"

    # By keyboard: the question has the focus on Cancel; Enter and Escape mean no.
    for key in ("Enter", "Escape"):
        page.value(f"{attitude}.focus()")
        press(page, "Enter")
        page.wait(opened)
        assert page.value("document.activeElement.dataset.part") == "no"
        asked = page.text("#ask-text")
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


def choose(page, what, kind):
    """Choose by keyboard's event what fails and how."""
    for name, value in (("what", what), ("kind", kind)):
        page.value(
            f"(() => {{ const s = document.querySelector('#f-fault [name={name}]');"
            f" s.value = '{value}'; s.dispatchEvent(new Event('change', {{bubbles: true}})); }})()"
        )


def test_faults_are_offered_judged_sent_listed_and_cleared(page, flown):
    flight = flown(commands=True)
    allowed(page, flight)
    assert page.value("document.querySelector('#f-clear button').disabled")
    assert page.text("#faults") == "none"
    value = "document.querySelector('#f-fault [name=value]')"

    # What needs no number has none to write; what needs three wants three.
    choose(page, "baro", "freeze")
    assert page.value(f"{value}.disabled")
    choose(page, "gps", "bias")
    assert page.value(f"{value}.value") == "2, 0, 0"
    assert page.text("#fault-unit") == "m, north, east, down"
    page.value(f"{value}.value = '1 2'; {value}.dispatchEvent(new Event('input'))")
    submit(page, "fault")
    assert not page.value("document.querySelector('#f-fault').checkValidity()")
    assert flight.received == []
    page.value(f"{value}.value = '1.5, -2, 0'; {value}.dispatchEvent(new Event('input'))")
    page.wait("document.getElementById('tells-fault').innerText.startsWith('GPS: bias')")
    submit(page, "fault")
    answered(page, "fault taken")

    # Without a duration it lasts; an optional value may be left out; what may lose it asks first.
    choose(page, "delta_ped", "stuck")
    page.value("document.querySelector('#f-fault [name=duration_s]').value = ''")
    assert page.value(f"{value}.value") == ""
    submit(page, "fault")
    page.wait("document.getElementById('ask').open")
    assert page.value("document.activeElement.dataset.part") == "no"
    asked = page.text("#ask-text")
    assert "until it is cleared" in asked and "may be lost" in asked
    press(page, "Tab")
    press(page, "Enter")
    answered(page, "fault taken")
    assert flight.received == [
        ("fault", {"what": "gps", "kind": "bias", "value": [1.5, -2, 0], "duration_s": 5}),
        ("fault", {"what": "delta_ped", "kind": "stuck"}),
    ]

    flight.change = {"faults": ["gps bias 1.5, -2, 0 from 40.1 to 45.1 s",
                                "delta_ped stuck from 41.2 s on"]}  # fmt: skip
    page.wait("document.querySelectorAll('#faults li').length === 2")
    assert page.text("#faults").splitlines() == [
        "GPS bias 1.5, -2, 0 from 40.1 to 45.1 s", "pedal stuck from 41.2 s on"
    ]  # fmt: skip
    submit(page, "clear")
    answered(page, "clear_faults taken")
    flight.change = {}
    page.wait("document.querySelector('#f-clear button').disabled")
    assert flight.received[2:] == [("clear_faults", {})] and page.errors == []


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_the_panel_of_faults_fits(page, flown, width):
    """Nothing is cut off or lies over another, with faults that act, on a phone, too."""
    flight = flown(commands=True)
    allowed(page, flight, width=width, height=900, phone=width < 500)
    flight.change = {"faults": ["delta_lon dead zone 0.05 from 41.2 s on"] * 4}
    page.wait("document.querySelectorAll('#faults li').length === 4")
    assert page.value("document.documentElement.scrollWidth <= innerWidth")
    boxes = page.value(
        "[...document.querySelectorAll('#f-fault select, #f-fault input, #f-fault button,"
        " #f-fault .tells, #faults, #f-clear button')].map(e => {"
        " const r = e.getBoundingClientRect(); return [r.left, r.top, r.right, r.bottom]; })"
    )
    panel = page.value(
        "(() => { const r = document.getElementById('commands').getBoundingClientRect();"
        " return [r.left, r.top, r.right, r.bottom]; })()"
    )
    for i, a in enumerate(boxes):
        assert panel[0] <= a[0] < a[2] <= panel[2] and panel[1] <= a[1] <= a[3] <= panel[3] + 1
        for b in boxes[i + 1 :]:
            apart = a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
            assert apart, (a, b)


@pytest.mark.parametrize(
    ("form", "values", "word"),
    [
        ("gust", {"amplitude_mps": 10}, "a decimetre"),
        ("reference", {"u": 2.5}, "bring the helicopter to the ground"),
    ],
)
def test_a_strong_gust_and_a_low_reference_ask_first(page, flown, form, values, word):
    flight = flown(commands=True)
    allowed(page, flight)
    write(page, form, values)
    submit(page, form)
    page.wait("document.getElementById('ask').open")
    assert word in page.text("#ask-text") and flight.received == []
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


@pytest.mark.slow
def test_the_reference_form_follows_the_flight_until_it_is_edited(page, flown):
    flight = flown(commands=True)
    flight.change = {"ref": {"p": [1.0, -0.5, 20.0], "v": [0.0, 0.0, 0.0], "yaw_deg": 90.0}}
    allowed(page, flight)
    fields = (
        "['e', 'n', 'u', 'yaw'].map(n => document.getElementById('f-reference').elements[n].value)"
    )
    page.wait(f"{fields}.join() === '1.0,-0.5,20.0,90'")
    assert page.text("#tells-reference").startswith("The reference stays where it is.")
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


@pytest.mark.slow
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
    assert page.value("document.querySelectorAll('#commands fieldset:disabled').length") == 5
    pressable = (
        "[...document.querySelectorAll('#commands button')].filter(b => !b.matches(':disabled'))"
    )
    assert page.value(f"{pressable}.length") == 0
    assert page.text("#answer").startswith("The flight has ended")
    assert flight.received == []
    assert page.text("#connection-text").lower() == word
    banner = page.text("#banner-text")
    assert banner.startswith(sentence) and (cause in banner) == (kind != "over")
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
    flight.open_in(page)
    page.value(f"document.getElementById('token').value = '{flight.TOKEN}'")
    submit(page, "token")
    answered(page, "lockstep")
    assert page.value("document.querySelectorAll('#commands fieldset:disabled').length") == 5


@pytest.mark.slow
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


@pytest.mark.slow
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
