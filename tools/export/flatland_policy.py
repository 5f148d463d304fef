"""The policy of the checkpoint beside this file, for the console commands of flatland-rl 4.3.0.

They are given `railctl_policy.Policy`, `railctl_policy.Observation` and `railctl_policy.Rewards` by name, with this
folder on PYTHONPATH. railctl must be installed: observations and network are its compiled code.
"""

import os
from pathlib import Path

os.environ["RAILCTL_CHECKPOINT"] = str(Path(__file__).with_name("checkpoint.safetensors").resolve())

from railctl.adapters.flatland_tools import CheckpointObservation as Observation  # which they read
from railctl.adapters.flatland_tools import CheckpointPolicy as Policy
from railctl.adapters.flatland_tools import StudyRewards as Rewards

__all__ = ["Observation", "Policy", "Rewards"]
