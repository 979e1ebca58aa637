// Making elements of the page.

/** `element("button", { class: "primary", onclick }, "Save", other)`: names with "on" are handlers, others attributes. */
export const element = (tag, attributes, ...children) => filled(document.createElement(tag), attributes, children);

/** The same of SVG. */
export const drawn = (tag, attributes, ...children) => filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, children);

function filled(made, attributes = {}, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made[name] = value;
    else if (name === "style") made.style.cssText = value; // as an attribute the content security policy would refuse it
    else if (name.startsWith("aria-")) made.setAttribute(name, value);
    else if (value === true) made.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(name, value);
  }
  made.append(...children.filter(Boolean));
  return made;
}

export const section = (title, ...children) =>
  element("section", { "aria-label": title }, element("h2", {}, title), ...children);

export const button = (label, onclick, attributes = {}) => element("button", { type: "button", onclick, ...attributes }, label);

/** A menu of [value, name, disabled] in a labelled field; `changed` hears the value that is chosen. */
export const menu = (label, id, chosen, offered, changed) => field(label, element("select", { id, onchange: event => changed?.(event.target.value) },
  ...offered.map(([value, name, disabled]) => element("option", { value, disabled, selected: value === chosen }, name))));

/** Tabs of [id, name]; `choose(id)` hears which; arrow keys, Home and End go from tab to tab. */
export const tabs = (label, prefix, panel, chosen, offered, choose) => element("div", { role: "tablist", "aria-label": label }, ...offered.map(([id, name]) =>
  element("button", {
    role: "tab", id: `${prefix}-${id}`, "aria-controls": panel, "aria-selected": id === chosen, tabindex: id === chosen ? 0 : -1,
    onclick: () => choose(id), onkeydown: stepTab,
  }, name)));

function stepTab(event) {
  const all = [...event.currentTarget.parentElement.children], here = all.indexOf(event.currentTarget);
  const to = { ArrowRight: here + 1, ArrowLeft: here - 1, Home: 0, End: -1 }[event.key];
  if (to === undefined) return;
  event.preventDefault();
  const next = all.at(to % all.length);
  next.click();
  document.getElementById(next.id)?.focus();
}

/** Show which of the tabs in a list is chosen. */
export function markTab(list, id) {
  for (const tab of list.children) {
    tab.setAttribute("aria-selected", tab.id === id);
    tab.tabIndex = tab.id === id ? 0 : -1;
  }
}

export const field = (label, control) => element("label", { class: "field" }, element("span", {}, label), control);

/** A number for people: six digits, or as many as tell a hundred-thousandth of the width that it lies in. */
export const digits = (value, width = Infinity, least = 6) => String(+(+value).toPrecision(precision(value, width, least))).replace("-", "−");
/** The same of a parameter's value, by the width of its bounds. */
export const digitsOf = (parameter, value, least) => digits(value, parameter.high - parameter.low, least);
const precision = (value, width, least) => Math.max(least, Math.min(15, least - 1 + Math.ceil(Math.log10(Math.abs(value) / width)) || 0));
