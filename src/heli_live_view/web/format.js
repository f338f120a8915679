// SPDX-License-Identifier: Apache-2.0
// Numbers as people read them: fixed decimals, a true minus sign, a dash for what is not known.

export const UNKNOWN = "–";

export function fixed(value, decimals, unit = "") {
  if (value === null || value === undefined || !Number.isFinite(value)) return UNKNOWN;
  const text = value.toFixed(decimals).replace("-", "−");
  const zero = /^−0\.?0*$/.test(text) ? text.slice(1) : text;
  return unit ? `${zero} ${unit}` : zero;
}

// Signed, so that a column of numbers does not jump when a sign changes.
export function signed(value, decimals, unit = "") {
  const text = fixed(value, decimals, unit);
  return text === UNKNOWN || text.startsWith("−") ? text : `+${text}`;
}

export function clock(seconds) {
  if (!Number.isFinite(seconds)) return UNKNOWN;
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(1).padStart(4, "0")}`;
}

// Compass direction 0..360 of an east and north component.
export function bearing(east, north) {
  return ((Math.atan2(east, north) * 180) / Math.PI + 360) % 360;
}

// Angle in degrees, -180..180.
export function wrapped(degrees) {
  return ((((degrees + 180) % 360) + 360) % 360) - 180;
}

// "v_x" with its index set low.
export function named(name) {
  const made = document.createElement("span");
  const [, base, index, rest] = name.match(/^([^_]*)_?(\S*)(.*)$/);
  made.append(base);
  if (index) {
    const low = document.createElement("sub");
    low.textContent = index;
    made.append(low, rest);
  }
  return made;
}

// Writes only what changed: layout is not disturbed ten times a second for nothing.
export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
