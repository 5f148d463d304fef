"""Ours in other people's tools: each module serves one of them. Nothing of railctl imports this package."""
