// Numbers, names and colours, and the few lines of DOM that everything else uses.
"use strict";
const ilns = { views: {} };

ilns.MODES = ["INITIALISING", "OK", "DEGRADED", "DEAD_RECKONING", "INVALID"];
ilns.AIDING = ["lbl", "gnss", "dvl", "mcp", "ps"];

// Okabe and Ito.
ilns.MODE_COLOURS = ["#999999", "#009e73", "#e69f00", "#d55e00", "#cc79a7"];
ilns.SENSOR_COLOURS = { imu: "#999999", lbl: "#0072b2", gnss: "#cc79a7", dvl: "#009e73", mcp: "#e69f00", ps: "#56b4e9", buoys: "#999999" };

/** What stands where nothing is known. */
ilns.UNKNOWN = "–";

/** With so many decimals. */
ilns.fixed = (value, decimals) => {
  if (typeof value !== "number" || !Number.isFinite(value)) return ilns.UNKNOWN;
  if (Math.abs(value) >= 1e9) return value.toExponential(1);
  const text = value.toFixed(decimals);
  return Number(text) === 0 ? text.replace("-", "") : text;
};

/** A time in the unit that suits it. */
ilns.duration = (seconds) => {
  if (typeof seconds !== "number" || !Number.isFinite(seconds)) return ilns.UNKNOWN;
  if (seconds < 1e-3) return `${(seconds * 1e6).toFixed(0)} µs`;
  if (seconds < 1) return `${(seconds * 1e3).toFixed(seconds < 0.01 ? 2 : 1)} ms`;
  return `${seconds.toFixed(2)} s`;
};

/**
 * Quantile of the chi-square distribution by Wilson and Hilferty, within 1 % from two degrees of freedom on; `z` is that of
 * the normal distribution. For one degree of freedom exact values at the two that are used.
 */
ilns.chiSquare = (dof, z) => {
  if (dof === 1) return z < 0 ? 0.000982 : 5.024;
  const a = 2 / (9 * dof);
  return dof * Math.max(0, 1 - a + z * Math.sqrt(a)) ** 3;
};

/** 2.5 % and 97.5 % of the normal distribution. */
ilns.Z95 = 1.95996;

/** 95 % of the chi-square distribution of two degrees of freedom: the square of the ellipse's axes in sigmas. */
ilns.ELLIPSE95 = 5.991;

/** A colour of the style sheet. */
ilns.colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** An element: `h("td", {class: "x", "data-y": 1}, "text", child)`. */
ilns.h = (tag, attributes, ...children) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
};

ilns.byId = (id) => document.getElementById(id);

/** The cards that are in sight, or nearly so; the others are drawn when they come. Where it cannot be known, all are. */
ilns.inSight = new Set();
ilns.isInSight = (id) => ilns.inSight.has(id) || !("IntersectionObserver" in window);

/** Sets a text only where it differs, so that a screen reader and a selection are left in peace. */
ilns.say = (element, text) => {
  if (element.textContent !== text) element.textContent = text;
};

/** A coloured square with its name. */
ilns.key = (colour, name) => {
  const swatch = ilns.h("span", { class: "swatch" });
  swatch.style.background = colour;
  return ilns.h("span", { class: "key" }, swatch, name);
};

/** First index of a rising array whose value is greater than `x`. */
ilns.after = (array, x) => {
  let low = 0;
  let high = array.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (array[middle] <= x) low = middle + 1;
    else high = middle;
  }
  return low;
};
