"""A learner without actors acts itself, hands over when one comes, and goes on when it has gone."""

import json

from test_learner_restart import Cluster, config

from railctl.common.folder import RunFolder
from railctl.common.levels.supply import LevelSupply
from railctl.common.wire.keys import Alive
from railctl.deploy.resolve import resolve
from railctl.services.learner.inline_actor import NAME, InlineActor

EPISODES = 3


def serial():
    return config(0, cluster={"actors": {}}, episodes=EPISODES, fragment_steps=100)


def wants(folder, count):
    """What the supervisor notes of how many actors there shall be."""
    folder.cluster_file.write_text(json.dumps({"actors": {"easy": count}}))


def begun(path):
    path.mkdir()
    folder = RunFolder(path)
    wants(folder, 0)
    return Cluster(folder, serial())


def digests(cluster):
    return [row.digest for row in cluster.rows()]


def test_acting_goes_to_an_actor_within_an_episode_and_back(tmp_path):
    undisturbed = begun(tmp_path / "undisturbed")
    undisturbed.learner.turn()  # it asks itself
    undisturbed.learner.turn()
    fragments = undisturbed.wire.heard
    undisturbed.learner.close()
    assert len(digests(undisturbed)) == EPISODES
    middle = next(number for number, fragment in enumerate(fragments) if fragment.lease.fragment == 1)

    cluster = begun(tmp_path / "disturbed")
    train, heard = cluster.learner._trainer.train, cluster.wire.heard

    def come_meanwhile(fragment):
        if len(heard) == middle:
            cluster.come("one")
        return train(fragment)

    cluster.learner._trainer.train = come_meanwhile
    cluster.learner.turn()
    cluster.learner.turn()
    assert len(heard) == middle
    lease = cluster.lease("one")
    assert lease.unit == fragments[middle].lease.unit
    actor = InlineActor(serial(), LevelSupply(serial().world.levels))
    actor.lease = lease
    fragment = actor.act({lease.weights_version: cluster.weights(lease.weights_version).tensors})
    assert fragment.digest == fragments[middle].digest
    circumstances = fragment.circumstances.model_copy(update={"actor": "one"})
    cluster.bring(fragment.model_copy(update={"circumstances": circumstances}))
    assert len(heard) == middle

    cluster.wire.on_alive(Alive("actor", "one", "one"), False)
    cluster.learner.turn()
    cluster.learner.turn()
    cluster.learner.close()
    assert digests(cluster) == digests(undisturbed)
    assert {fragment.circumstances.actor for fragment in heard} == {NAME}
    assert [fragment.lease.unit for fragment in [*heard[:middle], fragments[middle], *heard[middle:]]] == [
        fragment.lease.unit for fragment in fragments
    ]


def test_a_free_run_without_actors_is_the_serial_one(tmp_path):
    """What it acts itself has the weights of now, so that there is nothing to correct, to the bit."""
    curves = []
    for lag in (0, "free"):
        (tmp_path / str(lag)).mkdir()
        folder = RunFolder(tmp_path / str(lag))
        wants(folder, 0)
        given = {"algorithm": "ppo", "lag": lag, "episodes": EPISODES, "cluster": {"actors": {}}}
        cluster = Cluster(folder, resolve(given))
        for _ in range(2):
            cluster.learner.turn()
        cluster.learner.close()
        curves.append([(row.digest, row.staleness) for row in cluster.rows()])
    assert curves[0] == curves[1]
    assert [staleness for _, staleness in curves[1]] == [0] * EPISODES


def test_a_paused_learner_acts_nothing(tmp_path):
    folder = RunFolder(tmp_path)
    wants(folder, 0)
    folder.paused_file.touch()
    cluster = Cluster(folder, serial())
    for _ in range(3):
        cluster.learner.turn()
    assert cluster.wire.heard == []
    assert cluster.report.waiting == {}  # for an actor
    cluster.learner.close()


def test_a_run_that_shall_have_actors_waits_for_them_whoever_began_it(tmp_path):
    folder = RunFolder(tmp_path)
    wants(folder, 1)
    cluster = Cluster(folder, serial())
    cluster.learner.turn()
    assert cluster.report.waiting == {"easy": 1}
    cluster.come("one")
    cluster.learner.turn()
    wants(folder, 0)  # before the supervisor ends it
    cluster.wire.on_alive(Alive("actor", "one", "one"), False)
    cluster.learner.turn()
    cluster.learner.turn()
    cluster.learner.close()
    assert len(cluster.rows()) == EPISODES
