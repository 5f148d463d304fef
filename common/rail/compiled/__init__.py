"""The compiled world: flatland-rl 4.3.0 and the rules of 2.2.2 over flat arrays, bit for bit, in numba."""
