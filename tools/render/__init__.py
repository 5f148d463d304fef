"""Episodes as pictures and films, out of what `services.evaluator.playback` writes; `task` is the process."""
