// How a surface has moved and stretched against its rest shape, and the colours that show it.

// The same colours as in the viewer (clients/viewer/src/colour.rs), sRGB.
const TISSUES = [
    [176, 84, 76], [138, 92, 128], [214, 160, 104], [132, 144, 92], [226, 190, 178], [112, 76, 60], [104, 124, 150], [206, 120, 130],
];
export const LEVELS = [[70, 110, 210], [70, 170, 90], [240, 208, 60], [235, 130, 50], [205, 60, 70], [150, 70, 160]];
// From nothing to the end of a scale.
const SCALE = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
// Strain at the end of its scale.
export const LARGEST_STRAIN = 0.2;

// The scale's colour at `t`, 0 to 1, sRGB.
export function scale(t) {
    const at = Math.min(Math.max(t, 0), 1) * (SCALE.length - 1), i = Math.min(Math.floor(at), SCALE.length - 2);
    return SCALE[i].map((c, k) => c + (at - i) * (SCALE[i + 1][k] - c));
}

// (256 × 3) the scale in bytes.
const RAMP = Uint8Array.from(Array.from({ length: 256 }, (_, i) => scale(i / 255)).flat());

const lattice = (x, y, z) => {
    const h = Math.sin(127.1 * x + 311.7 * y + 74.7 * z) * 43758.5453;
    return h - Math.floor(h);
};

// Smooth noise from −1 to 1.
function noise(x, y, z) {
    const [i, j, k] = [x, y, z].map(Math.floor);
    const smooth = (t) => t * t * (3 - 2 * t);
    const [u, v, w] = [smooth(x - i), smooth(y - j), smooth(z - k)];
    let sum = 0;
    for (let c = 0; c < 8; c++) {
        const [a, b, d] = [c & 1, (c >> 1) & 1, c >> 2];
        sum += (a ? u : 1 - u) * (b ? v : 1 - v) * (d ? w : 1 - w) * lattice(i + a, j + b, k + d);
    }
    return 2 * sum - 1;
}

export class Deformation {
    #inverse; // (3 t) of the matrix of a triangle's two edges in its own plane [1/m]: xx, xy, yy
    #area; // (t) [m²]
    #around; // (n) sum of the rest areas around a vertex [m²]
    #tissue; // (4 n) sRGB and 0
    #same; // (n) the first vertex at the same place with the same normal: the surface is smooth across seams of its uvs
    #restNormals; // (3 n) of the triangles at rest, where the surface has normals of its own; null: it has none

    constructor(surface) {
        const { triangles, rest, vertices, organs, normals, uvs } = surface;
        this.surface = surface;
        const count = triangles.length / 3;
        this.#inverse = new Float32Array(3 * count);
        this.#area = new Float32Array(count);
        this.#around = new Float32Array(vertices);
        const bounds = [Infinity, Infinity, Infinity, -Infinity, -Infinity, -Infinity];
        for (let v = 0; v < rest.length; v++) {
            bounds[v % 3] = Math.min(bounds[v % 3], rest[v]);
            bounds[3 + (v % 3)] = Math.max(bounds[3 + (v % 3)], rest[v]);
        }
        this.bounds = bounds;
        this.size = Math.hypot(bounds[3] - bounds[0], bounds[4] - bounds[1], bounds[5] - bounds[2]);
        let edges = 0;
        for (let t = 0; t < count; t++) {
            const [a, b, c] = [0, 1, 2].map((i) => 3 * triangles[3 * t + i]);
            const e = [0, 1, 2].map((i) => rest[b + i] - rest[a + i]), f = [0, 1, 2].map((i) => rest[c + i] - rest[a + i]);
            const length = Math.hypot(...e);
            const area = 0.5 * Math.hypot(e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]);
            edges += length;
            if (!(area > 1e-6 * (length * length + f[0] ** 2 + f[1] ** 2 + f[2] ** 2))) continue;
            const x = (f[0] * e[0] + f[1] * e[1] + f[2] * e[2]) / length, y = (2 * area) / length;
            this.#inverse.set([1 / length, -x / (length * y), 1 / y], 3 * t);
            this.#area[t] = area;
            for (let i = 0; i < 3; i++) this.#around[triangles[3 * t + i]] += area;
        }
        this.edge = edges / Math.max(count, 1);
        this.#same = Uint32Array.from({ length: vertices }, (_, v) => v);
        if (uvs.length > 0) {
            const first = new Map();
            for (let v = 0; v < vertices; v++) {
                const place = [rest, normals].map((of) => of.subarray(3 * v, 3 * v + 3).join()).join();
                if (first.has(place)) this.#same[v] = first.get(place);
                else first.set(place, v);
            }
        }
        this.#restNormals = null;
        if (normals.length > 0) {
            const ofTriangles = new Float32Array(3 * vertices);
            this.normals(rest, ofTriangles);
            this.#restNormals = ofTriangles;
        }
        this.#tissue = new Uint8Array(4 * vertices);
        let organ = 0, until = organs[0]?.vertices ?? vertices;
        for (let v = 0; v < vertices; v++) {
            while (v >= until && organ + 1 < organs.length) until += organs[++organ].vertices;
            const [x, y, z] = [0, 1, 2].map((i) => (rest[3 * v + i] / this.size) * 9);
            const shade = 1 + 0.09 * noise(x, y, z) + 0.07 * noise(4 * x, 4 * y, 4 * z);
            const tissue = TISSUES[organ % TISSUES.length];
            for (let i = 0; i < 3; i++) this.#tissue[4 * v + i] = Math.min(255, tissue[i] * shade);
        }
    }

    // (3 n) unit normals out of the body: those of the triangles around each vertex, weighted by area; where the surface has
    // normals of its own, these, turned as those of the triangles have.
    normals(positions, normals) {
        const { triangles } = this.surface, same = this.#same;
        normals.fill(0);
        for (let t = 0; t < triangles.length; t += 3) {
            const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
            const ax = positions[a], ay = positions[a + 1], az = positions[a + 2];
            const ex = positions[b] - ax, ey = positions[b + 1] - ay, ez = positions[b + 2] - az;
            const fx = positions[c] - ax, fy = positions[c + 1] - ay, fz = positions[c + 2] - az;
            const nx = ey * fz - ez * fy, ny = ez * fx - ex * fz, nz = ex * fy - ey * fx;
            for (let i = 0; i < 3; i++) {
                const v = 3 * same[triangles[t + i]];
                normals[v] += nx; normals[v + 1] += ny; normals[v + 2] += nz;
            }
        }
        // The first of those at one place comes first.
        for (let v = 0; v < same.length; v++) {
            const from = 3 * same[v], to = 3 * v;
            const x = normals[from], y = normals[from + 1], z = normals[from + 2], length = Math.sqrt(x * x + y * y + z * z) || 1;
            normals[to] = x / length; normals[to + 1] = y / length; normals[to + 2] = z / length;
        }
        if (this.#restNormals) this.#turnOwn(normals);
    }

    // Own normals, turned from `normals` of the triangles at rest to those that they are now; (0, 0, 0) stands for the latter.
    #turnOwn(normals) {
        const before = this.#restNormals, own = this.surface.normals;
        for (let v = 0; v < normals.length; v += 3) {
            const x = own[v], y = own[v + 1], z = own[v + 2];
            const ax = before[v], ay = before[v + 1], az = before[v + 2], bx = normals[v], by = normals[v + 1], bz = normals[v + 2];
            const cosine = ax * bx + ay * by + az * bz;
            if ((x === 0 && y === 0 && z === 0) || cosine < -0.999) continue;
            // The shortest turn from a to b, of axis w = a × b.
            const wx = ay * bz - az * by, wy = az * bx - ax * bz, wz = ax * by - ay * bx;
            const along = (wx * x + wy * y + wz * z) / (1 + cosine);
            normals[v] = cosine * x + wy * z - wz * y + along * wx;
            normals[v + 1] = cosine * y + wz * x - wx * z + along * wy;
            normals[v + 2] = cosine * z + wx * y - wy * x + along * wz;
        }
    }

    // (n) largest stretch or squeeze along the surface, |λ − 1| with λ a principal stretch; mean over the triangles around
    // a vertex, weighted by rest area.
    strain(positions) {
        const { triangles, vertices } = this.surface, strain = new Float32Array(vertices);
        for (let t = 0; t < triangles.length; t += 3) {
            const area = this.#area[t / 3];
            if (area === 0) continue;
            const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
            const p = this.#inverse[t], q = this.#inverse[t + 1], r = this.#inverse[t + 2];
            let xx = 0, xy = 0, yy = 0;
            for (let i = 0; i < 3; i++) {
                // F = [e f] · inverse, C = FᵀF; the stretches are the roots of the eigenvalues of C.
                const e = positions[b + i] - positions[a + i], f = positions[c + i] - positions[a + i];
                const along = e * p, across = e * q + f * r;
                xx += along * along; xy += along * across; yy += across * across;
            }
            const middle = 0.5 * (xx + yy), spread = Math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy);
            const value = Math.max(Math.abs(Math.sqrt(Math.max(middle + spread, 0)) - 1), Math.abs(Math.sqrt(Math.max(middle - spread, 0)) - 1));
            for (let i = 0; i < 3; i++) strain[triangles[t + i]] += area * value;
        }
        for (let v = 0; v < vertices; v++) strain[v] /= this.#around[v] || 1;
        return strain;
    }

    // (n) how far each vertex has gone from rest [m].
    displacement(positions) {
        const { rest, vertices } = this.surface;
        return Float32Array.from({ length: vertices }, (_, v) =>
            Math.hypot(positions[3 * v] - rest[3 * v], positions[3 * v + 1] - rest[3 * v + 1], positions[3 * v + 2] - rest[3 * v + 2]));
    }

    // Displacement at the end of its scale [m].
    get largestDisplacement() {
        return this.size / 10;
    }

    // (4 n) red, green and blue (sRGB) of what `colouring` shows, and how far one of `tools` touches there; levels are those of
    // the `decoder`.
    colours(colouring, positions, decoder, tools, colours) {
        const { vertices } = this.surface;
        if (colouring === 'level') {
            const { levels } = decoder;
            for (let v = 0; v < vertices; v++) {
                const colour = LEVELS[levels[v] % LEVELS.length];
                colours[4 * v] = colour[0]; colours[4 * v + 1] = colour[1]; colours[4 * v + 2] = colour[2]; colours[4 * v + 3] = 0;
            }
        } else if (colouring === 'strain' || colouring === 'displacement') {
            const values = this[colouring](positions), end = colouring === 'strain' ? LARGEST_STRAIN : this.largestDisplacement;
            for (let v = 0; v < vertices; v++) {
                const at = 3 * Math.min(Math.floor((255 * values[v]) / end), 255);
                colours[4 * v] = RAMP[at]; colours[4 * v + 1] = RAMP[at + 1]; colours[4 * v + 2] = RAMP[at + 2]; colours[4 * v + 3] = 0;
            }
        } else {
            colours.set(this.#tissue);
        }
        for (const tool of tools) this.#touch(tool, positions, colours);
    }

    // Everything closer to the tool than a tenth of its radius, fading out within an edge.
    #touch({ position, axis, length, radius }, positions, colours) {
        const reach = 1.1 * radius + this.edge;
        for (let v = 0; v < positions.length / 3; v++) {
            let x = positions[3 * v] - position[0], y = positions[3 * v + 1] - position[1], z = positions[3 * v + 2] - position[2];
            const along = Math.min(Math.max(x * axis[0] + y * axis[1] + z * axis[2], 0), length);
            x -= along * axis[0]; y -= along * axis[1]; z -= along * axis[2];
            const square = x * x + y * y + z * z;
            if (square > reach * reach) continue;
            colours[4 * v + 3] = Math.max(colours[4 * v + 3], 255 * Math.min(1, (reach - Math.sqrt(square)) / this.edge));
        }
    }
}
