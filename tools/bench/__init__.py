"""Benchmarks: ours beside others, the same work in one process."""
