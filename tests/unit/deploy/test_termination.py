"""Signals that end a command reach it wherever it is."""

import os
import signal
import sys
import weakref

import pytest

from railctl.deploy.termination import Terminated, never_missed, terminable


class Thing:
    """Something that weak references can be to."""


def lose(number, monkeypatch):
    """Send us a signal that comes while Python ignores what is raised."""
    ignored = []
    monkeypatch.setattr(sys, "unraisablehook", ignored.append)
    thing = Thing()
    watcher = weakref.ref(thing, lambda _reference: os.kill(os.getpid(), number))
    del thing
    assert watcher() is None
    assert [type(one.exc_value) for one in ignored] == [Terminated if number == signal.SIGTERM else KeyboardInterrupt]


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)])
def test_what_was_lost_within_is_raised_at_the_end(number, raised, monkeypatch):
    with pytest.raises(raised), never_missed():
        lose(number, monkeypatch)


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, Terminated)])
def test_what_is_not_lost_ends_the_block_where_it_comes(number, raised):
    with pytest.raises(raised), never_missed():
        raise RuntimeError(os.kill(os.getpid(), number))


@pytest.mark.parametrize("block", [terminable, never_missed])
def test_afterwards_signals_do_what_they_did_before(block):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with pytest.raises(Terminated), block():
        os.kill(os.getpid(), signal.SIGTERM)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
