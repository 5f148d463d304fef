"""Drawing levels in compiled code, exactly as flatland-rl does: random numbers, cities, rails, trains."""
