"""A run's rows in the trackers of others: `points` says what goes there, `mlflow_sink` brings it there, once."""
