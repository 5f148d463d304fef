"""railctl watch: its address, its port, and its end."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from railctl.deploy.cli import app
from railctl.deploy.runs import Failed
from railctl.deploy.web import serving
from railctl.deploy.web.catalogue import Catalogue
from railctl.deploy.web.guard import Keys
from railctl.deploy.web.serving import address, listen, opened

from command_line import complaint  # isort: skip

RAILCTL = Path(sys.executable).with_name("railctl")


@pytest.fixture
def taken():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        found.listen()
        yield found.getsockname()[1]


def test_a_port_that_is_taken_is_said_in_a_line(root, taken):
    line = complaint(1, "watch", "--no-open", "--port", taken)
    assert line == f"railctl: --port {taken}: Address already in use: give a free port, or 0 for any"


def test_without_a_port_the_next_free_one_is_taken(taken, monkeypatch):
    monkeypatch.setattr(serving, "PORT", taken)
    with listen(None) as found:
        host, port = found.getsockname()
    assert host == "127.0.0.1"
    assert taken < port < taken + serving.TRIED


def test_if_all_are_taken_they_are_named(taken, monkeypatch):
    monkeypatch.setattr(serving, "PORT", taken)
    monkeypatch.setattr(serving, "TRIED", 1)
    with pytest.raises(Failed, match=f"ports {taken} to {taken}"):
        listen(None)


def test_a_name_that_is_no_run_is_said_in_a_line(root):
    assert complaint(2, "watch", "nosuch", "--no-open").startswith("railctl: no run named 'nosuch'")


def test_the_key_is_in_the_part_of_the_address_that_is_sent_to_nobody():
    keys = Keys(read_only=False)
    with listen(0) as found:
        url = address(found, Catalogue(named=[("run", "a b")]), keys)
        port = found.getsockname()[1]
        assert address(found, Catalogue(), Keys(read_only=True)) == f"http://127.0.0.1:{port}/"
    assert url == f"http://127.0.0.1:{port}/runs/a%20b#key={keys.key}"


def test_the_browser_is_given_a_file_that_only_its_user_reads(monkeypatch):
    asked = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(serving.webbrowser, "open", asked.append)
    with opened("http://127.0.0.1:1/#key=secret"):
        [uri] = asked
        file = Path(uri.removeprefix("file://"))
        assert "secret" not in uri
        assert "secret" in file.read_text()
        assert file.parent.stat().st_mode & 0o077 == 0
    assert not file.exists()


def test_without_a_display_no_browser_takes_the_terminal(monkeypatch):
    asked = []
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(serving.webbrowser, "open", asked.append)
    with opened("http://127.0.0.1:1/"):
        assert asked == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_at_once_also_while_somebody_listens(make, number):
    make("one", [-0.5] * 20)
    command = [RAILCTL, "watch", "one", "--no-open", "--port", "0"]
    with subprocess.Popen(
        command, env=os.environ, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        url = process.stdout.readline().split()[1]
        host, port = url.removeprefix("http://").partition("/")[0].split(":")
        with socket.create_connection((host, int(port)), timeout=30) as stream:
            stream.sendall(f"GET /api/stream?run=one HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
            assert b"200 OK" in stream.recv(1000)
            process.send_signal(number)
            _, said = process.communicate(timeout=30)
    assert (process.returncode, said) == (0, "")


def test_ctrl_c_before_anything_is_served_ends_it_quietly(root, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("railctl.deploy.commands.watch.serve", interrupted)
    result = CliRunner().invoke(app, ["watch", "--port", "0", "--no-open"])
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("watch    http://127.0.0.1:")
