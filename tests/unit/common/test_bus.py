"""Topics, services and tokens over a real router: what arrives, in which order, and what is refused."""

import json
import signal
import subprocess
import threading
import time
import uuid
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from queue import SimpleQueue

import numpy as np
import pytest
import zenoh

from railctl.common import bus as bus_module
from railctl.common.bus import NoAnswer, Traffic, checksum, open_bus, open_router
from railctl.common.inbox import Inbox
from railctl.common.interpreter import PYTHON
from railctl.common.private import private_endpoint, remove_endpoint
from railctl.common.records.acting import Weights
from railctl.common.records.control import CommandAnswer, Empty
from railctl.common.records.rows import HistoryRequest
from railctl.common.wire.codec import SCHEMA_VERSION, encode, encoding_of
from railctl.common.wire.keys import ALL_ALIVE, Alive, Service, Topic

PATIENCE_S = 10.0
NUMBERS = Topic("numbers", HistoryRequest)
ARRAYS = Topic("arrays", Weights)
HELLO = Topic("hello", Empty)
ECHO = Service("echo", HistoryRequest, CommandAnswer)
READY = Service("ready", Empty, Empty)

MEMBER = """
import sys
from railctl.common.bus import open_bus
from railctl.common.wire.keys import Alive
endpoint, namespace = sys.argv[1:]
with open_bus(endpoint, namespace) as bus:
    bus.declare_alive(Alive("actor", "actor-easy-0", "one"))
    print("alive", flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def socket():
    """Where a router may listen."""
    made = private_endpoint()
    yield made
    remove_endpoint(made)


@pytest.fixture(scope="module")
def endpoint():
    address = private_endpoint()
    with open_router(address):
        yield address
    remove_endpoint(address)


@pytest.fixture
def namespace():
    return f"railctl/{uuid.uuid4().hex[:12]}"


@pytest.fixture
def buses(endpoint, namespace):
    """A listener and a talker of one run."""
    with open_bus(endpoint, namespace, PATIENCE_S) as listener, open_bus(endpoint, namespace, PATIENCE_S) as talker:
        yield listener, talker


@pytest.fixture
def stranger(endpoint):
    """A session that follows none of our rules."""
    settings = {"mode": "client", "connect": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        yield session


def introduce(listener, talker):
    """Return when the talker's messages reach all subscriptions and services that the listener has by now."""
    heard = threading.Event()
    listener.subscribe(HELLO, lambda _hello: heard.set())
    deadline = time.monotonic() + PATIENCE_S
    while not heard.wait(0.01):
        talker.publish(HELLO, Empty())
        assert time.monotonic() < deadline
    listener.serve(READY, lambda question: question.answer(Empty()))
    until(lambda: answers(talker))


def answers(talker):
    try:
        talker.ask(READY, Empty(), PATIENCE_S)
    except NoAnswer:
        return False
    return True


def until(come_true):
    """Wait for something that sends no event."""
    tick = threading.Event()
    deadline = time.monotonic() + PATIENCE_S
    while not come_true():
        assert time.monotonic() < deadline
        tick.wait(0.01)


def echo(question):
    question.answer(CommandAnswer(done=True, text=str(question.request.first)))


def number(value):
    return HistoryRequest(first=value)


def no_answer(talker, service=ECHO, timeout_s=PATIENCE_S, **options):
    with pytest.raises(NoAnswer) as caught:
        talker.ask(service, number(1), timeout_s, **options)
    return str(caught.value)


def test_published_messages_arrive_once_and_in_order(buses):
    listener, talker = buses
    arrived = SimpleQueue()
    listener.subscribe(NUMBERS, arrived.put)
    introduce(listener, talker)
    for value in range(200):
        talker.publish(NUMBERS, number(value))
    assert [arrived.get(timeout=PATIENCE_S).first for _ in range(200)] == list(range(200))
    assert arrived.empty()


def test_a_loop_may_take_what_arrives_from_an_inbox_of_its_own(endpoint, namespace, buses):
    _, talker = buses
    inbox, handled = Inbox(), []
    with open_bus(endpoint, namespace, PATIENCE_S, inbox) as listener, ThreadPoolExecutor() as pool:
        listener.subscribe(NUMBERS, lambda record: handled.append((record.first, threading.current_thread())))
        introduced = pool.submit(introduce, listener, talker)
        while not introduced.done():
            inbox.take(0.01)
        talker.publish(NUMBERS, number(7))
        while not handled:
            inbox.take(PATIENCE_S)
    assert handled == [(7, threading.current_thread())]


def test_of_a_flood_of_questions_only_so_many_wait_and_the_others_end_at_once(endpoint, namespace, buses, monkeypatch):
    _, talker = buses
    monkeypatch.setattr(bus_module, "MOST_QUESTIONS", 2)
    inbox = Inbox()
    with open_bus(endpoint, namespace, PATIENCE_S, inbox) as listener, ThreadPoolExecutor() as pool:
        listener.serve(ECHO, echo)
        introduced = pool.submit(introduce, listener, talker)
        while not introduced.done():
            inbox.take(0.01)
        for _ in range(2):  # there is room again for as many as have been taken
            asked = [talker.ask_for_answers(ECHO, number(value), 60.0) for value in range(4)]
            for flooding in asked[2:]:
                with pytest.raises(NoAnswer, match="nobody answers"):
                    flooding.next(60.0)
            inbox.take()
            assert [answers.next(PATIENCE_S).text for answers in asked[:2]] == ["0", "1"]


def test_messages_and_bytes_are_counted_at_both_ends(buses):
    listener, talker = buses
    listener.serve(ECHO, echo)
    introduce(listener, talker)
    before = replace(listener.traffic), replace(talker.traffic)
    answer = talker.ask(ECHO, number(5), PATIENCE_S)
    size = len(encode(number(5))) + len(encode(answer))
    for bus, earlier in zip((listener, talker), before, strict=True):
        assert bus.traffic == Traffic(earlier.messages + 2, earlier.size + size)


def test_large_arrays_arrive_bit_for_bit(buses):
    listener, talker = buses
    arrived = SimpleQueue()
    listener.subscribe(ARRAYS, arrived.put)
    introduce(listener, talker)
    tensor = np.random.default_rng(1).standard_normal((700, 500)).astype(np.float32)
    talker.publish(ARRAYS, Weights(version=3, tensors={"w": tensor}))
    back = arrived.get(timeout=PATIENCE_S)
    assert back.version == 3
    assert back.tensors["w"].tobytes() == tensor.tobytes()


def test_every_subscriber_gets_a_message(endpoint, namespace, buses):
    listener, talker = buses
    with open_bus(endpoint, namespace, PATIENCE_S) as other:
        heard = SimpleQueue()
        listener.subscribe(NUMBERS, lambda _: heard.put("listener"))
        introduce(listener, talker)
        other.subscribe(NUMBERS, lambda _: heard.put("other"))
        introduce(other, talker)
        talker.publish(NUMBERS, number(1))
        assert {heard.get(timeout=PATIENCE_S), heard.get(timeout=PATIENCE_S)} == {"listener", "other"}


def test_a_question_is_answered(buses):
    listener, talker = buses
    listener.serve(ECHO, echo)
    introduce(listener, talker)
    for value in range(50):
        assert talker.ask(ECHO, number(value), PATIENCE_S) == CommandAnswer(done=True, text=str(value))


def test_a_question_that_nobody_serves_has_no_answer_at_once(buses):
    _, talker = buses
    begin = time.monotonic()
    assert no_answer(talker) == "echo: nobody answers"
    assert time.monotonic() - begin < PATIENCE_S / 2


def test_a_refused_question_has_the_reason_for_an_answer(buses):
    listener, talker = buses
    listener.serve(ECHO, lambda question: question.refuse("not on a Sunday"))
    introduce(listener, talker)
    assert no_answer(talker) == "echo: not on a Sunday"


def test_a_dropped_question_has_no_answer_at_once(buses):
    listener, talker = buses
    listener.serve(ECHO, lambda question: question.drop())
    introduce(listener, talker)
    begin = time.monotonic()
    assert no_answer(talker) == "echo: nobody answers"
    assert time.monotonic() - begin < PATIENCE_S / 2


def test_a_question_that_is_kept_for_too_long_has_no_answer(buses):
    listener, talker = buses
    kept = SimpleQueue()
    listener.serve(ECHO, kept.put)
    introduce(listener, talker)
    begin = time.monotonic()
    assert no_answer(talker, timeout_s=0.3).startswith("echo: ")
    assert 0.25 < time.monotonic() - begin < 0.3 + bus_module.GRACE_S + 1
    kept.get(timeout=PATIENCE_S).answer(CommandAnswer(done=True, text="late"))  # and nothing breaks


def test_an_asker_may_give_up(buses):
    listener, talker = buses
    kept = SimpleQueue()
    listener.serve(ECHO, kept.put)
    introduce(listener, talker)
    begin = time.monotonic()
    assert no_answer(talker, give_up=lambda: not kept.empty()) == "echo: nobody answers"
    assert time.monotonic() - begin < PATIENCE_S / 2
    kept.get().drop()


def test_a_question_may_be_answered_later_from_another_thread(buses):
    listener, talker = buses
    kept = SimpleQueue()
    listener.serve(ECHO, kept.put)
    introduce(listener, talker)
    asked = threading.Event()

    def answer_when_told():
        question = kept.get(timeout=PATIENCE_S)
        asked.wait(PATIENCE_S)
        echo(question)

    answering = threading.Thread(target=answer_when_told)
    answering.start()

    def let_it_answer():
        asked.set()  # the asker is waiting by now
        return False

    assert talker.ask(ECHO, number(7), PATIENCE_S, let_it_answer).text == "7"
    answering.join()


def test_a_question_is_open_until_its_last_answer(buses):
    listener, talker = buses
    kept = SimpleQueue()
    listener.serve(ECHO, kept.put)
    introduce(listener, talker)
    answers = talker.ask_for_answers(ECHO, number(7), PATIENCE_S)
    question = kept.get(timeout=PATIENCE_S)
    for count in range(3):
        question.answer(CommandAnswer(done=True, text=str(count)), last=count == 2)
        assert answers.next(PATIENCE_S).text == str(count)
    with pytest.raises(NoAnswer):
        answers.next(PATIENCE_S)


def test_an_open_question_ends_with_who_answers_it(endpoint, namespace, buses):
    _, talker = buses
    kept = SimpleQueue()
    with open_bus(endpoint, namespace, PATIENCE_S) as listener:
        listener.serve(ECHO, kept.put)
        introduce(listener, talker)
        answers = talker.ask_for_answers(ECHO, number(7), PATIENCE_S)
        kept.get(timeout=PATIENCE_S).answer(CommandAnswer(done=True, text="first"), last=False)
        assert answers.next(PATIENCE_S).text == "first"
    begun = time.monotonic()
    with pytest.raises(NoAnswer):
        answers.next(PATIENCE_S)
    assert time.monotonic() - begun < PATIENCE_S / 2


def test_questions_of_many_are_answered_each_with_its_own(endpoint, namespace, buses):
    listener, talker = buses
    kept = []
    listener.serve(ECHO, kept.append)
    introduce(listener, talker)
    got = {}
    with ExitStack() as stack:
        askers = [stack.enter_context(open_bus(endpoint, namespace, PATIENCE_S)) for _ in range(3)]
        until(lambda: all(answers(asker) for asker in askers))

        def ask(index):
            got[index] = askers[index].ask(ECHO, number(index), PATIENCE_S).text

        threads = [threading.Thread(target=ask, args=(index,)) for index in range(3)]
        for thread in threads:
            thread.start()
        until(lambda: len(kept) == 3)
        for question in reversed(kept):
            echo(question)
        for thread in threads:
            thread.join()
    assert got == {0: "0", 1: "1", 2: "2"}


@pytest.mark.parametrize("size", [1, 50_000])
def test_what_is_published_before_a_question_is_known_when_it_is_asked(buses, size):
    listener, talker = buses
    seen = []
    listener.subscribe(ARRAYS, lambda weights: seen.append(weights.version))
    listener.serve(
        ECHO, lambda question: question.answer(CommandAnswer(done=question.request.first in seen, text=str(seen[-1:])))
    )
    introduce(listener, talker)
    tensors = {"w": np.zeros(size, np.float32)}
    for value in range(150):
        talker.publish(ARRAYS, Weights(version=value, tensors=tensors))
        answer = talker.ask(ECHO, number(value), PATIENCE_S)
        assert answer.done, (value, answer.text)


def test_the_service_of_a_closed_session_is_gone(endpoint, namespace, buses):
    _, talker = buses
    asked = threading.Event()
    with open_bus(endpoint, namespace, PATIENCE_S) as server:
        server.serve(ECHO, lambda _question: asked.set())
        introduce(server, talker)
        closing = threading.Thread(target=lambda: asked.wait(PATIENCE_S) and server.close())
        closing.start()
        begin = time.monotonic()
        assert no_answer(talker).startswith("echo: ")
        assert time.monotonic() - begin < PATIENCE_S / 2
        closing.join()
    assert no_answer(talker) == "echo: nobody answers"


def tokens(listener):
    """Changes of tokens as they come."""
    changes = SimpleQueue()
    listener.watch_alive(ALL_ALIVE, lambda alive, there: changes.put((alive, there)))
    return changes


def test_the_token_of_a_killed_process_goes(endpoint, namespace, buses):
    listener, _ = buses
    changes = tokens(listener)
    alive = Alive("actor", "actor-easy-0", "one")
    with subprocess.Popen(
        [*PYTHON, "-c", MEMBER, endpoint, namespace], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        try:
            assert changes.get(timeout=PATIENCE_S) == (alive, True)
            late = tokens(listener)
            assert late.get(timeout=PATIENCE_S) == (alive, True)  # those that are there already come too
        finally:
            process.send_signal(signal.SIGKILL)
        assert changes.get(timeout=PATIENCE_S) == (alive, False)
        assert late.get(timeout=PATIENCE_S) == (alive, False)
    assert changes.empty()


def test_tokens_come_with_a_session_and_go_with_it(endpoint, namespace, buses):
    listener, _ = buses
    changes = tokens(listener)
    first, second = Alive("actor", "actor-easy-0", "one"), Alive("actor", "actor-easy-0", "two")
    for alive in (first, second):
        with open_bus(endpoint, namespace, PATIENCE_S) as member:
            member.declare_alive(alive)
            assert changes.get(timeout=PATIENCE_S) == (alive, True)
        assert changes.get(timeout=PATIENCE_S) == (alive, False)


def test_a_token_of_another_form_is_refused(namespace, buses, stranger):
    listener, talker = buses
    changes = SimpleQueue()
    listener.watch_alive("alive/**", lambda alive, there: changes.put((alive, there)))
    token = stranger.liveliness().declare_token(f"{namespace}/alive/nobody")
    until(lambda: listener.refused == 1)
    talker.declare_alive(Alive("learner", "learner", "one"))
    assert changes.get(timeout=PATIENCE_S) == (Alive("learner", "learner", "one"), True)
    token.undeclare()


@pytest.mark.parametrize(
    ("body", "encoding"),
    [
        (encode(number(1)), f"application/msgpack;railctl.HistoryRequest.{SCHEMA_VERSION + 1}"),
        (encode(number(1)), "application/msgpack;railctl.Empty.1"),
        (encode(number(1)), "zenoh/bytes"),
        (b"\xc1", encoding_of(HistoryRequest)),
        (b"", encoding_of(HistoryRequest)),
    ],
)
def test_a_refused_message_is_counted_and_the_next_one_arrives(namespace, buses, stranger, body, encoding, caplog):
    listener, talker = buses
    arrived = SimpleQueue()
    listener.subscribe(NUMBERS, arrived.put)
    introduce(listener, talker)
    stranger.put(f"{namespace}/numbers", body, encoding=encoding, attachment=checksum(body))
    until(lambda: listener.refused == 1)
    talker.publish(NUMBERS, number(2))
    assert arrived.get(timeout=PATIENCE_S) == number(2)
    assert arrived.empty()
    assert "refused a message on numbers (the 1.): " in caplog.text


@pytest.mark.parametrize("beside", [None, b"", checksum(encode(number(2)))])
def test_what_is_not_as_it_was_sent_is_refused_though_it_is_a_message(namespace, buses, stranger, beside, caplog):
    listener, talker = buses
    arrived = SimpleQueue()
    listener.subscribe(NUMBERS, arrived.put)
    introduce(listener, talker)
    encoding = encoding_of(HistoryRequest)
    stranger.put(f"{namespace}/numbers", encode(number(1)), encoding=encoding, attachment=beside)
    until(lambda: listener.refused == 1)
    talker.publish(NUMBERS, number(2))
    assert arrived.get(timeout=PATIENCE_S) == number(2)
    assert "its checksum is missing or wrong" in caplog.text


def test_a_refused_question_names_the_reason_and_the_next_one_is_answered(namespace, buses, stranger):
    listener, talker = buses
    listener.serve(ECHO, echo)
    introduce(listener, talker)
    for body, encoding, reason in (
        (encode(number(1)), "zenoh/bytes", "schema is 'zenoh/bytes', this process speaks"),
        (b"\xc1", encoding_of(HistoryRequest), "HistoryRequest: not a message"),
        (b"", None, "schema is "),
    ):
        told = {"encoding": encoding, "attachment": checksum(body), "timeout": PATIENCE_S}
        [reply] = stranger.get(f"{namespace}/echo", payload=body, **told)
        assert reply.err.payload.to_string().startswith(reason)
    assert listener.refused == 3
    assert talker.ask(ECHO, number(4), PATIENCE_S).text == "4"


@pytest.mark.parametrize(
    ("body", "encoding", "reason"),
    [
        (encode(Empty()), encoding_of(Empty), f"echo: schema is 'application/msgpack;railctl.Empty.{SCHEMA_VERSION}'"),
        (b"\xc1", encoding_of(CommandAnswer), "echo: CommandAnswer: not a message"),
    ],
)
def test_an_answer_that_is_none_is_refused(namespace, buses, stranger, body, encoding, reason):
    _, talker = buses

    def misanswer(query):
        with query:
            query.reply(f"{namespace}/echo", body, encoding=encoding, attachment=checksum(body))

    served = stranger.declare_queryable(f"{namespace}/echo", misanswer, complete=True)
    texts = []
    until(lambda: texts.append(no_answer(talker)) or texts[-1] != "echo: nobody answers")
    assert texts[-1].startswith(reason)
    assert talker.refused == 1
    served.undeclare()


def test_a_refusal_that_is_no_text_is_no_answer(namespace, buses, stranger):
    _, talker = buses

    def misanswer(query):
        with query:
            query.reply_err(b"\xff\xfe")

    served = stranger.declare_queryable(f"{namespace}/echo", misanswer, complete=True)
    try:
        until(lambda: no_answer(talker) != "echo: nobody answers")
    finally:
        served.undeclare()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_an_error_in_a_callback_does_not_make_the_bus_deaf(buses):
    listener, talker = buses
    arrived = SimpleQueue()

    def stumble(message):
        if message.first == 0:
            raise RuntimeError("stumbled")
        arrived.put(message)

    listener.subscribe(NUMBERS, stumble)
    introduce(listener, talker)
    for value in (0, 1):
        talker.publish(NUMBERS, number(value))
    until(lambda: not arrived.empty() or not listener._dispatcher.is_alive())
    assert listener._dispatcher.is_alive()
    assert arrived.get(timeout=PATIENCE_S) == number(1)


def test_runs_do_not_hear_each_other(endpoint, buses):
    listener, talker = buses
    other_namespace = f"railctl/{uuid.uuid4().hex[:12]}"
    heard = SimpleQueue()
    with (
        open_bus(endpoint, other_namespace, PATIENCE_S) as other_listener,
        open_bus(endpoint, other_namespace, PATIENCE_S) as other_talker,
    ):
        listener.subscribe(NUMBERS, lambda message: heard.put(("ours", message.first)))
        listener.serve(ECHO, echo)
        other_listener.subscribe(NUMBERS, lambda message: heard.put(("theirs", message.first)))
        changes = tokens(other_listener)
        introduce(listener, talker)
        introduce(other_listener, other_talker)
        talker.publish(NUMBERS, number(1))
        assert heard.get(timeout=PATIENCE_S) == ("ours", 1)
        other_talker.publish(NUMBERS, number(2))
        assert heard.get(timeout=PATIENCE_S) == ("theirs", 2)
        assert heard.empty()
        assert no_answer(other_talker) == "echo: nobody answers"
        talker.declare_alive(Alive("actor", "ours", "one"))
        until(lambda: ours_is_seen(listener))
        other_talker.declare_alive(Alive("actor", "theirs", "one"))
        assert changes.get(timeout=PATIENCE_S)[0].process == "theirs"
        assert changes.empty()
        assert listener.refused == other_listener.refused == 0


def ours_is_seen(listener):
    return not tokens(listener).empty()


def test_a_bus_to_nowhere_has_no_answer_in_time(socket):
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match=f"no router at {socket}"), open_bus(socket, "nowhere", 0.3):
        pass
    assert time.monotonic() - begin < 3


def test_a_router_does_not_share_its_socket(endpoint):
    with pytest.raises(OSError, match=f"cannot listen on {endpoint}"), open_router(endpoint):
        pass


def test_a_bus_outlives_its_router(namespace, socket):
    heard = threading.Event()
    with ExitStack() as stack:
        with open_router(socket):
            listener = stack.enter_context(open_bus(socket, namespace, PATIENCE_S))
            talker = stack.enter_context(open_bus(socket, namespace, PATIENCE_S))
            listener.subscribe(NUMBERS, lambda _: heard.set())
            listener.serve(ECHO, echo)
            introduce(listener, talker)
            assert listener.connected()
        until(lambda: not listener.connected() and not talker.connected())
        assert no_answer(talker).startswith("echo: ")
        talker.publish(NUMBERS, number(0))  # lost, and no error
        with open_router(socket):
            until(lambda: listener.connected() and talker.connected() and answers(talker))
            talker.publish(NUMBERS, number(1))
            assert heard.wait(PATIENCE_S)
            assert talker.ask(ECHO, number(5), PATIENCE_S).text == "5"


def test_nothing_is_handed_out_after_the_end(endpoint, namespace):
    heard = []
    with open_bus(endpoint, namespace, PATIENCE_S) as talker:
        with open_bus(endpoint, namespace, PATIENCE_S) as listener:
            listener.subscribe(NUMBERS, heard.append)
            introduce(listener, talker)
        talker.publish(NUMBERS, number(1))
        with open_bus(endpoint, namespace, PATIENCE_S) as listener:
            introduce(listener, talker)
    assert heard == []
    talker.publish(NUMBERS, number(2))  # on a closed session: a warning, no error
    assert "closed" in no_answer(talker).lower()
