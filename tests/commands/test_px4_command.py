# SPDX-License-Identifier: Apache-2.0
"""`heli px4` over loopback: it is flown, writes what it flew, and names bad input."""

import contextlib
import json
import re
import signal
import socket
import subprocess
import sys
import urllib.request

import pytest

pytest.importorskip("pymavlink")
from heli_flight.cli import app as cli  # noqa: E402
from heli_flight.px4.server import listening  # noqa: E402
from heli_flight.report.write import recorded  # noqa: E402
from support.px4_peer import Px4Peer  # noqa: E402

HELI = [sys.executable, "-m", "heli_flight.start", "heli"]
_LIMIT_S = 120.0


@contextlib.contextmanager
def waiting(folder, *words):
    """The command, and the port on which it waits."""
    command = [*HELI, "px4", "--port", "0", "--out", str(folder), "--no-report", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        process.pages = []
        try:
            said = ""
            while not (found := re.findall(r"1:(\d+): PX4", said)):
                assert process.poll() is None
                said = process.stdout.readline()
                process.pages = [*process.pages, *re.findall(r"live view: (\S+)", said)]
            yield process, int(found[0])
        finally:
            process.kill()


@contextlib.contextmanager
def connected(port):
    with socket.create_connection(("127.0.0.1", port), timeout=_LIMIT_S) as sock:
        peer = Px4Peer()
        sock.sendall(peer.hello())
        yield sock, peer


def fly(sock, peer, steps):
    """Answer so many HIL_SENSOR, each when it has come; or until the flight is over."""
    with contextlib.suppress(ConnectionError):
        for _ in range(steps):
            before = len(peer.sensors)
            if before:
                sock.sendall(peer.answer(armed=False))
            while len(peer.sensors) == before:
                data = sock.recv(4096)
                if not data:
                    return
                peer.hear(data)


def test_it_is_flown_and_written_one_that_dies_comes_back_and_a_second_is_turned_away(tmp_path):
    folder = tmp_path / "flight"
    with waiting(folder, "--duration", "1", "--seed", "5") as (process, port):
        with connected(port) as (sock, peer):
            fly(sock, peer, 100)
            with socket.create_connection(("127.0.0.1", port), timeout=_LIMIT_S) as second:
                assert second.recv(1) == b""
            fly(sock, peer, 20)
            assert len(peer.sensors) >= 120
        with connected(port) as (sock, peer):
            fly(sock, peer, 1)
            assert peer.sensors[0].time_usec == 2500  # from the beginning
            fly(sock, peer, 500)
        said, _ = process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 0, said
    for words in ("turned away", "PX4 has gone", "connected again", "flown by PX4 at 400 Hz"):
        assert words in said
    again = folder.with_name("flight-2")
    assert len(recorded(again).record) == 100 and recorded(again).how == "by PX4"
    result = json.loads((again / "result.json").read_text())
    assert result["mode"] == "px4" and result["verdict"] == "not scored"
    assert result["px4"]["answers"] + result["px4"]["unanswered"] == 400
    assert (folder / "result.json").exists()
    for words in (["report", again], ["bag", "info", again]):
        assert cli.main([*map(str, words)]) == 0
    file = again / "params.yaml"
    assert cli.main(["px4", "--print-params", "--params", str(file)]) == 0
    assert cli.main(["hover", "--params", str(file), "--out", str(tmp_path / "b")]) == 2


def test_a_flight_is_shown_while_it_is_flown(tmp_path):
    words = ("--duration", "0.2", "--live", "--live-port", "0")
    with waiting(tmp_path / "flight", *words) as (process, port):
        (page,) = process.pages
        with urllib.request.urlopen(page, timeout=_LIMIT_S) as answer:
            assert answer.status == 200
        with connected(port) as (sock, peer):
            fly(sock, peer, 100)
        said, _ = process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 0, said
    assert page.startswith("http://127.0.0.1:")


def test_ended_before_px4_came_it_leaves_nothing(tmp_path):
    folder = tmp_path / "none"
    with waiting(folder) as (process, _):
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 130
    assert not folder.exists()


def refused(capsys, *words):
    code = cli.main(["px4", *map(str, words)])
    out, err = capsys.readouterr()
    assert (code, len(err.splitlines())) == (2, 1), (out, err)
    return err


def test_bad_input_is_one_line(tmp_path, capsys):
    with listening(0) as other:
        port = other.getsockname()[1]
        assert f"--port {port}" in refused(capsys, "--port", port, "--out", tmp_path / "a")
    assert not (tmp_path / "a").exists()
    assert "--rate 250" in refused(capsys, "--rate", "250")
    assert "nowhere" in refused(capsys, "--aircraft", "nowhere")
    assert "exists already" in refused(capsys, "--out", tmp_path)


def test_the_parameters_are_printed_for_the_aircraft(capsys):
    assert cli.main(["px4", "--print-params", "--aircraft", "logo600"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "logo600" in lines[0] and "1\t1\tCA_AIRFRAME\t11\t6" in lines
