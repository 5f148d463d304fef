"""Deep Q-learning and its variants: one learner, with switches in its settings.

| preset | `dqn.target_tau` | `dqn.double` | `network.kind` | paper |
|---|---|---|---|---|
| `dqn` | none | no | plain | Mnih et al., "Human-level control through deep RL", 2015 |
| `ddqn` | a share | no | plain | as above, soft target as in Lillicrap et al. 2016, arXiv:1509.02971 |
| `dddqn` | a share | no | dueling | Wang et al., "Dueling Network Architectures", arXiv:1511.06581 |

`replay.kind: prioritized` adds to each the replay of Schaul et al., "Prioritized Experience Replay", arXiv:1511.05952:
importance weights on the squared errors, and the errors' sizes as new priorities. `double` gives `ddqn` and `dddqn` the
classic rule of van Hasselt et al., "Deep RL with Double Q-learning", arXiv:1509.06461.

Where the study can be read in several ways, a switch has the other reading: `double: reversed` is its figure 2.11, in
which the target network picks the action and the online network scores it; with `target_every: episode` the target
network follows at the end of each episode, as line 17 of Algorithm 2 is indented; the two heads of `network.kind:
dueling-apart` are networks that share nothing, as in section 4.2 and equation 4.2.

Deviations, all of them the study's own text unless said otherwise:
- `dqn` has no target network: its target is the network itself, detached.
- The target of `ddqn` and `dddqn` is the maximum of the target network (the text's Algorithm 2), unless
  `double`.
- The target network takes a share of the online one after each update (the text's equation 4.1; figure 2.11), unless
  `target_every`, and is never copied.
- The loss is the plain mean squared error (weighted, if prioritised); neither the error nor the gradient is clipped.
- Ours: transitions span several steps, so `discount_t` is gamma to the power of the span
  (`replay/transitions.py`). `dqn.transitions: step` is the text's letter: one step, one gamma.
"""

from railctl.common.policy.first_weights import first_values
from railctl.common.rules.values import ValueSettings
from railctl.services.learner.fused.dqn import FusedApart, FusedDqn
from railctl.services.learner.learning import Learning
from railctl.services.learner.replay.replay import Replay, Sample
from railctl.services.learner.sparse import SparseRows
from railctl.services.learner.training import ValueMethod, ValueTrainer


def build(learning: Learning[ValueSettings]) -> ValueTrainer:
    """The trainer of `dqn`, `ddqn` and `dddqn`."""
    return ValueTrainer(learning, _method(learning), single_observations)


def _method(learning: Learning[ValueSettings]) -> ValueMethod:
    settings, sizes = learning.settings, (learning.n_features, learning.n_actions, learning.seed)
    if not settings.brings_module:
        learner = FusedApart if settings.network.kind == "dueling-apart" else FusedDqn
        return learner(settings.dqn, first_values(settings.network, *sizes))
    from railctl.services.learner.textbook.dqn import Dqn  # noqa: PLC0415  (torch takes seconds)

    return Dqn(settings.dqn, settings.module(*sizes))


def single_observations(_replay: Replay, sample: Sample) -> tuple[SparseRows, SparseRows]:
    """What the network sees of a sample: the observations [B, F] before and after each transition."""
    return sample.rows["observation_tm1"], sample.rows["observation_t"]
