// From numbers to places, and numbers that are good to write beside them. Pure.

export function ticks(low, high, most) {
  const span = high - low || 1;
  const raw = span / Math.max(1, most);
  const size = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 2.5, 5, 10].map((factor) => factor * size).find((candidate) => candidate >= raw - 1e-12);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + step * 1e-9; at++) found.push(Number((at * step).toPrecision(12)));
  return found;
}

export function extent(values, fallback = [0, 1]) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  if (low > high) return fallback;
  const room = (high - low || Math.abs(high) || 1) * 0.06;
  return [low - room, high + room];
}

export const linear = (from, to) => (value) => to[0] + ((value - from[0]) / (from[1] - from[0] || 1)) * (to[1] - to[0]);

/** Places of labels that keep a distance, near where they want to be. */
export function apart(wanted, distance, low, high) {
  const order = wanted.map((place, at) => ({ place, at })).sort((a, b) => a.place - b.place);
  for (let turn = 1; turn < order.length; turn++) order[turn].place = Math.max(order[turn].place, order[turn - 1].place + distance);
  let limit = high;
  for (const entry of [...order].reverse()) {
    entry.place = Math.max(low, Math.min(entry.place, limit));
    limit = entry.place - distance;
  }
  const found = [];
  for (const entry of order) found[entry.at] = entry.place;
  return found;
}
