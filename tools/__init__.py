"""What serves the command line and the maintainers alone: work on levels, recordings replayed, benchmarks."""
