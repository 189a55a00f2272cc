// Virtual and mixed reality: each controller holds a tool; its trigger is the tool's button (bit 0), its grip takes the whole
// organ, and it shakes as the force grows.

import { Group, CylinderGeometry, Matrix4, Mesh, Quaternion, Vector3 } from './vendor/three.min.js';

// From the controller's ray's origin to the reference point of its tool [m].
const AHEAD = 0.09;
// Where the organ is put: from the eyes ahead, and down [m].
const NEAR = 0.45;
const BELOW = 0.32;
// Force that can just be felt as vibration, and the shortest pulse [N], [ms].
const FELT = 0.03;
const PULSE = 40;

export class Headset {
    #session = null;
    #placed = false;
    #grabs = new Map();
    #handles = new Map();

    constructor(view) {
        this.view = view;
    }

    // Which of 'immersive-vr' and 'immersive-ar' there are.
    static async modes() {
        const modes = [];
        for (const mode of ['immersive-vr', 'immersive-ar']) {
            if (await navigator.xr?.isSessionSupported(mode).catch(() => false)) modes.push(mode);
        }
        return modes;
    }

    get isOn() {
        return this.#session !== null;
    }

    // How often poses come at least [Hz]: with every second picture, as headsets leave some out.
    get rate() {
        return (this.#session?.frameRate || 72) / 2;
    }

    // Enters; `left` is called when the user has come back.
    async enter(mode, left) {
        const session = await navigator.xr.requestSession(mode, { requiredFeatures: ['local-floor'] });
        const { renderer } = this.view;
        renderer.xr.setReferenceSpaceType('local-floor');
        await renderer.xr.setSession(session);
        this.#session = session;
        this.#placed = false;
        if (mode === 'immersive-ar') this.view.seeThrough();
        session.addEventListener('end', () => {
            this.#session = null;
            this.#grabs.clear();
            for (const handle of this.#handles.values()) this.view.scene.remove(handle);
            this.#handles.clear();
            this.view.standUp();
            left();
        });
    }

    leave() {
        return this.#session?.end();
    }

    // Poses of the controllers in the frame of Palpate, at the display's time: { hand, position, orientation, buttons, opening }.
    poses(frame, bounds) {
        const { renderer, root } = this.view, space = renderer.xr.getReferenceSpace();
        const eyes = frame.getViewerPose(space);
        if (!this.#placed && eyes) {
            const { position, orientation } = eyes.transform;
            const ahead = new Vector3(0, 0, -1).applyQuaternion(new Quaternion(orientation.x, orientation.y, orientation.z, orientation.w));
            const yaw = Math.atan2(-ahead.x, -ahead.z);
            const away = new Vector3(-Math.sin(yaw), 0, -Math.cos(yaw)).multiplyScalar(NEAR);
            this.view.layDown(bounds, new Vector3(position.x, position.y - BELOW, position.z).add(away), yaw);
            this.#placed = true;
        }
        const poses = [], seen = new Set();
        for (const source of this.#session.inputSources) {
            if (source.targetRayMode !== 'tracked-pointer' || source.handedness === 'none') continue;
            const pose = frame.getPose(source.targetRaySpace, space);
            if (!pose) continue;
            const ray = new Matrix4().fromArray(pose.transform.matrix), hand = source.handedness;
            const pressed = (button) => source.gamepad?.buttons[button]?.value ?? 0;
            const held = (button) => pressed(button) > 0.5;
            this.#grab(hand, held(1), ray);
            this.#show(hand, ray);
            seen.add(hand);
            const tip = ray.multiply(new Matrix4().makeTranslation(0, 0, -AHEAD));
            const inBody = new Matrix4().copy(root.matrixWorld).invert().multiply(tip);
            const position = new Vector3(), orientation = new Quaternion();
            inBody.decompose(position, orientation, new Vector3());
            const buttons = (held(0) ? 1 : 0) | (held(1) ? 2 : 0);
            // The trigger closes jaws as far as it is pulled.
            const opening = 1 - pressed(0);
            poses.push({ hand, position: position.toArray(), orientation: orientation.toArray(), buttons, opening });
        }
        for (const [hand, handle] of this.#handles) handle.visible = seen.has(hand);
        return poses;
    }

    // The organ goes with the hand as long as that holds it.
    #grab(hand, holds, ray) {
        const { root } = this.view;
        if (!holds) {
            this.#grabs.delete(hand);
            return;
        }
        root.updateMatrixWorld(true);
        if (!this.#grabs.has(hand)) {
            this.#grabs.clear(); // the last hand has it
            this.#grabs.set(hand, new Matrix4().copy(ray).invert().multiply(root.matrixWorld));
        }
        const moved = new Matrix4().multiplyMatrices(ray, this.#grabs.get(hand));
        moved.decompose(root.position, root.quaternion, new Vector3());
        root.updateMatrixWorld(true);
    }

    // A handle in the hand, up to where its tool begins.
    #show(hand, ray) {
        if (!this.#handles.has(hand)) {
            const handle = new Group();
            const material = this.view.shading.solid([0.09, 0.12, 0.15]);
            const grip = new Mesh(new CylinderGeometry(0.009, 0.012, 0.12, 16), material);
            grip.rotation.x = Math.PI / 2;
            grip.position.z = 0.03;
            const rod = new Mesh(new CylinderGeometry(0.0015, 0.0015, AHEAD, 8), material);
            rod.rotation.x = Math.PI / 2;
            rod.position.z = -AHEAD / 2;
            handle.add(grip, rod);
            this.#handles.set(hand, handle);
            this.view.scene.add(handle);
        }
        ray.decompose(this.#handles.get(hand).position, this.#handles.get(hand).quaternion, new Vector3());
    }

    // Shakes the controller in `hand` for a force of `newtons`, where `limit` is the largest.
    shake(hand, newtons, limit) {
        const strength = newtons > FELT ? Math.min(1, 0.12 + 0.88 * Math.sqrt(newtons / limit)) : 0;
        if (strength === 0) return;
        for (const source of this.#session?.inputSources ?? []) {
            if (source.handedness === hand) source.gamepad?.hapticActuators?.[0]?.pulse(strength, PULSE);
        }
    }
}
