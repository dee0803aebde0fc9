// Elements of the page and of its drawings. Text only ever goes in as text.

const SVG = "http://www.w3.org/2000/svg";

/** Element with this id. */
export function byId(id) {
  return document.getElementById(id);
}

/** HTML element with attributes, listeners (`onclick`) and children (elements or text). */
export function element(name, attributes = {}, ...children) {
  return furnished(document.createElement(name), attributes, children);
}

/** SVG element, likewise. */
export function svgElement(name, attributes = {}, ...children) {
  return furnished(document.createElementNS(SVG, name), attributes, children);
}

/** Text of a drawing at a place. */
export function lettering(x, y, words, kind, fill = null) {
  return svgElement("text", { class: kind, x, y, fill }, words);
}

/** Select element of groups `[heading, [[value, text], …]]`; a label with a colon before it is hidden. */
export function choice(label, groups, chosen, onchange) {
  const options = groups.map(([heading, pairs]) => {
    const inside = pairs.map(([value, text]) => element("option", { value }, text));
    return heading ? element("optgroup", { label: heading }, ...inside) : inside;
  });
  const select = element("select", { onchange: () => onchange(select.value) }, ...options.flat());
  select.value = chosen;
  if (!label.startsWith(":")) return element("label", {}, `${label} `, select);
  select.setAttribute("aria-label", label.slice(1));
  return select;
}

/** Replace the children of an element; the control in the place of the focused one gets the focus. */
export function refill(parent, ...children) {
  const controls = () => [...parent.querySelectorAll("select, button, input")];
  const place = controls().indexOf(document.activeElement);
  parent.replaceChildren(...children.filter((child) => child !== null));
  if (place >= 0) controls()[place]?.focus();
}

/** Call `draw` whenever the width of an element changes, which its content must not set. */
export function onWidth(observed, draw) {
  let width = observed.clientWidth;
  new ResizeObserver(() => {
    if (observed.clientWidth === width) return;
    width = observed.clientWidth;
    requestAnimationFrame(draw);
  }).observe(observed);
}

function furnished(made, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) {
      made.setAttribute(name, value === true ? "" : value);
    }
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}
