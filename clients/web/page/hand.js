// A tool in the hand of the mouse or of a finger: around the body, never through it, onto the place that is pressed, and in.
// The same as in the viewer (clients/viewer/src/poke/hand.rs). Lengths in metres.

import { Quaternion, Vector3 } from './vendor/three.min.js';

// Fastest that it travels where it touches nothing, and that it presses and strokes [m/s].
const TRAVEL = 0.6;
const PRESS = 0.15;
// Between the tool and the surface before it is pressed in.
const HOVER = 0.015;

export class Hand {
    // Above a body within the ball of `radius` around `centre`; the tool's reference point is `reach` behind what touches.
    constructor(centre, radius, reach) {
        this.centre = centre.clone();
        this.radius = radius + reach + HOVER;
        this.reach = reach;
        this.position = centre.clone().add(new Vector3(0, 0, this.radius));
        this.shaft = new Vector3(0, 0, 1);
        this.on = null; // the place that it is on, from hovering above it until it hovers again
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
        const shaft = (this.on ?? wanted)?.normal ?? this.shaft;
        // Turns within about a tenth of a second.
        this.shaft.lerp(shaft, Math.min(10 * dt, 1)).normalize();
    }

    get orientation() {
        return new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), this.shaft);
    }

    // Where the reference point is when the tool is `depth` in.
    #place({ point, normal }, depth) {
        return point.clone().addScaledVector(normal, this.reach - depth);
    }

    // Straight towards `goal`; true when it is there.
    #go(goal, step) {
        const way = goal.clone().sub(this.position), distance = way.length();
        if (distance <= step) this.position.copy(goal);
        else this.position.addScaledVector(way, step / distance);
        return distance <= step;
    }

    // Towards `goal` outside the ball around the body until it is above it, then down; true when it is there.
    #travel(goal, step) {
        const from = this.position.clone().sub(this.centre), to = goal.clone().sub(this.centre);
        if (from.angleTo(to) < 0.05) return this.#go(goal, step);
        if (from.length() < this.radius - 1e-4) {
            this.#go(from.setLength(this.radius).add(this.centre), step);
            return false;
        }
        // Along the great circle; from the very opposite side any of them will do.
        const across = to.clone().addScaledVector(from, -to.dot(from) / from.lengthSq());
        if (across.length() < 1e-6) {
            across.crossVectors(from, Math.abs(from.x) < 0.5 * from.length() ? new Vector3(1, 0, 0) : new Vector3(0, 1, 0));
        }
        this.position.copy(from.add(across.setLength(step)).setLength(this.radius).add(this.centre));
        return false;
    }
}

// Where the ray from `origin` along `direction` (unit) meets a surface first: { point, normal } out of the body, or null.
export function pick(origin, direction, { triangles, positions, normals }) {
    let nearest = Infinity, found = null;
    for (let t = 0; t < triangles.length; t += 3) {
        const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
        const ex = positions[b] - positions[a], ey = positions[b + 1] - positions[a + 1], ez = positions[b + 2] - positions[a + 2];
        const fx = positions[c] - positions[a], fy = positions[c + 1] - positions[a + 1], fz = positions[c + 2] - positions[a + 2];
        const px = direction.y * fz - direction.z * fy, py = direction.z * fx - direction.x * fz, pz = direction.x * fy - direction.y * fx;
        const determinant = ex * px + ey * py + ez * pz;
        // From outside only.
        if (determinant < 1e-14) continue;
        const sx = origin.x - positions[a], sy = origin.y - positions[a + 1], sz = origin.z - positions[a + 2];
        const u = (sx * px + sy * py + sz * pz) / determinant;
        if (u < 0 || u > 1) continue;
        const qx = sy * ez - sz * ey, qy = sz * ex - sx * ez, qz = sx * ey - sy * ex;
        const v = (direction.x * qx + direction.y * qy + direction.z * qz) / determinant;
        if (v < 0 || u + v > 1) continue;
        const distance = (fx * qx + fy * qy + fz * qz) / determinant;
        if (distance > 0 && distance < nearest) [nearest, found] = [distance, { a, b, c, u, v }];
    }
    if (!found) return null;
    const { a, b, c, u, v } = found, normal = new Vector3();
    for (const [at, weight] of [[a, 1 - u - v], [b, u], [c, v]]) {
        normal.add(new Vector3(normals[at], normals[at + 1], normals[at + 2]).multiplyScalar(weight));
    }
    return { point: direction.clone().multiplyScalar(nearest).add(origin), normal: normal.normalize() };
}
