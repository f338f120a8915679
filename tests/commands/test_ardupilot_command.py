# SPDX-License-Identifier: Apache-2.0
"""`heli ardupilot` over loopback: it is flown, writes what it flew, and names bad input."""

import json
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from contextlib import contextmanager

import pytest

from heli_flight.cli import app as cli
from heli_flight.report.write import recorded
from support.sitl_client import SitlClient, h3_120

HELI = [sys.executable, "-m", "heli_flight.start", "heli"]
_LIMIT_S = 120.0


@contextmanager
def waiting(folder, *words):
    """The command, and the ports on which it waits, in the order of its vehicles."""
    command = [*HELI, "ardupilot", "--port", "0", "--out", str(folder), "--no-report", *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            ports, process.pages = [], []
            count = int(words[words.index("--vehicles") + 1]) if "--vehicles" in words else 1
            while len(ports) < count:
                said = process.stdout.readline()
                process.pages += re.findall(r"live view: (\S+)", said)
                ports += [int(port) for port in re.findall(r"1:(\d+): a", said)]
            yield process, ports
        finally:
            process.kill()


@contextmanager
def client_at(port, rate_hz=400):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(_LIMIT_S)

        def exchange(data):
            sock.sendto(data, ("127.0.0.1", port))
            return sock.recv(2048)

        yield SitlClient(exchange, rate_hz)


def test_it_is_flown_and_written_and_read_by_what_reads_flights(tmp_path, capsys):
    folder = tmp_path / "flight"
    with waiting(folder, "--duration", "2") as (process, (port,)):
        with client_at(port) as client:
            for _ in range(800):
                client.frame(h3_120(0.0, 0.0, 0.3, 0.0))
        said, _ = process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 0, said
    assert "2.00 s flown by ArduPilot at 400 Hz" in said
    assert len(recorded(folder).record) == 200
    for words in (["report", folder], ["bag", "info", folder], ["bag", "ulog", folder]):
        assert cli.main([*map(str, words)]) == 0, capsys.readouterr()
    capsys.readouterr()
    assert cli.main(["score", str(folder), "--mte", "hover"]) == 2
    bags = ["--actuators", str(folder), "--gusts", str(folder)]
    assert cli.main(["identify", *bags, "--out", str(tmp_path / "identified")]) == 2
    _, err = capsys.readouterr()
    assert len(err.splitlines()) == 2 and "no message on" in err


@pytest.mark.slow
def test_each_vehicle_has_a_port_and_a_folder_and_ctrl_c_ends_all(tmp_path):
    folder = tmp_path / "flights"
    with waiting(folder, "--vehicles", "2") as (process, ports):
        with client_at(ports[0]) as first, client_at(ports[1], 1200) as second:
            for _ in range(60):
                first.frame(h3_120(0.0, 0.0, 0.3, 0.0))
                second.frame(h3_120(0.0, 0.0, 0.3, 0.0))
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 0, said
    results = [json.loads((folder / f"heli{n}" / "result.json").read_text()) for n in (1, 2)]
    assert [result["ardupilot"]["steps_per_s"] for result in results] == [400, 1200]
    assert results[0]["seed"] != results[1]["seed"]


def test_a_flight_is_shown_while_it_is_flown(tmp_path):
    words = ("--duration", "0.5", "--live", "--live-port", "0")
    with waiting(tmp_path / "flight", *words) as (process, (port,)):
        (page,) = process.pages
        with urllib.request.urlopen(page, timeout=_LIMIT_S) as answer:
            assert answer.status == 200
        with client_at(port) as client:
            for _ in range(200):
                client.frame(h3_120(0.0, 0.0, 0.3, 0.0))
        said, _ = process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 0, said
    assert page.startswith("http://127.0.0.1:")


def test_ended_before_arducopter_came_it_leaves_nothing(tmp_path):
    folder = tmp_path / "none"
    with waiting(folder) as (process, _):
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=_LIMIT_S)
        assert process.returncode == 130
    assert not folder.exists()


def refused(capsys, *words):
    code = cli.main(["ardupilot", *map(str, words)])
    out, err = capsys.readouterr()
    assert (code, len(err.splitlines())) == (2, 1), (out, err)
    return err


def test_bad_input_is_one_line(tmp_path, capsys):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        assert f"--port {port}" in refused(capsys, "--port", port, "--out", tmp_path / "a")
    assert not (tmp_path / "a").exists()
    assert "--swash H4" in refused(capsys, "--swash", "H4")
    assert "--vehicles" in refused(capsys, "--live", "--vehicles", 2, "--out", tmp_path / "a")
    assert "--live-port" in refused(capsys, "--live-port", 0)
    assert "--imu x" in refused(capsys, "--imu", "x")
    assert "nowhere" in refused(capsys, "--aircraft", "nowhere")
    assert "exists already" in refused(capsys, "--out", tmp_path)
    parm = tmp_path / "a.parm"
    parm.write_text("H_SW_TYPE 4\n")
    assert "H_SW_TYPE" in refused(capsys, "--parm", parm)


@pytest.mark.parametrize("aircraft", ["helion", "logo600", "xcell60"])
def test_the_parameters_are_printed_for_the_aircraft(capsys, aircraft):
    assert cli.main(["ardupilot", "--print-params", "--aircraft", aircraft]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert aircraft in lines[0] and "FRAME_CLASS 6" in lines
    assert all(re.fullmatch(r"[A-Z0-9_]+ -?[0-9.e-]+", line) for line in lines[1:])


def test_a_flights_own_file_is_flown_by_ardupilot_again_and_by_none_of_our_laws(tmp_path, capsys):
    folder = tmp_path / "flight"
    with waiting(folder, "--duration", "0.5", "--seed", "5") as (process, (port,)):
        with client_at(port) as client:
            for _ in range(200):
                client.frame(h3_120(0.0, 0.0, 0.3, 0.0))
        process.communicate(timeout=_LIMIT_S)
    again = folder / "params.yaml"
    assert cli.main(["ardupilot", "--print-params", "--params", str(again)]) == 0
    assert cli.main(["hover", "--params", str(again), "--out", str(tmp_path / "b")]) == 2
    assert "heli ardupilot" in capsys.readouterr().err
