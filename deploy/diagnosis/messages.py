"""Whether messages go their way: through a router on a socket, and over loopback for those who look from a browser."""

import socket
import time

from railctl.common.bus import Bus, NoAnswer, open_bus, open_router
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.records.control import CommandAnswer, Empty
from railctl.common.wire.keys import Service
from railctl.deploy.diagnosis.findings import Noted, Wrong

ANSWER_TIMEOUT_S = 5.0
ECHO = Service("doctor", Empty, CommandAnswer)
FAR_PORT = 7447  # that the documents use for runs which others reach


def zenoh() -> str:
    """A question and its answer, as in every run."""
    try:
        endpoint = private_endpoint()
    except OSError as error:
        raise Wrong(f"no folder for a socket: {error.strerror}", "set TMPDIR to one that you may write") from None
    try:
        with (
            open_router(endpoint),
            open_bus(endpoint, "doctor", 5.0) as here,
            open_bus(endpoint, "doctor", 5.0) as there,
        ):
            here.serve(ECHO, lambda question: question.answer(CommandAnswer(done=True, text="here")))
            _ask_until_answered(there, time.monotonic() + ANSWER_TIMEOUT_S)
            begin = time.perf_counter()
            there.ask(ECHO, Empty(), ANSWER_TIMEOUT_S)
            took_s = time.perf_counter() - begin
    except (OSError, NoAnswer) as error:
        remedy = "set TMPDIR to a folder where sockets can be made"
        raise Wrong(f"no answer over {endpoint}: {error}", remedy) from None
    finally:
        remove_endpoint(endpoint)
    return f"question and answer through a router on a socket of yours alone, in {took_s * 1000:.1f} ms"


def ports() -> str:
    """Whether one can listen on loopback, as `railctl watch` does, and on the port of runs that others reach."""
    try:
        with socket.create_server(("127.0.0.1", 0)):
            pass
    except OSError as error:
        remedy = "bring the interface up, as by ip link set lo up: railctl watch needs it"
        raise Noted(f"nobody can listen on 127.0.0.1: {error.strerror}", remedy) from None
    try:
        with socket.create_server(("", FAR_PORT)):
            pass
    except OSError as error:
        remedy = "for a run that other machines reach, give --listen another one"
        raise Noted(f"loopback is there; {FAR_PORT} is not free: {error.strerror}", remedy) from None
    return f"loopback is there, {FAR_PORT} is free"


def _ask_until_answered(bus: Bus, deadline: float) -> None:
    """A question may overtake the word that there is somebody who answers it: the first one may find nobody."""
    while True:
        try:
            bus.ask(ECHO, Empty(), ANSWER_TIMEOUT_S)
        except NoAnswer:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        else:
            return
