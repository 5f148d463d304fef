// Rails as lines, from flatland's transition maps. Pure. Lengths are in cells; 0 north, 1 east, 2 south, 3 west.

const EDGES = [[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5]];

/** From which edges to which a cell can be passed, each pair once; a pair of equal edges is a dead end. */
export function ways(cell) {
  const found = new Set();
  for (let heading = 0; heading < 4; heading++) {
    const enters = (heading + 2) % 4;
    for (let leaves = 0; leaves < 4; leaves++) {
      if ((cell >> ((3 - heading) * 4 + (3 - leaves))) & 1) found.add([enters, leaves].sort().join());
    }
  }
  return [...found].map((pair) => pair.split(",").map(Number));
}

/** All rails of a grid as the data of one path. */
export function railPath(grid) {
  const parts = [];
  grid.forEach((row, r) => row.forEach((cell, c) => {
    if (!cell) return;
    for (const [from, to] of ways(cell)) {
      const [[x0, y0], [x1, y1]] = [EDGES[from], EDGES[to]];
      const start = `M${c + x0} ${r + y0}`;
      if (from === to) parts.push(`${start}L${c + 0.5} ${r + 0.5}`);
      else if ((from + 2) % 4 === to) parts.push(`${start}L${c + x1} ${r + y1}`);
      else parts.push(`${start}Q${c + 0.5} ${r + 0.5} ${c + x1} ${r + y1}`);
    }
  }));
  return parts.join("");
}

/** The part of a grid that has rails, with some room around: [left, top, width, height]. */
export function frameOf(grid, room = 0.7) {
  let [top, left, bottom, right] = [Infinity, Infinity, -Infinity, -Infinity];
  grid.forEach((row, r) => row.forEach((cell, c) => {
    if (!cell) return;
    [top, bottom] = [Math.min(top, r), Math.max(bottom, r)];
    [left, right] = [Math.min(left, c), Math.max(right, c)];
  }));
  if (top > bottom) return [0, 0, 1, 1];
  return [left - room, top - room, right - left + 1 + 2 * room, bottom - top + 1 + 2 * room];
}
