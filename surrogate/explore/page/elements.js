// Making elements of the page.

/** `element("button", { class: "primary", onclick }, "Save", other)`: names with "on" are handlers, others attributes. */
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made[name] = value;
    else if (name === "style") made.style.cssText = value; // as an attribute the content security policy would refuse it
    else if (name.startsWith("aria-")) made.setAttribute(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.filter(child => child !== null && child !== undefined && child !== false));
  return made;
}

const SVG = "http://www.w3.org/2000/svg";

export function drawn(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children);
  return made;
}

export const section = (title, ...children) =>
  element("section", { "aria-label": title }, element("h2", {}, title), ...children);

export const field = (label, control) => element("label", { class: "field" }, element("span", {}, label), control);

/** A number for people: six digits at most. */
export const digits = value => String(+(+value).toPrecision(6)).replace("-", "−");
