"""Episodes recorded elsewhere, replayed on the compiled world."""
