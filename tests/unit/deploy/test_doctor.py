"""railctl doctor: every check finds what is wrong, says what to do, and has a place in the documents."""

import json
import os
import re
import resource
import shutil
import socket
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from typer.testing import CliRunner

from railctl.common.rail.compiled.step import step
from railctl.deploy.cli import app
from railctl.deploy.commands import doctor
from railctl.deploy.diagnosis import hardware, messages, software
from railctl.deploy.diagnosis.findings import Check, Finding, Noted, Wrong
from railctl.deploy.runs import Failed

DOCUMENT = (Path(__file__).parents[3] / "docs" / "troubleshooting.md").read_text()


def found(look):
    return Check("D00", "any", look).run()


def raising(error):
    def look():
        raise error

    return look


def test_what_a_check_finds_is_told():
    assert found(lambda: "2") == Finding("D00", "any", "ok", "2")
    assert found(raising(Wrong("0.1 GiB free", "make room"))) == Finding(
        "D00", "any", "bad", "0.1 GiB free", "make room"
    )
    assert found(raising(Noted("1", "more is faster"))).grade == "note"
    assert found(raising(Failed("killed"))).found == "killed"
    broken = found(raising(AttributeError("no such thing")))
    assert (broken.grade, broken.found) == ("bad", "AttributeError: no such thing")


@pytest.mark.parametrize(("grade", "code"), [("ok", 0), ("note", 0), ("bad", 1)])
def test_only_what_is_bad_fails_and_all_else_goes_on(monkeypatch, grade, code):
    looks = {"ok": lambda: "fine", "note": raising(Noted("slow", "buy")), "bad": raising(Wrong("none", "mend"))}
    checks = (Check("D01", "first", looks[grade]), Check("D02", "second", lambda: "seen"))
    monkeypatch.setattr(doctor, "CHECKS", checks)
    said = CliRunner().invoke(app, ["doctor"])
    assert said.exit_code == code
    assert "D02  second      seen" in said.stdout
    document = json.loads(CliRunner().invoke(app, ["doctor", "--json"]).stdout)
    assert document["ok"] == (code == 0)
    assert [check["grade"] for check in document["checks"]] == [grade, "ok"]
    assert {check["ok"] for check in document["checks"]} == {code == 0, True}


def test_every_code_is_explained_and_none_is_there_twice():
    codes = [check.code for check in doctor.CHECKS]
    assert codes == [f"D{number:02}" for number in range(1, len(codes) + 1)]
    assert re.findall(r"^### (D\d\d) (.+)$", DOCUMENT, re.MULTILINE) == [
        (check.code, check.name) for check in doctor.CHECKS
    ]


def test_here_nothing_is_bad():
    assert [check.run() for check in doctor.CHECKS[:-1] if check.run().grade == "bad"] == []


@pytest.mark.parametrize(
    ("set_up", "look", "grade", "told"),
    [
        (lambda m: m.setattr("platform.system", lambda: "Darwin"), software.system, "bad", "runs need Linux"),
        (lambda m: m.setattr("platform.machine", lambda: "aarch64"), software.system, "note", "aarch64"),
        (lambda m: m.setattr(sys, "version_info", (3, 12, 1)), software.python, "bad", "Python 3.11"),
        (lambda m: requires(m, "nosuch>=1"), software.packages, "bad", "nosuch is missing"),
        (lambda m: requires(m, "rich>=1000"), software.packages, "bad", "is not >=1000"),
        (lambda m: m.setenv("PYTHONDONTWRITEBYTECODE", "1"), software.bytecode, "note", "unset it"),
        (lambda m: m.setattr(os, "sched_getaffinity", lambda _pid: {0}), hardware.cores, "note", "1 of"),
        (lambda m: m.setattr(hardware, "_quota", lambda: 0.5), hardware.cores, "note", "a container gets 0.5"),
        (lambda m: m.setattr(resource, "getrlimit", lambda _of: (64, 64)), hardware.files, "bad", "ulimit -n"),
        (lambda m: m.setattr(os, "sysconf", lambda _of: 10_000), hardware.memory, "bad", "0.1 GiB"),
        (lambda m: m.setattr(shutil, "disk_usage", lambda _of: Usage(0)), hardware.disk, "bad", "make room"),
        (lambda m: m.setattr(os, "access", lambda *_: False), hardware.disk, "bad", "RAILCTL_RUNS"),
        (lambda m: m.setattr("time.time", lambda: 2e9), hardware.clock, "note", "ahead of"),
        (
            lambda m: m.setattr(messages, "private_endpoint", raising(OSError(13, "no"))),
            messages.zenoh,
            "bad",
            "TMPDIR",
        ),
    ],
)
def test_what_is_wrong_is_found(monkeypatch, set_up, look, grade, told):
    set_up(monkeypatch)
    finding = found(look)
    assert finding.grade == grade
    assert told in f"{finding.found}: {finding.remedy}"
    assert finding.remedy


class Usage(NamedTuple):
    free: int


def requires(monkeypatch, *requirements):
    monkeypatch.setattr("importlib.metadata.requires", lambda _of: [*requirements, 'x>=1; extra == "dev"'])


def test_a_build_for_cuda_is_named(monkeypatch, tmp_path):
    (tmp_path / "version.py").write_text("cuda: Optional[str] = '13.0'\nhip = None\n")
    monkeypatch.setattr(software, "_folder_of", lambda _package: tmp_path)
    assert "CUDA 13.0" in found(software.torch_build).found


def test_a_port_that_is_taken_is_named(monkeypatch):
    with socket.create_server(("", 0)) as taken:
        monkeypatch.setattr(messages, "FAR_PORT", taken.getsockname()[1])
        finding = found(messages.ports)
    assert (finding.grade, str(messages.FAR_PORT) in finding.found) == ("note", True)


@pytest.mark.parametrize(
    ("text", "quota"), [("max 100000\n", None), ("150000 100000\n", 1.5), ("", None), (None, None)]
)
def test_what_a_container_gets(monkeypatch, tmp_path, text, quota):
    monkeypatch.setattr(hardware, "QUOTA", tmp_path / "cpu.max")
    if text is not None:
        hardware.QUOTA.write_text(text)
    assert hardware._quota() == quota


def test_what_other_numbers_of_threads_are_for_is_said(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    assert "OMP_NUM_THREADS=8" in found(hardware.threads).found


def test_nothing_compiled_is_said(monkeypatch, tmp_path):
    monkeypatch.setattr(type(step.compiled), "stats", type(step.stats)(str(tmp_path), {}, {}))
    assert "railctl doctor --compile" in found(software.compiled).remedy
