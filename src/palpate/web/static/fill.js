// The displacement of all vertices of a body that sends a sample of them, as physics/geometry/graded.py: linear moving least squares
// over the nearest sent vertices. The shares of these are kept; where other vertices are sent, as under a finger that slides, only
// those of vertices with other nearest ones are computed again.

const NEIGHBOURS = 12, STIFF = 1e-4; // as there

export class Filled {
  // vertices: places at rest, three numbers each; landmarks: vertices that a sample of the whole surface includes.
  constructor(vertices, landmarks) {
    this.vertices = vertices; this.landmarks = landmarks; this.count = vertices.length / 3;
    this.sent = new Int32Array(0); this.has = new Uint8Array(this.count); this.whole = false;
    this.row = new Int32Array(this.count); // of each sent vertex
    this.near = new Int32Array(NEIGHBOURS * this.count); this.shares = new Float64Array(NEIGHBOURS * this.count);
    this.far = new Float64Array(this.count); // squared distance of the farthest of the nearest
  }

  // Three numbers for each vertex, or null if the sent vertices are not a sample of the whole surface.
  fill(nodes, displacement) {
    if (!same(nodes, this.sent)) this.prepare(nodes.slice());
    if (!this.whole) return null;
    const all = new Float32Array(3 * this.count);
    for (const v of this.between) {
      let x = 0, y = 0, z = 0;
      for (let k = NEIGHBOURS * v; k < NEIGHBOURS * (v + 1); k++) {
        const share = this.shares[k], n = 3 * this.row[this.near[k]];
        x += share * displacement[n]; y += share * displacement[n + 1]; z += share * displacement[n + 2];
      }
      all[3 * v] = x; all[3 * v + 1] = y; all[3 * v + 2] = z;
    }
    for (let k = 0; k < nodes.length; k++) for (let c = 0; c < 3; c++) all[3 * nodes[k] + c] = displacement[3 * k + c];
    return all;
  }

  prepare(nodes) {
    const earlier = this.has, kept = this.whole, has = new Uint8Array(this.count);
    for (const node of nodes) has[node] = 1;
    this.sent = nodes; this.has = has;
    this.whole = nodes.length < this.count && this.landmarks.every((v) => has[v]) && nodes.length >= NEIGHBOURS;
    if (!this.whole) return;
    nodes.forEach((node, k) => { this.row[node] = k; });
    this.between = Int32Array.from({ length: this.count }, (_, v) => v).filter((v) => !has[v]);
    const places = this.places(nodes), added = this.places(nodes.filter((node) => !earlier[node])), away = new Float64Array(NEIGHBOURS);
    for (const v of this.between) if (!kept || earlier[v] || this.changes(v, added)) { this.nearest(v, places, away); this.weigh(v, away); }
  }

  // Coordinates of vertices, three numbers each.
  places(nodes) {
    const found = new Float64Array(3 * nodes.length);
    nodes.forEach((node, k) => { for (let c = 0; c < 3; c++) found[3 * k + c] = this.vertices[3 * node + c]; });
    return found;
  }

  // Whether the nearest of a vertex are others than before: one is not sent any more, or an added one is nearer.
  changes(v, added) {
    for (let k = NEIGHBOURS * v; k < NEIGHBOURS * (v + 1); k++) if (!this.has[this.near[k]]) return true;
    const x = this.vertices[3 * v], y = this.vertices[3 * v + 1], z = this.vertices[3 * v + 2], far = this.far[v];
    for (let at = 0; at < added.length; at += 3) {
      const dx = added[at] - x, dy = added[at + 1] - y, dz = added[at + 2] - z;
      if (dx * dx + dy * dy + dz * dz < far) return true;
    }
    return false;
  }

  // The sent vertices that are nearest to a vertex, and their squared distances, in ascending order.
  nearest(v, places, away) {
    const x = this.vertices[3 * v], y = this.vertices[3 * v + 1], z = this.vertices[3 * v + 2], last = NEIGHBOURS - 1, first = NEIGHBOURS * v, { near, sent } = this;
    away.fill(Infinity);
    for (let k = 0, at = 0; at < places.length; k++, at += 3) {
      const dx = places[at] - x, dy = places[at + 1] - y, dz = places[at + 2] - z, square = dx * dx + dy * dy + dz * dz;
      if (square >= away[last]) continue;
      let to = last;
      for (; to > 0 && away[to - 1] > square; to--) { away[to] = away[to - 1]; near[first + to] = near[first + to - 1]; }
      away[to] = square; near[first + to] = sent[k];
    }
    this.far[v] = away[last];
  }

  // The share of each of the nearest in the displacement of a vertex.
  weigh(v, away) {
    const far = Math.max(Math.sqrt(away[NEIGHBOURS - 1]), 1e-12), normal = Array.from({ length: 4 }, () => [0, 0, 0, 0, 0]), rows = [];
    let total = 0;
    for (let k = 0; k < NEIGHBOURS; k++) {
      const q = Math.min(Math.sqrt(away[k]) / far, 1) ** 2, weight = (1 - q) ** 2 / (q + 1e-2), n = 3 * this.near[NEIGHBOURS * v + k];
      const terms = [1, ...[0, 1, 2].map((c) => (this.vertices[n + c] - this.vertices[3 * v + c]) / far)];
      rows.push([weight, terms]);
      total += weight;
      for (let i = 0; i < 4; i++) for (let j = 0; j < 4; j++) normal[i][j] += weight * terms[i] * terms[j];
    }
    for (let i = 1; i < 4; i++) normal[i][i] += STIFF * total;
    normal[0][4] = 1;
    const x = solved(normal);
    rows.forEach(([weight, terms], k) => { this.shares[NEIGHBOURS * v + k] = weight * terms.reduce((sum, t, i) => sum + t * x[i], 0); });
  }
}

// The solution of four linear equations, a row each with its right side; the matrix is positive definite.
function solved(rows) {
  for (let i = 0; i < 4; i++) for (let j = i + 1; j < 4; j++) {
    const factor = rows[j][i] / rows[i][i];
    for (let k = i; k < 5; k++) rows[j][k] -= factor * rows[i][k];
  }
  const x = [0, 0, 0, 0];
  for (let i = 3; i >= 0; i--) { x[i] = rows[i][4]; for (let k = i + 1; k < 4; k++) x[i] -= rows[i][k] * x[k]; x[i] /= rows[i][i]; }
  return x;
}

function same(one, other) {
  if (one.length !== other.length) return false;
  for (let k = 0; k < one.length; k++) if (one[k] !== other[k]) return false;
  return true;
}
