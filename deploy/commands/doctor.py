"""railctl doctor: whether this machine can run what it should, and what to do if not."""

import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from railctl.common.task import FAILED
from railctl.deploy.diagnosis import hardware, messages, software
from railctl.deploy.diagnosis.findings import Check, Finding, Wrong
from railctl.deploy.output import AsJson, console, one_line_errors, say
from railctl.deploy.task import run_task

COMPILERS = {
    "the world and what acts in it": "railctl.common.policy.compile",
    "what learns": "railctl.services.learner.compile",
    "the reference policies": "railctl.services.evaluator.references.compile",
}
SIGNS = {"ok": "ok", "note": "! ", "bad": "!!"}


def arithmetic() -> str:
    """Two fresh processes must end in the same network, bit for bit."""
    digests = [run_task("railctl.services.learner.selfcheck")["digest"] for _ in range(2)]
    if digests[0] != digests[1]:
        raise Wrong(
            "the same updates ended in two different networks",
            "resumed runs will not be exact here: another machine, or a memory test of this one",
        )
    return f"repeats bit for bit ({digests[0][:12]})"


CHECKS = (
    Check("D01", "system", software.system),
    Check("D02", "python", software.python),
    Check("D03", "packages", software.packages),
    Check("D04", "torch", software.torch_build),
    Check("D05", "bytecode", software.bytecode),
    Check("D06", "compiled", software.compiled),
    Check("D07", "cores", hardware.cores),
    Check("D08", "threads", hardware.threads),
    Check("D09", "open files", hardware.files),
    Check("D10", "memory", hardware.memory),
    Check("D11", "disk", hardware.disk),
    Check("D12", "clock", hardware.clock),
    Check("D13", "zenoh", messages.zenoh),
    Check("D14", "ports", messages.ports),
    Check("D15", "arithmetic", arithmetic),
)


@one_line_errors
def doctor(
    compile_ahead: Annotated[
        bool, typer.Option("--compile", help="Before that, compile all that runs and evaluations need.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check this machine: system, packages, compiled code, cores, memory, disk, clock, Zenoh, arithmetic."""
    complaints = Console(stderr=True, highlight=False)
    if compile_ahead:
        for what, compiler in COMPILERS.items():
            complaints.print(f"compiles {what}, unless it is there")
            run_task(compiler)
    findings = []
    for check in CHECKS:
        findings.append(check.run())
        if not as_json:
            _show(findings[-1])
    ok = all(finding.grade != "bad" for finding in findings)
    if as_json:
        say(
            "",
            {"ok": ok, "checks": [{"ok": finding.grade != "bad", **finding._asdict()} for finding in findings]},
            as_json=True,
        )
    if not ok:
        sys.exit(FAILED)


def _show(finding: Finding) -> None:
    """A line, and below it what to do."""
    console.print(Text(f"{SIGNS[finding.grade]}  {finding.code}  {finding.check:<10}  {finding.found}"), soft_wrap=True)
    if finding.remedy:
        console.print(Text(f"{'':21}{finding.remedy}"), soft_wrap=True)
