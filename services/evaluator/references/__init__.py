"""Policies that learn nothing, to compare with what learns: `policies` has them by name."""
