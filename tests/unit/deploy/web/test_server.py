"""Every address of the page, asked over a real socket."""

import gzip
import json
import threading

import pytest

from railctl.common.bus import NoAnswer
from railctl.deploy.web import server, steering
from railctl.deploy.web.guard import HEADERS
from railctl.deploy.web.server import MOST_BODY_BYTES, MOST_SHOWN, STATIC

EVIL = {"Host": "evil.example"}
PLAYBACK = {"run": "one", "player": "random", "level": "easy", "number": 3}


def document(answer):
    body = answer.body
    return json.loads(gzip.decompress(body) if answer.headers["Content-Encoding"] == "gzip" else body)


@pytest.mark.parametrize(
    "path", ["/", "/runs/one", "/runs/mini/runs/ppo-easy-1", "/studies/mini", "/compare?run=a&run=b"]
)
def test_every_page_is_the_same_file(asking, path):
    answer = asking.get(path)
    assert answer.body == (STATIC / "index.html").read_bytes()
    assert {name: answer.headers[name] for name in HEADERS} == dict(HEADERS)


@pytest.mark.parametrize("path", sorted(STATIC.iterdir()), ids=lambda path: path.name)
def test_static_files_come_with_their_kind(asking, path):
    answer = asking.get(f"/static/{path.name}")
    assert (answer.code, answer.body) == (200, path.read_bytes())
    kinds = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml", ".html": "text/html"}
    assert answer.headers["Content-Type"].partition(";")[0] == kinds[path.suffix]


@pytest.mark.parametrize(
    "path",
    [
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/..%2fserver.py",
        "/static//etc/passwd",
        "/etc/passwd",
        "/api/nothing",
        "/static/",
    ],
)
def test_nothing_else_is_served(asking, path):
    assert asking.get(path).code == 404


@pytest.mark.parametrize("path", ["/", "/static/main.js", "/api/list", "/api/stream?run=one"])
def test_other_names_are_refused(asking, path):
    answer = asking.get(path, headers=EVIL)
    assert answer.code == 403
    assert answer.headers["Content-Security-Policy"]


def test_a_page_knows_whether_it_steers(asking, serve):
    assert document(asking.get("/api/session", headers={"X-Railctl-Key": asking.keys.key})) == {
        "steers": True,
        "read_only": False,
    }
    assert document(asking.get("/api/session")) == {"steers": False, "read_only": False}
    assert document(serve(read_only=True).get("/api/session")) == {"steers": False, "read_only": True}


def test_runs_are_listed(make, asking):
    make("one", [-0.5] * 20)
    listed = document(asking.get("/api/list"))
    assert [(run["run"], run["state"], run["done"]) for run in listed["runs"]] == [("one", "finished", 20)]
    assert (listed["studies"], listed["named"]) == ([], [])


def test_runs_are_streamed(make, asking):
    make("one", [-0.5] * 20)
    make("two", [-0.25] * 20)
    with asking.stream("run=one&run=two&run=nosuch") as events:
        found = [next(events) for _ in range(9)]
    problem = [event for kind, event in found if kind == "problem"]
    assert [(one["name"], "no run named" in one["text"]) for one in problem] == [("nosuch", True)]
    assert {(kind, event["name"]) for kind, event in found if kind != "problem"} == {
        (kind, name) for kind in ("evaluations", "run", "curves", "metrics") for name in ("one", "two")
    }


def test_tabs_share_a_thread(make, asking):
    make("one", [-0.5] * 20)
    with asking.stream("run=one") as first, asking.stream("run=one") as second:
        assert next(first)[0] == next(second)[0] == "evaluations"
        assert len(asking.page.watching._lookers) == 1


@pytest.mark.parametrize("query", ["", "other=one", "&".join(f"run={number}" for number in range(MOST_SHOWN + 1))])
def test_a_stream_of_nothing_or_too_much_is_refused(asking, query):
    assert asking.get(f"/api/stream?{query}").code == 400


def test_a_name_given_often_is_shown_once_and_waited_for_once(make, asking):
    make("one", [-0.5] * 20)
    before = threading.active_count()
    for _ in range(5):
        with asking.stream("&".join(["run=one"] * 50)) as events:
            assert next(events)[0] == "evaluations"
    assert threading.active_count() <= before + 5  # one looks, one waits, and the server's own


def test_who_may_play_is_told(make, asking):
    make("one")
    players = document(asking.get("/api/players", run="one"))
    assert players["levels"] == [{"name": "easy", "count": 1000, "references": True}]
    assert "pretrained/dispatch-hard" in players["pretrained"]
    assert "planner" in players["references"]


@pytest.fixture
def tasks(asking, monkeypatch):
    """What tasks are asked; they bring what they were asked."""
    asked = []

    class Task:
        def __init__(self, module, request):
            self.request = json.loads(request)
            asked.append((module, self.request))

        def wait(self):
            pass

        def result(self):
            return {"rows": [self.request]}

    monkeypatch.setattr("railctl.deploy.web.tasks.Task", Task)
    return asked


def test_a_level_is_played_once(make, asking, tasks):
    folder = make("one")
    first, second = (asking.get("/api/playback", **PLAYBACK) for _ in range(2))
    assert first.body == second.body
    [(module, request)] = tasks
    assert (module, request["policy"], request["number"]) == (server.PLAYER, "random", 3)
    assert request["levels"]["names"] == ["easy"]
    (folder.checkpoints / "00000020.safetensors").touch()
    asking.get("/api/playback", **PLAYBACK | {"player": "checkpoint:20"})
    assert tasks[1][1]["checkpoint"] == str(folder.checkpoints.resolve() / "00000020.safetensors")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"run": "../one"}, "no name"),
        ({"run": "nosuch"}, "no run named"),
        ({"level": "nosuch"}, "level nosuch"),
        ({"number": "1000"}, "evaluation levels 0 to 999"),
        ({"number": "-1"}, "number -1"),
        ({"number": "9" * 30}, "number 999"),
        ({"player": "checkpoint:20"}, "no such checkpoint"),
        ({"player": "checkpoint:../../x"}, "no such checkpoint"),
        ({"player": "/etc/passwd"}, "player /etc/passwd"),
        ({"player": "pretrained/../presets/ppo"}, "player pretrained/.."),
    ],
)
def test_what_cannot_be_played_is_said(make, asking, tasks, changes, text):
    make("one")
    answer = asking.get("/api/playback", **PLAYBACK | changes)
    assert answer.code == 400
    assert text in document(answer)["error"]
    assert tasks == []


def test_what_is_missing_is_named(make, asking):
    make("one")
    assert document(asking.get("/api/playback", run="one"))["error"] == "player is missing: give it a value"


def test_reference_policies_are_scored_by_who_steers(make, asking, tasks):
    make("one", evaluation={"levels": 20})
    wanted = {"run": "one", "policy": "planner", "level": "easy"}
    assert asking.post("/api/references", wanted, key=False).code == 403
    assert asking.post("/api/references", wanted).code == 200
    [(module, request)] = tasks
    assert (module, request["policy"], request["levels"]["episodes"]) == (server.REFERENCE_SCORER, "planner", 20)
    assert asking.post("/api/references", wanted | {"policy": "nosuch"}).code == 400


def test_a_run_of_its_own_has_no_references_yet(make, asking):
    make("one")
    assert document(asking.get("/api/references", run="one")) == {"easy": {"scores": {}, "scorable": True}}


def test_a_run_of_a_study_has_those_of_the_study(make, root, asking):
    make("mini/runs/ppo-easy-1", evaluation={"levels": 2})
    (root / "mini" / "study.yaml").touch()
    (root / "mini" / "references").mkdir()
    row = {"level": "easy", "levels": 3, "mean": -0.5, "low": -0.75, "high": -0.25, "returns": [-0.25, -0.25, -1.0]}
    (root / "mini" / "references" / "random-easy.json").write_text(json.dumps({"rows": [row]}))
    (root / "mini" / "references" / "planner-easy.json").write_text("damaged")
    scores = document(asking.get("/api/references", run="mini/runs/ppo-easy-1"))["easy"]["scores"]
    assert scores == {"random": {"mean": -0.25, "low": -0.25, "high": -0.25, "levels": 2}}  # of the same two levels


@pytest.fixture
def commands(monkeypatch):
    """What runs are told."""
    told = []
    monkeypatch.setattr(
        steering, "scale_to", lambda folder, counts: told.append((folder.path.name, counts)) or "scaled"
    )
    monkeypatch.setattr(steering, "supervised", lambda _folder: True)
    monkeypatch.setattr(steering, "ask_to_stop", lambda folder: told.append((folder.path.name, "down")))
    return told


def test_with_the_key_a_page_scales(make, asking, commands):
    make("one")
    answer = asking.post("/api/steer", {"run": "one", "verb": "scale", "actors": {"easy": 2}})
    assert (answer.code, document(answer)) == (200, {"text": "scaled"})
    assert commands == [("one", {"easy": 2})]


def test_with_the_key_a_page_stops_a_run(make, asking, commands):
    make("one")
    assert "railctl up --name one" in document(asking.post("/api/steer", {"run": "one", "verb": "down"}))["text"]
    assert commands == [("one", "down")]


@pytest.mark.parametrize("headers", [{"Origin": "http://evil.example"}, {"Sec-Fetch-Site": "cross-site"}, EVIL])
def test_others_do_not_steer(make, asking, commands, headers):
    make("one")
    assert asking.post("/api/steer", {"run": "one", "verb": "down"}, headers=headers).code == 403
    assert commands == []


def test_without_the_key_or_where_nobody_steers_nothing_happens(make, asking, serve, commands):
    make("one")
    command = {"run": "one", "verb": "down"}
    assert "has a key" in document(asking.post("/api/steer", command, key=False))["error"]
    assert "--read-only" in document(serve(read_only=True).post("/api/steer", command))["error"]
    assert commands == []


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (b"nonsense", "a command is a JSON object"),
        (b"[1]", "a command is a JSON object"),
        (b"x" * (MOST_BODY_BYTES + 1), "at most"),
        ({"run": "one", "verb": "burn"}, "verb"),
        ({"run": "one", "verb": "scale"}, "actors is empty"),
        ({"run": "one", "verb": "scale", "actors": {"easy": 1000}}, "actors.easy"),
        ({"run": "one", "verb": "scale", "actors": {"../x": 1}}, "actors"),
        ({"run": "one", "verb": "down", "force": True}, "unknown key force"),
        ({"run": "../one", "verb": "down"}, "no name"),
    ],
)
def test_wrong_commands_are_told_what_is_wrong(make, asking, commands, command, text):
    make("one")
    answer = asking.post("/api/steer", command)
    assert answer.code == 400
    assert text in document(answer)["error"]
    assert commands == []


def test_a_run_that_does_not_answer_is_said_so(make, asking, monkeypatch):
    make("one")

    def silent(*_arguments):
        raise NoAnswer("run one is not running: railctl up --name one resumes it")

    monkeypatch.setattr(steering, "tell_learner", silent)
    answer = asking.post("/api/steer", {"run": "one", "verb": "pause"})
    assert (answer.code, "is not running" in document(answer)["error"]) == (409, True)
    assert asking.post("/api/steer", {"run": "one", "verb": "down"}).code == 409  # nobody supervises it
