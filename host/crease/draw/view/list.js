"use strict";
const POINTS_MAX = 6;

const IN_MM = { head: "depth", perM: 1e3, digits: 2 }, IN_UM = { head: "um in", perM: 1e6, digits: 1 };

// A table of contact points: count of them, each { at, depth, force } by its number. The deepest come first. Those that hold a tool yield by micrometres.
function listPoints(table, count, get, depths = IN_MM) {
  const rows = Array.from({ length: Math.max(0, count) }, (_, k) => get(k)).sort((a, b) => b.depth - a.depth);
  const cells = rows.slice(0, POINTS_MAX).map(({ at, depth, force }) =>
    [...at.toArray().map((v) => (1000 * v).toFixed(1)), (depths.perM * depth).toFixed(depths.digits), force.toFixed(2)]);
  const key = JSON.stringify([cells, rows.length]);
  if (table.told === key) return;
  table.told = key;
  table.replaceChildren();
  if (!cells.length) return;
  for (const texts of [["x, mm", "y", "z", depths.head, "N"], ...cells]) {
    const row = table.insertRow();
    for (const text of texts) row.insertCell().textContent = text;
  }
  if (rows.length > POINTS_MAX) table.insertRow().insertCell().textContent = `and ${rows.length - POINTS_MAX} more`;
}
