# SPDX-License-Identifier: Apache-2.0
"""No page that is written can load or send anything: its policy, its addresses, its buttons."""

import base64
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from heli_flight.loop import simulate
from heli_flight.report.data import Chart, Panel, Trace
from heli_flight.report.page import PageHeader, filled
from heli_flight.report.tables import ReportTable
from heli_flight.report.write import write_report
from heli_flight.result import Result
from heli_flight.scoring import Figures
from heli_flight.settings import resolve

PAGE = Path(__file__).resolve().parents[1] / "heli_flight/report/page"
_LOADING = {"src", "href", "action", "formaction", "data", "poster", "srcset", "background", "ping"}


class Markup(HTMLParser):
    """Policies, addresses and inline scripts of a page."""

    def __init__(self, text):
        super().__init__(convert_charrefs=False)
        self.policies, self.addresses, self.scripts, self.handlers = [], [], [], []
        self._script = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if attributes.get("http-equiv", "").lower() == "content-security-policy":
            assert not self.scripts, "the policy must stand before what it is to hold"
            self.policies.append(attributes["content"])
        self.addresses += [value for name, value in attrs if name in _LOADING]
        self.handlers += [name for name, _ in attrs if name.startswith("on")]
        if tag == "script":
            self._script = [attributes.get("type", ""), ""]

    def handle_data(self, data):
        if self._script is not None:
            self._script[1] += data

    def handle_endtag(self, tag):
        if tag == "script":
            self.scripts.append(self._script)
            self._script = None


def policy_of(text):
    parts = [part.split() for part in text.split(";") if part.strip()]
    assert len({name for name, *_ in parts}) == len(parts)
    return {name: sources for name, *sources in parts}


def check(text):
    """The page loads nothing, sends nothing, and runs its own scripts only."""
    page = Markup(text)
    (header,) = page.policies
    policy = policy_of(header)
    for name in ("default-src", "connect-src", "form-action", "base-uri"):
        assert policy[name] == ["'none'"], name
    for name in ("img-src", "style-src"):
        assert set(policy[name]) <= {"data:", "blob:", "'unsafe-inline'"}, name
    assert set(policy) <= {
        "default-src", "connect-src", "form-action", "base-uri", "img-src", "style-src",
        "script-src",
    }  # fmt: skip
    run = [code for kind, code in page.scripts if kind != "application/json"]
    hashes = [base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in run]
    assert policy["script-src"] == [f"'sha256-{code}'" for code in hashes]
    assert page.handlers == []
    assert all(address.startswith(("#", "figures/")) for address in page.addresses)
    styles = "".join(re.findall(r"<style>(.*?)</style>", text, re.S))
    assert "url(" not in styles and "@import" not in styles
    assert run and all(code for code in run)
    return run


@pytest.mark.parametrize("scenario", ["hover", "attitude"])
def test_a_flights_report(tmp_path, scenario):
    settings = resolve(scenario, duration_s=0.5)
    flight = simulate(settings)
    page = write_report(flight.record, settings, Result(Figures(), "<lost>", 0.5, 1.0), tmp_path)
    scripts = check(page.read_text(encoding="utf-8"))
    assert scripts[1] == (PAGE / "report.js").read_text(encoding="utf-8")


@pytest.mark.parametrize("template", sorted(p.name for p in PAGE.glob("*.html")))
def test_every_page_is_made_from_the_one_that_holds_the_policy(template):
    """A page that is not `base.html` and makes a whole document would have no policy."""
    text = (PAGE / template).read_text(encoding="utf-8")
    whole = re.search(r"<html|<head|<script", text)
    assert bool(whole) == (template == "base.html")
    assert template == "base.html" or "extends" in text or "{% macro" in text


def test_an_identifications_report_and_what_is_written_into_it_is_text():
    wild = "<script>alert(1)</script>"
    head = PageHeader(wild, wild, wild, [("✓", "good", wild)], [(wild, wild)], {"result": wild})
    trace = Trace(np.arange(3.0), np.arange(3.0), wild, "nav")
    chart = Chart("key", wild, wild, [Panel(wild, wild, [trace], note=wild)], "actuators")
    table = ReportTable([wild], [[wild, wild]], wild)
    text = filled(
        "identification.html", head, [chart], definition=wild, groups={wild: table}, zeros=[wild],
        ground=table, not_simulated=[wild],
    )  # fmt: skip
    assert len(check(text)) == 2 and wild not in text


def test_no_chart_offers_an_upload():
    """Plotly's button "Share chart" would send the data to its maker's server."""
    script = (PAGE / "report.js").read_text(encoding="utf-8")
    assert "showSendToCloud: false" in script and 'plotlyServerURL: ""' in script
    for sending in ("fetch(", "XMLHttpRequest", "sendBeacon", "WebSocket", "EventSource", "http"):
        assert sending not in script, sending
