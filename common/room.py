"""What the disk says to a write for which it has no room."""

import errno

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # a restart would meet it again
