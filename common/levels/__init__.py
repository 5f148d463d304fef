"""Levels: what a railway world starts from."""
