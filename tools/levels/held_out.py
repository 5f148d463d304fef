"""`python -m railctl.tools.levels.held_out`: draws the rails that are kept from all training anew, and writes their file."""

import numpy as np

from railctl.common.levels.distributions import shipped
from railctl.common.levels.generate import generate
from railctl.common.levels.held_out import FILE, HELD_OUT_LEVELS, draw_hashes


def main() -> None:
    """Write the file."""
    hashes = {found for levels in shipped().values() for found in draw_hashes(levels, generate, range(HELD_OUT_LEVELS))}
    np.array(sorted(hashes), "<u8").tofile(FILE)
    print(f"{FILE.name}: {len(hashes)} maps")  # noqa: T201  (a tool of the maintainers)


if __name__ == "__main__":
    main()
