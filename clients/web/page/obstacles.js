// What obstacles look like: rigid things that no hand moves.

import { BufferAttribute, BufferGeometry, GridHelper, Group, Mesh, Quaternion, Vector3 } from './vendor/three.min.js';
import { skin } from './tools.js';

// Linear: bone, and the ground.
const BONE = [0.72, 0.66, 0.55];
const GROUND = [0.035, 0.05, 0.065];
// Between lines on the ground [m], as a measure.
const CELL = 0.02;

// An obstacle as the session describes it, beside a body of `size` [m] around `centre`.
export class ObstacleModel {
    constructor({ parts, position, orientation }, centre, size, shading) {
        this.isGround = parts.length === 0;
        this.material = shading.solid(this.isGround ? GROUND : BONE);
        this.group = new Group();
        this.begin = position;
        this.group.quaternion.fromArray(orientation).normalize();
        if (this.isGround) this.#lay(centre, size);
        else for (const part of parts) if (part.corners.length >= 3) this.group.add(new Mesh(skin(part), this.material));
        this.place(position);
    }

    // A square around what is below the body; from behind it is not there, and hides nothing that lies on it.
    #lay(centre, size) {
        const turn = new Quaternion().copy(this.group.quaternion).invert();
        const middle = new Vector3(...centre).sub(new Vector3(...this.begin)).applyQuaternion(turn);
        const [x, y] = [middle.x, middle.y].map((c) => CELL * Math.round(c / CELL));
        const cells = 2 * Math.ceil((1.2 * size) / (2 * CELL)), half = (cells * CELL) / 2;
        const corners = [-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, -1, 0, 1, 1, 0, -1, 1, 0].map((c) => c * half);
        const geometry = new BufferGeometry();
        geometry.setAttribute('position', new BufferAttribute(new Float32Array(corners), 3));
        geometry.setAttribute('normal', new BufferAttribute(new Float32Array(corners.map((_, i) => (i % 3 === 2 ? 1 : 0))), 3));
        const ground = new Mesh(geometry, this.material);
        ground.position.set(x, y, 0);
        const lines = new GridHelper(2 * half, cells, 0x64717e, 0x4d5965);
        lines.rotation.x = Math.PI / 2;
        lines.position.set(x, y, 5e-4 * size);
        this.group.add(ground, lines);
    }

    // Where its reference point is [m].
    place(position) {
        this.group.position.fromArray(position.length === 3 ? position : this.begin);
    }

    dispose() {
        for (const mesh of this.group.children) mesh.geometry.dispose();
        this.material.dispose();
    }
}
