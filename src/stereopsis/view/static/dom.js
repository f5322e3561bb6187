/** Shorthands for making elements. */

export const $ = (id) => document.getElementById(id);

/** An element with properties, attributes (those with a hyphen, and role) and children. */
export function el(tag, given = {}, ...children) {
  const element = document.createElement(tag);
  assign(element, given);
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

const SVG = "http://www.w3.org/2000/svg";
export function svg(tag, given = {}, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(given)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

function assign(element, given) {
  for (const [name, value] of Object.entries(given)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name.includes("-") || name === "role" || name === "for") element.setAttribute(name, String(value));
    else element[name] = value;
  }
}

/** A number as people read it. */
export function number(value, decimals = 2) {
  return Number.isFinite(value) ? value.toFixed(decimals).replace("-", "−") : "–";
}
