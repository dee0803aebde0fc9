// Numbers as text, with their units.

const MINUS = "−";

/** A number with three significant digits, or a dash if there is none. */
export function number(value, digits = 3) {
  if (value === null || value === undefined) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text =
    size >= 1e5 || size < 1e-4
      ? value.toExponential(Math.max(digits - 2, 0))
      : String(Number(value.toPrecision(Math.max(digits, Math.ceil(Math.log10(size))))));
  return text.replace("-", MINUS);
}

/** A number with a fixed number of decimals that suits its size, for columns and cells. */
export function fixed(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (Number.isInteger(value) && size < 1e5) return String(value).replace("-", MINUS);
  if (size >= 1e5 || (size < 5e-4 && size > 0)) return number(value, 3);
  const decimals = size >= 100 ? 0 : size >= 10 ? 1 : size >= 0.1 ? 2 : 3;
  return value.toFixed(decimals).replace("-", MINUS);
}

/** A strain in percent. */
export function percent(strain) {
  return `${number(100 * strain)} %`;
}

/** A unit to write behind a number; nothing for a number without a unit. */
export function unit(units) {
  return units === "1" ? "" : ` ${units.replace(" ", "·")}`;
}

/** A name with its unit in brackets, for axes and headings. */
export function withUnit(variable) {
  return variable.units === "1"
    ? variable.long_name
    : `${variable.long_name} [${variable.units.replace(" ", "·")}]`;
}
