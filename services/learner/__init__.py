"""Owns the ledger, the replay and the network: leases episodes, trains on them in order, hands out weights."""
