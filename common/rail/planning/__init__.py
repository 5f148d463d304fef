"""Planning trains one after the other, from the state that a world is in."""
