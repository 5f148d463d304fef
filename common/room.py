"""What the disk says to a write for which it has no room."""

import errno

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # a restart would meet it again


def without_room(error: OSError) -> str:
    """What a command says of it; where from would mislead, for a copy names its source."""
    return f"{error.strerror}: make room on the disk, then run it again"
