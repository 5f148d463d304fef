"""Logs say the first of what others may do without end, and then only how much it has become."""

FIRST, EVERY = 20, 1000


def is_told(count: int) -> bool:
    """Whether the log says the `count`th of its kind.

    >>> [count for count in range(1, 2001) if is_told(count)][-4:]
    [19, 20, 1000, 2000]
    """
    return count <= FIRST or count % EVERY == 0
