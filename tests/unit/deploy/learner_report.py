"""What a learner says of itself in the middle of a run."""

from railctl.common.records.heartbeats import LearnerReport

LEARNER = LearnerReport(
    done=40,
    leased=1,
    waiting={},
    weights_version=41,
    snapshot=30,
    checkpoints=2,
    return_last_100=None,
    staleness_last_100=None,
    episodes_per_s=2.0,
    steps_per_s=100.0,
    refused=0,
    duplicates=3,
    reissued=4,
    exact_until=None,
)
