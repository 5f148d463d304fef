// A level that is higher than wide, laid on its side for a wide screen: north is then to the left. Pure.

/** A cell's transitions as they are once north points to the west. */
export function turnedCell(cell) {
  let found = 0;
  for (let heading = 0; heading < 4; heading++) {
    for (let leaves = 0; leaves < 4; leaves++) {
      if ((cell >> ((3 - heading) * 4 + (3 - leaves))) & 1) found |= 1 << ((3 - turnedHeading(heading)) * 4 + (3 - turnedHeading(leaves)));
    }
  }
  return found;
}

export const turnedHeading = (heading) => (heading + 3) % 4;

/** A grid [H][W] as [W][H]. */
export function turnedGrid(grid) {
  const width = grid[0].length;
  return Array.from({ length: width }, (_, row) => grid.map((line) => turnedCell(line[width - 1 - row])));
}

/** Where (row, column) of a level of some width comes to lie. */
export const turnedPlace = (row, column, width) => [width - 1 - column, row];
