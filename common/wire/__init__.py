"""The wire: `keys` builds and parses every key, `codec` encodes and strictly decodes every message."""
