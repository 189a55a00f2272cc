// A tool in the hand of the mouse or of a finger: around the body, never through it, onto the place that is pressed, and in.
// The same as in the viewer (clients/viewer/src/poke/hand.rs). Lengths in metres, vectors as [x, y, z].

// Fastest that it travels where it touches nothing, and that it presses and strokes [m/s].
const TRAVEL = 0.6;
const PRESS = 0.15;
// Between the tool and the surface before it is pressed in.
const HOVER = 0.015;
// Time in which jaws open or close all the way [s].
const JAWS = 0.5;

const plus = (a, b, times = 1) => a.map((x, i) => x + times * b[i]);
const minus = (a, b) => plus(a, b, -1);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(...a);
const across = (a) => cross(a, Math.abs(a[0]) < 0.5 * length(a) ? [1, 0, 0] : [0, 1, 0]);
const long = (a, wanted) => a.map((x) => (x * wanted) / length(a));

export class Hand {
    // Above a body within the ball of `radius` around `centre`; the tool's reference point is `reach` behind what touches.
    constructor(centre, radius, reach) {
        this.centre = centre;
        this.radius = radius + reach + HOVER;
        this.reach = reach;
        this.position = plus(centre, [0, 0, this.radius]);
        this.shaft = [0, 0, 1];
        this.on = null; // the place that it is on, from hovering above it until it hovers again
        this.opening = 0; // of the tool's jaws: 0, closed, to 1
    }

    // Opens or closes jaws, as far as `dt` [s] lasts.
    moveJaws(open, dt) {
        this.opening = Math.min(Math.max(this.opening + (open ? dt : -dt) / JAWS, 0), 1);
    }

    // One step of `dt` [s] towards what is wanted: { point, normal, depth }, or null to let go.
    step(wanted, dt) {
        if (this.on && wanted) {
            this.#go(this.#place(wanted, wanted.depth), PRESS * dt);
            this.on = wanted;
        } else if (this.on) {
            if (this.#go(this.#place(this.on, -HOVER), PRESS * dt)) this.on = null;
        } else if (wanted && this.#travel(this.#place(wanted, -HOVER), TRAVEL * dt)) {
            this.on = wanted;
        }
        const normal = (this.on ?? wanted)?.normal ?? this.shaft;
        // Half a turn begins to either side.
        const shaft = dot(normal, this.shaft) < -0.999 ? across(this.shaft) : normal;
        // Turns within about a tenth of a second.
        this.shaft = long(plus(this.shaft, minus(shaft, this.shaft), Math.min(10 * dt, 1)), 1);
    }

    // How the tool is turned (x, y, z, w): its +z along the shaft.
    get orientation() {
        const [x, y, z] = this.shaft, w = 1 + z;
        if (w < 1e-6) return [1, 0, 0, 0];
        const norm = Math.hypot(x, y, w);
        return [-y / norm, x / norm, 0, w / norm];
    }

    // Where the reference point is when the tool is `depth` in.
    #place({ point, normal }, depth) {
        return plus(point, normal, this.reach - depth);
    }

    // Straight towards `goal`; true when it is there.
    #go(goal, step) {
        const way = minus(goal, this.position), there = length(way) <= step;
        this.position = there ? goal : plus(this.position, long(way, step));
        return there;
    }

    // Towards `goal` outside the ball around the body until it is above it, then down; true when it is there.
    #travel(goal, step) {
        const from = minus(this.position, this.centre), to = minus(goal, this.centre);
        if (dot(from, to) > Math.cos(0.05) * length(from) * length(to)) return this.#go(goal, step);
        if (length(from) < this.radius - 1e-4) {
            this.#go(plus(this.centre, long(from, this.radius)), step);
            return false;
        }
        // Along the great circle; from the very opposite side any of them will do.
        let way = plus(to, from, -dot(to, from) / dot(from, from));
        if (length(way) < 1e-6) way = across(from);
        this.position = plus(this.centre, long(plus(from, long(way, step)), this.radius));
        return false;
    }
}

// Where the ray from `origin` along `direction` (unit) meets a surface first: { point, normal } out of the body, or null.
export function pick(origin, direction, { triangles, positions, normals }) {
    const at = (of, vertex) => [of[3 * vertex], of[3 * vertex + 1], of[3 * vertex + 2]];
    let nearest = Infinity, found = null;
    for (let t = 0; t < triangles.length; t += 3) {
        const a = at(positions, triangles[t]);
        const e = minus(at(positions, triangles[t + 1]), a), f = minus(at(positions, triangles[t + 2]), a);
        const p = cross(direction, f), determinant = dot(e, p);
        // From outside only.
        if (determinant < 1e-14) continue;
        const s = minus(origin, a), u = dot(s, p) / determinant;
        if (u < 0 || u > 1) continue;
        const q = cross(s, e), v = dot(direction, q) / determinant, distance = dot(f, q) / determinant;
        if (v < 0 || u + v > 1 || distance <= 0 || distance >= nearest) continue;
        [nearest, found] = [distance, { t, u, v }];
    }
    if (!found) return null;
    const { t, u, v } = found, weights = [1 - u - v, u, v];
    const normal = weights.reduce((sum, weight, i) => plus(sum, at(normals, triangles[t + i]), weight), [0, 0, 0]);
    return { point: plus(origin, direction, nearest), normal: long(normal, 1) };
}
