// A cube as the page uses it: values of its designs and of their states, by name.

import { extent } from "explorer/scale";

export const PERIODS = "periods";
const STATUS = { pending: 0, ok: 1, notConverged: 2, failed: 3 };
export { STATUS };

export class Cube {
  /** @param content a cube of the page's content */
  constructor(content) {
    Object.assign(this, content);
    this.byName = new Map(this.variables.map((variable) => [variable.name, variable]));
    this.measured = this.source !== "simulation";
    this.extents = new Map();
  }

  get count() {
    return this.designs.length;
  }

  has(name) {
    return this.byName.has(name);
  }

  variable(name) {
    return this.byName.get(name);
  }

  /** Value of a variable for a design, at a strain if it is along the strain; null if missing. */
  value(name, design, strain) {
    const variable = this.byName.get(name);
    if (!variable) return null;
    const { values, along_strain: along } = variable;
    return values[along ? design * this.strains.length + strain : design];
  }

  /** Values of a variable for a design at all strains. */
  curve(name, design) {
    return this.strains.map((_, strain) => this.value(name, design, strain));
  }

  /** Lower and upper edge of the band of a variable in a state, or null. */
  band(name, design, strain) {
    const { low, high, error } = this.byName.get(name)?.band ?? {};
    if (low && high) {
      const edges = [this.value(low, design, strain), this.value(high, design, strain)];
      return edges.includes(null) ? null : edges;
    }
    const value = this.value(name, design, strain);
    const spread = error ? this.value(error, design, strain) : null;
    return spread === null || value === null ? null : [value - 2 * spread, value + 2 * spread];
  }

  /** Range of all values of a variable. */
  extentOf(name) {
    if (!this.extents.has(name)) this.extents.set(name, extent(this.byName.get(name).values));
    return this.extents.get(name);
  }

  /** Whether the fabric passes through itself in a state. */
  foldedThrough(design, strain) {
    return (this.value("self_intersections", design, strain) ?? 0) > 0;
  }

  /** Whether the fabric snapped on the way to a state. */
  snapped(design, strain) {
    return (this.value("snapped", design, strain) ?? 0) > 0;
  }

  /** Value of a design along a dimension, or its periods. */
  coordinate(axis, design) {
    if (axis === PERIODS) return this.value(PERIODS, design, 0);
    const dim = this.dims.findIndex(({ name }) => name === axis);
    return this.dims[dim].values[this.designs[design].at[dim]];
  }

  /** What a map can have as its axes: `{name, long_name, units}`. */
  get axes() {
    const periods = this.byName.get(PERIODS);
    return periods ? [...this.dims, periods] : this.dims;
  }

  /** The variables that a map or an axis can show, as groups of choices. */
  get variableGroups() {
    const pairs = (along) =>
      this.variables
        .filter((variable) => variable.along_strain === along)
        .map(({ name, long_name: long }) => [name, long]);
    return [
      ["at the applied strain", pairs(true)],
      ["of the design", pairs(false)],
    ];
  }

  /** The labels of a design as one text, by which links name it. */
  key(design) {
    return this.dims.map(({ name }) => this.coordinate(name, design)).join("~");
  }

  /** The design of a key, or null. */
  find(key) {
    const found = this.designs.findIndex((_, design) => this.key(design) === key);
    return found < 0 ? null : found;
  }

  /** A short name of a design: the dimensions that have a single value are left out. */
  label(design) {
    const varied = this.dims.filter(({ values }) => values.length > 1);
    const named = (varied.length ? varied : this.dims).map(
      ({ name }) => `${name} ${this.coordinate(name, design)}`,
    );
    return named.join(", ");
  }

  /** Its state of affairs in words. */
  statusOf(design, statuses) {
    return statuses[this.designs[design].status];
  }

  /** Design and strain of the lowest value of a variable, if there is one that cloth can take. */
  lowest(name) {
    const states = this.designs.flatMap((_, design) => this.strains.map((__, k) => [design, k]));
    const present = states.filter(([design, k]) => this.value(name, design, k) !== null);
    const sound = present.filter(([design, k]) => !this.foldedThrough(design, k));
    const lower = (one, other) =>
      this.value(name, ...other) < this.value(name, ...one) ? other : one;
    return (sound.length ? sound : present).reduce(lower, present[0] ?? [0, 0]);
  }
}
