"""Deep recurrent Q-learning: as `dqn.py`, over sequences of a train's decisions.

| preset | `dqn.target_tau` | `dqn.double` | `network.kind` | paper |
|---|---|---|---|---|
| `drqn` | a share | no | recurrent | Hausknecht & Stone, "Deep Recurrent Q-Learning", 2015, arXiv:1507.06527 |

The network is `dddqn`'s with an LSTM in place of the first layer (section 4.2 of the study). While acting, a train
carries the LSTM's state from decision to decision. In training the state is zero at the start of a sequence, which is
the last `dqn.sequence_decisions` decisions of a train up to the transition's own; those for the next observation are
one decision later. Where a train's episode is younger, the state stays zero up to its first decision, as it acted.

Deviations: Hausknecht & Stone learn from every step of a sequence. Here, as in all of the study's value methods, each
transition drawn gives one error, the last of its sequence: only that one has a past, and the replay stays one of
transitions, prioritised or not. The length is ours, the text gives none.
"""

from functools import partial

import numpy as np

from railctl.common.policy.first_weights import first_recurrent
from railctl.common.rules.drqn import Settings
from railctl.services.learner.fused.drqn import FusedDrqn
from railctl.services.learner.learning import Learning
from railctl.services.learner.replay.replay import Replay, Sample
from railctl.services.learner.sparse import SparseRows
from railctl.services.learner.training import ValueTrainer


def build(learning: Learning[Settings]) -> ValueTrainer:
    """The trainer of `drqn`."""
    settings = learning.settings
    network = first_recurrent(settings.network, learning.n_features, learning.n_actions, learning.seed)
    look = partial(sequences, length=settings.dqn.sequence_decisions)
    return ValueTrainer(learning, FusedDrqn(settings.dqn, network), look)


def sequences(replay: Replay, sample: Sample, length: int) -> tuple[SparseRows, SparseRows]:
    """What the network sees of a sample: sequences [L, B, F] that end before and after each transition."""
    tm1 = replay.histories(sample.places, length)
    return tm1, moved_on(tm1, sample.rows["observation_t"])


def moved_on(x: SparseRows, following: SparseRows) -> SparseRows:
    """Sequences x [L, B, F] without their first rows, the `following` ones [B, F] behind their last."""
    batch = following.n_rows
    first, last, count = x.starts[batch], x.starts[-1], following.starts[-1]
    starts = np.concatenate((x.starts[batch:] - first, following.starts[1:] + (last - first)))
    columns = np.concatenate((x.columns[first:last], following.columns[:count]))
    values = np.concatenate((x.values[first:last], following.values[:count]))
    return SparseRows(x.shape, starts, columns, values)
