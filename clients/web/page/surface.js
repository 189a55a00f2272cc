// Frames of the surface stream to positions: what src/surface.rs of the contract's crate writes.

import { decompress } from './vendor/fzstd.min.js';
import { TOPOLOGY, decode } from './wire.js';

const VERTICES_PER_PART = 4096;

// Little-endian numbers of `parts` one after another.
function joined(parts, Numbers) {
    const bytes = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
    parts.reduce((at, part) => (bytes.set(part, at), at + part.length), 0);
    return new Numbers(bytes.buffer);
}

// The surface at rest. `triangles` (3 n): corners, counter-clockwise from outside; `rest` (3 n): positions [m]; `normals` (3 n) and
// `uvs` (2 n): as the contract has them, or empty; `materials`: one's triangles after another's, { name, triangles, colour, picture }.
export class Surface {
    // Of all parts of a topology, in any order.
    constructor(messages) {
        const parts = messages.map((bytes) => decode(bytes, TOPOLOGY)).sort((a, b) => a.part - b.part);
        const { topology, vertices, step, organs, materials } = parts[0];
        this.topology = topology;
        this.vertices = vertices;
        this.organs = organs;
        this.materials = materials;
        this.step = step;
        this.triangles = joined(parts.map((part) => part.triangles), Uint32Array);
        this.rest = joined(parts.map((part) => part.restPositions), Float32Array);
        this.normals = joined(parts.map((part) => part.normals), Float32Array);
        this.uvs = joined(parts.map((part) => part.uvs), Float32Array);
        const fits = (numbers, each) => numbers.length === 0 || numbers.length === each * vertices;
        const painted = materials.reduce((sum, { triangles }) => sum + triangles, 0);
        if (
            this.rest.length !== 3 * vertices || !fits(this.normals, 3) || !fits(this.uvs, 2) || !(step > 0) ||
            this.triangles.some((vertex) => vertex >= vertices) || (materials.length > 0 && 3 * painted !== this.triangles.length)
        ) {
            throw new RangeError('the surface does not fit together');
        }
        this.points = Int32Array.from(this.rest, (x) => Math.floor(x / step + 0.5));
        this.#predict();
    }

    // Earlier neighbours of vertex v: earlier[first[v]] to earlier[first[v + 1] − 1], ascending.
    #predict() {
        const { triangles, vertices } = this;
        const neighbours = Array.from({ length: vertices }, () => []);
        const pair = (a, b) => {
            const [later, earlier] = a > b ? [a, b] : [b, a];
            const part = (vertex) => Math.floor(vertex / VERTICES_PER_PART);
            if (later !== earlier && part(later) === part(earlier) && !neighbours[later].includes(earlier)) {
                neighbours[later].push(earlier);
            }
        };
        for (let t = 0; t < triangles.length; t += 3) {
            pair(triangles[t], triangles[t + 1]);
            pair(triangles[t + 1], triangles[t + 2]);
            pair(triangles[t + 2], triangles[t]);
        }
        this.first = new Uint32Array(vertices + 1);
        neighbours.forEach((all, v) => (this.first[v + 1] = this.first[v] + all.length));
        this.earlier = new Uint32Array(this.first[vertices]);
        neighbours.forEach((all, v) => this.earlier.set(all.sort((a, b) => a - b), this.first[v]));
    }

    get parts() {
        return Math.ceil(this.vertices / VERTICES_PER_PART);
    }
}

// Makes positions of the frames of one surface, which may come with gaps as long as a frame's key frame came before it.
export class Decoder {
    #difference;
    #planes = new Uint8Array(12 * VERTICES_PER_PART);

    constructor(surface) {
        this.surface = surface;
        this.key = new Array(surface.parts).fill(-1);
        this.came = new Array(surface.parts).fill(false);
        this.keyPoints = surface.points.slice();
        this.points = surface.points.slice();
        this.coded = new Array(surface.parts).fill(null); // levels of each part as they came
        this.sequence = -1;
        this.tools = [];
        this.obstacles = [];
        this.#difference = new Int32Array(3 * surface.vertices);
    }

    // Takes a part of a frame; `positions` (3 n) [m] are those of the frame that it makes whole. Gives tick, sequence, tools and
    // obstacles of that; null where there is none yet. Throws where it is no frame of this surface.
    take(frame, positions) {
        const { part, sequence, key } = frame;
        if (frame.topology !== this.surface.topology || part >= this.surface.parts) {
            throw new RangeError('a frame of another surface');
        }
        if (key !== sequence && this.key[part] !== key) return null;
        if (key === sequence) {
            this.#decode(part, this.surface.points, frame.displacements, this.keyPoints);
            this.key[part] = sequence;
        }
        if (this.sequence !== sequence) {
            this.came.fill(false);
            this.sequence = sequence;
        }
        if (key !== sequence) this.#decode(part, this.keyPoints, frame.displacements, this.points);
        else this.points.set(this.keyPoints.subarray(...this.#range(part)), this.#range(part)[0]);
        if (frame.levels.length > 0) this.coded[part] = frame.levels;
        this.came[part] = true;
        if (part === 0) [this.tools, this.obstacles] = [frame.tools, frame.obstacles];
        if (this.came.includes(false)) return null;
        const { points } = this, { step } = this.surface;
        for (let i = 0; i < points.length; i++) positions[i] = points[i] * step;
        return { tick: frame.tick, sequence, tools: this.tools, obstacles: this.obstacles };
    }

    // Of the coordinates of a part's vertices.
    #range(part) {
        const from = part * VERTICES_PER_PART, to = Math.min(from + VERTICES_PER_PART, this.surface.vertices);
        return [3 * from, 3 * to];
    }

    #unpack(bytes, size) {
        const planes = decompress(bytes, this.#planes.subarray(0, size));
        if (planes.length !== size) throw new RangeError(`${planes.length} bytes for a part of ${size}`);
        return planes;
    }

    #decode(part, reference, bytes, now) {
        const { first, earlier } = this.surface, difference = this.#difference;
        const [from, to] = this.#range(part).map((at) => at / 3), n = to - from;
        const planes = this.#unpack(bytes, 12 * n);
        for (let v = from; v < to; v++) {
            let x = 0, y = 0, z = 0;
            const begin = first[v], end = first[v + 1], count = end - begin;
            for (let e = begin; e < end; e++) {
                const at = 3 * earlier[e];
                x += difference[at];
                y += difference[at + 1];
                z += difference[at + 2];
            }
            if (count > 0) {
                x = Math.floor((2 * x + count) / (2 * count));
                y = Math.floor((2 * y + count) / (2 * count));
                z = Math.floor((2 * z + count) / (2 * count));
            }
            const i = v - from, at = 3 * v;
            difference[at] = x + zigzag(planes, i, n);
            difference[at + 1] = y + zigzag(planes, i + n, n);
            difference[at + 2] = z + zigzag(planes, i + 2 * n, n);
            // Whole numbers of 32 bits wrap.
            now[at] = reference[at] + difference[at];
            now[at + 1] = reference[at + 1] + difference[at + 1];
            now[at + 2] = reference[at + 2] + difference[at + 2];
        }
    }

    // (n) level of detail that displays each vertex in the newest frame; decoded only where somebody asks.
    get levels() {
        const { first, earlier, vertices } = this.surface, levels = new Uint8Array(vertices);
        this.coded.forEach((bytes, part) => {
            if (!bytes) return;
            const [from, to] = this.#range(part).map((at) => at / 3), residuals = this.#unpack(bytes, to - from);
            for (let v = from; v < to; v++) {
                const end = first[v + 1];
                levels[v] = residuals[v - from] + (end > first[v] ? levels[earlier[end - 1]] : 0);
            }
        });
        return levels;
    }
}

// The number whose lowest byte is at `at`; its others follow 3 n bytes after one another.
function zigzag(planes, at, n) {
    const word = planes[at] | (planes[at + 3 * n] << 8) | (planes[at + 6 * n] << 16) | (planes[at + 9 * n] << 24);
    return (word >>> 1) ^ -(word & 1);
}
