"""Railway worlds: stepping, decisions, observations. No torch, no Zenoh."""
