"""Level files of flatland-rl, of all versions since 2.0, read without flatland and without trust."""
