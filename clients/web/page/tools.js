// What tools look like, and the arrow of the force on them.

import {
    BufferAttribute, BufferGeometry, ConeGeometry, CylinderGeometry, Group, Mesh, Quaternion, Vector3,
} from './vendor/three.min.js';

const RINGS = 16;
const SECTORS = 32;
// Length of the arrow of the largest force that a tool renders, of the body's diagonal.
const ARROW = 0.45;

// The skin of a convex part: for each direction of a grid around it, the point that lies farthest in that direction.
export function skin({ corners, rounding, disc, axis }) {
    const points = [], normals = [], triangles = [];
    for (let ring = 0; ring <= RINGS; ring++) {
        for (let sector = 0; sector < SECTORS; sector++) {
            const polar = (Math.PI * ring) / RINGS, around = (2 * Math.PI * sector) / SECTORS;
            const d = [Math.sin(polar) * Math.cos(around), Math.sin(polar) * Math.sin(around), Math.cos(polar)];
            const dot = (at) => corners[at] * d[0] + corners[at + 1] * d[1] + corners[at + 2] * d[2];
            let best = 0;
            for (let at = 3; at < corners.length; at += 3) if (dot(at) > dot(best)) best = at;
            const point = [0, 1, 2].map((i) => corners[best + i] + rounding * d[i]);
            if (disc > 0 && axis.length === 3) {
                const along = d[0] * axis[0] + d[1] * axis[1] + d[2] * axis[2];
                const across = d.map((c, i) => c - along * axis[i]), length = Math.hypot(...across);
                if (length > 1e-6) across.forEach((c, i) => (point[i] += (disc * c) / length));
            }
            points.push(...point);
            normals.push(...d);
        }
    }
    for (let ring = 0; ring < RINGS; ring++) {
        for (let sector = 0; sector < SECTORS; sector++) {
            const at = (r, s) => r * SECTORS + (s % SECTORS);
            const [a, b, c, e] = [at(ring, sector), at(ring + 1, sector), at(ring + 1, sector + 1), at(ring, sector + 1)];
            triangles.push(a, b, c, a, c, e);
        }
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new BufferAttribute(new Float32Array(points), 3));
    geometry.setAttribute('normal', new BufferAttribute(new Float32Array(normals), 3));
    geometry.setIndex(triangles);
    return geometry;
}

// Linear.
const STEEL = [0.48, 0.55, 0.62];
const RED = [1, 0.11, 0.07];

// A tool as the session describes it, with its arrow. `size`: the body's diagonal [m]; `limit`: the largest force [N].
export class ToolModel {
    constructor(description, size, limit, shading) {
        this.description = description;
        const ball = { corners: [0, 0, 0], rounding: description.radius, disc: 0, axis: [] };
        const parts = description.parts.filter(({ corners }) => corners.length >= 3);
        this.body = new Group();
        this.material = shading.solid(STEEL);
        this.red = shading.solid(RED);
        this.jaws = [];
        for (const part of parts.length > 0 ? parts : [ball]) {
            const mesh = new Mesh(skin(part), this.material);
            this.body.add(mesh);
            if (part.hinge) this.jaws.push({ mesh, hinge: part.hinge });
        }
        this.arrow = new Group();
        this.shaft = new Mesh(new CylinderGeometry(1, 1, 1, 12).translate(0, 0.5, 0), this.red);
        this.tip = new Mesh(new ConeGeometry(1, 1, 20).translate(0, 0.5, 0), this.red);
        this.arrow.add(this.shaft, this.tip);
        this.group = new Group();
        this.group.add(this.body, this.arrow);
        this.radius = description.radius;
        this.size = size;
        this.limit = limit || 3.3;
        this.force = new Vector3();
        this.group.visible = false;
    }

    // Where it is [m], how it is turned (x, y, z, w), the force on it [N], and how far its jaws are open (0 to 1).
    place({ position, orientation, force, opening }) {
        this.group.visible = true;
        this.body.position.fromArray(position);
        this.body.quaternion.fromArray(orientation).normalize();
        for (const { mesh, hinge: { axis, point, closed, open } } of this.jaws) {
            mesh.quaternion.setFromAxisAngle(new Vector3(...axis), closed + opening * (open - closed));
            const about = new Vector3(...point);
            mesh.position.copy(about).sub(about.clone().applyQuaternion(mesh.quaternion));
        }
        this.force.fromArray(force);
        const newtons = this.force.length(), length = ARROW * this.size * Math.min(newtons / this.limit, 1);
        this.arrow.visible = newtons > 0.005;
        if (!this.arrow.visible) return;
        const width = 0.007 * this.size, head = Math.min(0.06 * this.size, 0.6 * length);
        // From the tool's far side on, where the organ hides it less.
        const direction = this.force.clone().divideScalar(newtons);
        this.arrow.position.copy(this.body.position).addScaledVector(direction, this.radius);
        this.arrow.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), direction));
        this.shaft.scale.set(width, Math.max(length - head, 1e-6), width);
        this.tip.scale.set(2.6 * width, Math.max(head, 1e-6), 2.6 * width);
        this.tip.position.set(0, length - head, 0);
    }

    hide() {
        this.group.visible = false;
    }

    dispose() {
        for (const mesh of this.body.children) mesh.geometry.dispose();
        this.material.dispose();
        this.red.dispose();
        this.shaft.geometry.dispose();
        this.tip.geometry.dispose();
    }
}
