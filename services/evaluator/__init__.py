"""Scores every checkpoint on fixed levels that training never sees."""
