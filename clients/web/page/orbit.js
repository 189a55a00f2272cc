// The camera around the organ: one finger or the mouse turns, two fingers or the wheel come nearer, two fingers or the right
// button shift.

import { Vector3 } from './vendor/three.min.js';

const NEAREST = 0.2;
const FARTHEST = 6;

export class Orbit {
    // Looks with `camera` at what is drawn in `element`; `claim(event)`: true where a finger does something else.
    constructor(camera, element, claim) {
        this.camera = camera;
        this.yaw = -0.5;
        this.pitch = 0.5;
        this.zoom = 1;
        this.centre = new Vector3();
        this.size = 0.3;
        this.fingers = new Map();
        element.addEventListener('pointerdown', (event) => {
            if (claim(event)) return;
            element.setPointerCapture(event.pointerId);
            this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
        });
        element.addEventListener('pointermove', (event) => this.#move(event, element.clientHeight));
        for (const end of ['pointerup', 'pointercancel']) {
            element.addEventListener(end, (event) => this.fingers.delete(event.pointerId));
        }
        element.addEventListener('contextmenu', (event) => event.preventDefault());
    }

    // Shows all of a body within `bounds` [m].
    fit(bounds) {
        this.centre.set((bounds[0] + bounds[3]) / 2, (bounds[1] + bounds[4]) / 2, (bounds[2] + bounds[5]) / 2);
        this.size = Math.hypot(bounds[3] - bounds[0], bounds[4] - bounds[1], bounds[5] - bounds[2]);
        this.zoom = 1;
        this.update();
    }

    nearer(factor) {
        this.zoom = Math.min(Math.max(this.zoom * factor, NEAREST), FARTHEST);
        this.update();
    }

    #move(event, height) {
        const last = this.fingers.get(event.pointerId);
        if (!last) return;
        const now = [event.clientX, event.clientY], moved = [now[0] - last[0], now[1] - last[1]];
        const other = [...this.fingers].find(([id]) => id !== event.pointerId)?.[1];
        this.fingers.set(event.pointerId, now);
        if (other) {
            const apart = (finger) => Math.hypot(finger[0] - other[0], finger[1] - other[1]);
            this.#shift(moved[0] / 2, moved[1] / 2, height);
            this.nearer(apart(now) / Math.max(apart(last), 1));
        } else if (event.buttons & 6) {
            this.#shift(...moved, height);
        } else {
            this.yaw -= moved[0] * 0.008;
            this.pitch = Math.min(Math.max(this.pitch + moved[1] * 0.008, -1.5), 1.5);
        }
        this.update();
    }

    #shift(x, y, height) {
        const scale = (2 * this.#distance() * Math.tan((this.camera.fov * Math.PI) / 360)) / height;
        const right = new Vector3().setFromMatrixColumn(this.camera.matrix, 0);
        const up = new Vector3().setFromMatrixColumn(this.camera.matrix, 1);
        this.centre.addScaledVector(right, -x * scale).addScaledVector(up, y * scale);
    }

    #distance() {
        // On an upright screen the width counts.
        const narrow = Math.min(1, this.camera.aspect);
        return (0.62 * this.size) / (Math.tan((this.camera.fov * Math.PI) / 360) * narrow * this.zoom);
    }

    update() {
        const distance = this.#distance(), { camera, yaw, pitch, centre } = this;
        camera.up.set(0, 0, 1);
        camera.position.set(
            centre.x + distance * Math.cos(pitch) * Math.sin(yaw),
            centre.y - distance * Math.cos(pitch) * Math.cos(yaw),
            centre.z + distance * Math.sin(pitch),
        );
        camera.near = distance / 50;
        camera.far = distance * 20;
        camera.lookAt(centre);
        camera.updateProjectionMatrix();
        camera.updateMatrix();
    }
}
