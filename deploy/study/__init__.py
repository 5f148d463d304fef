"""Carrying out a study: many runs, packed onto the cores of one machine, and what is made of them."""
