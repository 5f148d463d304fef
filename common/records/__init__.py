"""What travels between processes and into files: plain, frozen, strictly checked records, a module a conversation.

Shape letters, time first: T environment steps, D decisions, E earlier decisions, N trains, F features, S state, K rows.
"""
