"""How many numbers the parts of a traffic observation have; see `common.rail.observations.traffic`."""

from typing import Final

N_TRAIN: Final = 13
N_EXIT: Final = 16
N_OTHER: Final = 10
N_MEETING: Final = 15  # of another train behind an exit
N_EXITS: Final = 3  # left, forward, right
N_ROW: Final = N_OTHER + N_EXITS * N_MEETING  # of another train
EXITS_END: Final = N_TRAIN + N_EXITS * N_EXIT  # where the rows begin
