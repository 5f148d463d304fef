// Numbers as people read them.

const minus = (text) => text.replace("-", "\u2212");

export const fixed = (value, digits = 3) => (value === null || value === undefined ? "–" : minus(value.toFixed(digits)));
export const whole = (value) => minus(Math.round(value).toLocaleString("en-US").replaceAll(",", "\u202f"));
export const percent = (share) => `${Math.round(share * 100)}%`;
export const short = (value) => {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 0.001 || size >= 1e9) return minus(value.toExponential(1));
  const [unit, sign] = size >= 1e6 ? [1e6, " M"] : size >= 1e4 ? [1e3, " k"] : [1, ""];
  return minus(`${Number((value / unit).toPrecision(3))}${sign}`);
};

export function duration(seconds) {
  const total = Math.floor(seconds);
  const two = (number) => String(number).padStart(2, "0");
  const [hours, minutes] = [Math.floor(total / 3600), Math.floor(total / 60) % 60];
  return hours ? `${hours}:${two(minutes)}:${two(total % 60)}` : `${minutes}:${two(total % 60)}`;
}

export function ago(seconds) {
  if (seconds < 2) return "now";
  if (seconds < 120) return `${Math.round(seconds)} s ago`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min ago`;
  if (seconds < 172800) return `${Math.round(seconds / 3600)} h ago`;
  return `${Math.round(seconds / 86400)} days ago`;
}

export const clock = (unix) => new Date(unix * 1000).toLocaleTimeString([], { hour12: false });
export const counted = (number, noun) => `${whole(number)} ${noun}${number === 1 ? "" : "s"}`;
