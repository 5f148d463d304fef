"""Calls from other threads are made on the thread that takes them, in their order."""

import threading
from functools import partial

from railctl.common.inbox import Inbox


def test_calls_wait_until_they_are_taken_and_keep_their_order():
    inbox, made = Inbox(), []

    def note(number):
        made.append((number, threading.get_ident()))

    other = threading.Thread(target=lambda: [inbox.put(partial(note, number)) for number in (1, 2)])
    other.start()
    other.join()
    assert made == []
    inbox.take()
    here = threading.get_ident()
    assert made == [(1, here), (2, here)]
    inbox.take()
    assert len(made) == 2


def test_a_wait_ends_with_the_first_call():
    inbox, made = Inbox(), []
    timer = threading.Thread(target=inbox.put, args=(lambda: made.append(7),))
    timer.start()
    inbox.take(wait_s=60.0)
    timer.join()
    assert made == [7]


def test_calls_that_come_meanwhile_wait_for_the_next_time():
    inbox, made = Inbox(), []

    def call_again():
        made.append(len(made))
        if len(made) < 10:
            inbox.put(call_again)

    inbox.put(call_again)
    inbox.put(call_again)
    for expected in (2, 4):
        inbox.take()
        assert len(made) == expected
