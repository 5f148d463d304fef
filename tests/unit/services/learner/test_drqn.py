"""What the recurrent network is trained on."""

import numpy as np
from made_episodes import decided

from railctl.common.rules.replay import UniformReplay
from railctl.services.learner.algorithms.drqn import sequences
from railctl.services.learner.replay.replay import Replay
from railctl.services.learner.replay.transitions import COLUMNS, ROWS, TransitionMaker
from railctl.services.learner.sparse import dense_rows


def test_sequences_are_what_a_train_saw_up_to_a_transition_and_from_one_decision_on():
    replay = Replay(UniformReplay(capacity=20), COLUMNS, ROWS, n_features=1)
    for number in range(2):  # what a train saw in the episode before does not belong to it
        seen = 10 * number
        decisions = [
            (0, 0, 2, seen + 1),
            (0, 1, 2, seen + 5),
            (1, 0, 2, seen + 2),
            (2, 1, 2, seen + 6),
            (3, 0, 2, seen + 3),
        ]
        episode = decided(number, decisions, np.full((5, 2), -1), [-1, 4], [seen + 4, 0])
        replay.append(TransitionMaker(0.9).take(episode).items)
    sample = replay.sample(200, 2)
    assert set(sample.places) == set(range(len(replay)))
    before, after = (dense_rows(x) for x in sequences(replay, sample, length=3))
    assert before.shape == after.shape == (3, 200, 1)
    found = {tuple(before[:, row, 0].tolist()): after[:, row, 0].tolist() for row in range(200)}
    assert found == {
        (0, 0, 1): [0, 1, 2],
        (0, 1, 2): [1, 2, 3],
        (1, 2, 3): [2, 3, 4],  # truncated: what it saw last
        (0, 0, 5): [0, 5, 6],
        (0, 5, 6): [5, 6, 0],  # arrived
        (0, 0, 11): [0, 11, 12],
        (0, 11, 12): [11, 12, 13],
        (11, 12, 13): [12, 13, 14],
        (0, 0, 15): [0, 15, 16],
        (0, 15, 16): [15, 16, 0],
    }
