"""The layer between dispatchers and points: which actions of a train are granted; see `asking`."""
