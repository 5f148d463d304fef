"""railctl: exact distributed reinforcement learning of train dispatching in Flatland, over Eclipse Zenoh.

All packages lie in this one, by links, so that an installation brings one name and neither shadows nor is shadowed by a
user's own `common` or `services`.
"""
