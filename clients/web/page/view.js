// The picture: organ, tools, light. In the frame of Palpate (x right, y away, z up, metres) under `root`, which stands
// upright on a screen and is laid into the room in a headset, whose axes are x right, y up, z to the user.

import {
    BufferAttribute, BufferGeometry, Color, GridHelper, Group, Mesh, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer,
} from './vendor/three.min.js';
import { Shading } from './shading.js';
import { ObstacleModel } from './obstacles.js';
import { ToolModel } from './tools.js';
import { shapeOf } from './wire.js';

// Between two pictures at best, with a graphics card and without [ms]: more of them would leave the decoder, and a server on the
// same machine, no processor.
const PACE = 1000 / 60;
const SOFTWARE_PACE = 1000 / 30;
// The picture gets coarser where its pace is slower by this factor, and finer where it is not by that one.
const SLOW = 1.8;
const FAST = 1.1;
const COARSEST = 0.5;
// Of a picture on the organ, in pixels: 64 MB with its smaller copies take a phone's memory, and no screen shows more.
const LARGEST_PICTURE = 4096;
const BACKGROUND = new Color(0x10151b);
// Between two frames of the surface at most [ms]: beyond, the next one is shown at once.
const LONGEST_BLEND = 140;

export class View {
    // On `canvas`, whose WebGL 2 is `context`; with or without a graphics card.
    constructor(canvas, context, drawsInSoftware) {
        this.renderer = new WebGLRenderer({ canvas, context });
        this.renderer.xr.enabled = true;
        this.scene = new Scene();
        this.scene.background = BACKGROUND;
        this.camera = new PerspectiveCamera(35, 1, 0.01, 10);
        this.root = new Group();
        this.scene.add(this.root, this.camera);
        this.shading = new Shading();
        this.tools = new Map();
        this.descriptions = [];
        this.obstacles = [];
        this.obstacleStates = [[], []]; // before, now: (obstacles) { position }
        this.states = new Map(); // tool number: [before, now], each { position, orientation, force }
        this.arrived = 0;
        this.interval = 32;
        this.finest = Math.min(globalThis.devicePixelRatio || 1, 2);
        this.ratio = drawsInSoftware ? Math.min(this.finest, 0.75) : this.finest;
        this.pace = drawsInSoftware ? SOFTWARE_PACE : PACE;
        this.slowness = (SLOW + FAST) / 2;
        this.judged = 0;
        this.#resize();
        addEventListener('resize', () => this.#resize());
    }

    #resize() {
        const { innerWidth, innerHeight } = globalThis;
        if (this.renderer.xr.isPresenting) return;
        this.renderer.setPixelRatio(this.ratio);
        this.renderer.setSize(innerWidth, innerHeight);
        this.camera.aspect = innerWidth / innerHeight;
        this.camera.updateProjectionMatrix();
        this.resized?.();
    }

    // Another organ.
    setSurface({ triangles, vertices, uvs, materials, bounds, size }) {
        if (this.organ) {
            this.root.remove(this.organ, this.grid);
            this.organ.geometry.dispose();
            this.organ.material.forEach((material) => material.dispose());
            this.grid.geometry.dispose();
        }
        this.triangles = triangles;
        this.size = size;
        this.centre = [0, 1, 2].map((i) => (bounds[i] + bounds[i + 3]) / 2);
        const geometry = new BufferGeometry();
        for (const name of ['position', 'next', 'normal', 'nextNormal']) {
            geometry.setAttribute(name, new BufferAttribute(new Float32Array(3 * vertices), 3));
        }
        geometry.setAttribute('colour', new BufferAttribute(new Uint8Array(4 * vertices), 4, true));
        geometry.setAttribute('uv', new BufferAttribute(uvs.length > 0 ? uvs : new Float32Array(2 * vertices), 2));
        geometry.setIndex(new BufferAttribute(triangles, 1));
        const all = materials.length > 0 ? materials : [{ triangles: triangles.length / 3, colour: [], picture: 0 }];
        all.reduce((from, { triangles }, i) => (geometry.addGroup(from, 3 * triangles, i), from + 3 * triangles), 0);
        this.organ = new Mesh(geometry, this.shading.organ(all));
        this.organ.frustumCulled = false;
        this.organ.visible = false;
        // Lines 2 cm apart, as a measure.
        const cells = 2 * Math.ceil((1.2 * size) / 0.04);
        this.grid = new GridHelper(cells * 0.02, cells, 0x39444f, 0x232b33);
        this.grid.rotation.x = Math.PI / 2;
        this.grid.position.set((bounds[0] + bounds[3]) / 2, (bounds[1] + bounds[4]) / 2, bounds[2] - 0.002);
        this.root.add(this.organ, this.grid);
        this.states.clear();
    }

    // Tools and obstacles as the session describes them.
    setThings({ tools: descriptions, obstacles }, limit) {
        for (const thing of [...this.tools.values(), ...this.obstacles]) {
            this.root.remove(thing.group);
            thing.dispose();
        }
        this.tools.clear();
        [this.descriptions, this.limit] = [descriptions, limit];
        for (const { tool } of descriptions) this.#shape(tool, tool);
        const model = (of) => new ObstacleModel(of, this.centre ?? [0, 0, 0], this.size ?? 0.3, this.shading);
        this.obstacles = obstacles.map(model);
        for (const { group } of this.obstacles) this.root.add(group);
        this.#showGround(this.scene.background !== null);
    }

    // The measure below the organ is on the ground, where there is one.
    #showGround(isShown) {
        const grounds = this.obstacles.filter(({ isGround }) => isGround);
        for (const { group } of grounds) group.visible = isShown;
        if (this.grid) this.grid.visible = isShown && grounds.length === 0;
    }

    // Has `tool` look like the tool `of`.
    #shape(tool, of) {
        const description = this.descriptions.find((known) => known.tool === of), old = this.tools.get(tool);
        if (!description || old?.description === description) return;
        if (old) {
            this.root.remove(old.group);
            old.dispose();
        }
        const model = new ToolModel(description, this.size ?? 0.3, this.limit, this.shading);
        this.tools.set(tool, model);
        this.root.add(model.group);
    }

    // The newest frame; gives the buffers of one that is not drawn any more.
    setFrame({ colouring, positions, normals, colours, tools, obstacles }, now) {
        if (!this.organ) return null;
        const { geometry } = this.organ, { position, normal, colour } = geometry.attributes;
        const old = { positions: position.array, normals: normal.array, colours: colour.array };
        const put = (attribute, array) => {
            attribute.array = array;
            attribute.needsUpdate = true;
        };
        // What was next is now, and stays where it is on the graphics card; the first frame is both.
        const turn = (now, next, array) => {
            const { [now]: before, [next]: after } = geometry.attributes;
            geometry.setAttribute(now, after);
            geometry.setAttribute(next, before);
            put(before, array);
            if (!this.organ.visible) put(after, array.slice());
        };
        turn('position', 'next', positions);
        turn('normal', 'nextNormal', normals);
        this.setColours({ colouring, colours });
        this.organ.visible = true;
        const gap = now - this.arrived;
        if (gap < LONGEST_BLEND) this.interval += 0.2 * (gap - this.interval);
        this.arrived = now;
        this.obstacleStates = [this.obstacleStates[1], obstacles];
        const seen = new Set();
        for (const state of tools) {
            this.#shape(state.tool, shapeOf(state));
            const before = this.states.get(state.tool)?.[1] ?? state;
            this.states.set(state.tool, [before, state]);
            seen.add(state.tool);
        }
        for (const tool of this.states.keys()) {
            if (!seen.has(tool)) this.states.delete(tool);
        }
        return old;
    }

    setColours({ colouring, colours }) {
        const attribute = this.organ?.geometry.attributes.colour;
        if (attribute?.array.length !== colours.length) return;
        attribute.array = colours;
        attribute.needsUpdate = true;
        this.shading.setNatural(colouring === 'material');
    }

    // Longest side of a picture on the organ [pixels].
    get largestPicture() {
        return Math.min(this.renderer.capabilities.maxTextureSize, LARGEST_PICTURE);
    }

    // The surface as it is now, to be picked from.
    get surface() {
        const { attributes } = this.organ.geometry;
        return { triangles: this.triangles, positions: attributes.next.array.slice(), normals: attributes.nextNormal.array.slice() };
    }

    // Draws; `own`: states of tools that this page holds, which are newer than the frame's.
    draw(now, own) {
        const blend = Math.min((now - this.arrived) / Math.max(this.interval, 1), 1);
        this.shading.setBlend(blend);
        for (const [number, model] of this.tools) {
            const state = own.get(number), frames = this.states.get(number);
            if (state) model.place(state);
            else if (frames) model.place(between(...frames, blend));
            else model.hide();
        }
        const [before, after] = this.obstacleStates;
        this.obstacles.forEach((model, i) => {
            const to = after[i]?.position ?? [], from = before[i]?.position ?? to;
            model.place(to.map((x, c) => from[c] + blend * (x - from[c])));
        });
        this.renderer.render(this.scene, this.camera);
    }

    // Whether it is time for a picture, so long after the last [ms]: with a graphics card whenever the display asks for one.
    isDue(time) {
        return this.pace === PACE || this.renderer.xr.isPresenting || time > this.pace - PACE / 2;
    }

    // As many pixels as the machine can draw; `time`: since the last picture [ms].
    adapt(time, now) {
        if (this.renderer.xr.isPresenting || time > 500) return;
        this.slowness += 0.1 * (time / this.pace - this.slowness);
        if (now - this.judged < 700) return;
        this.judged = now;
        const ratio = this.slowness > SLOW ? this.ratio * 0.8 : this.slowness < FAST ? this.ratio * 1.1 : this.ratio;
        const bounded = Math.min(Math.max(ratio, COARSEST), this.finest);
        if (bounded === this.ratio) return;
        this.ratio = bounded;
        this.#resize();
    }

    // Lays the organ into the room: `position` of the middle of `bounds`, turned by `yaw` about the upright axis [rad].
    layDown(bounds, position, yaw) {
        const middle = new Vector3((bounds[0] + bounds[3]) / 2, (bounds[1] + bounds[4]) / 2, (bounds[2] + bounds[5]) / 2);
        // Headset (x right, y up, z to the user) to ours: (x, −z, y).
        const upright = new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), -Math.PI / 2);
        this.root.quaternion.setFromAxisAngle(new Vector3(0, 1, 0), yaw).multiply(upright);
        this.root.position.copy(position).sub(middle.applyQuaternion(this.root.quaternion));
        this.root.updateMatrixWorld(true);
    }

    standUp() {
        this.root.position.set(0, 0, 0);
        this.root.quaternion.identity();
        this.root.updateMatrixWorld(true);
        this.scene.background = BACKGROUND;
        this.renderer.setClearAlpha(1);
        this.#showGround(true);
        this.#resize();
    }

    // The room shows through.
    seeThrough() {
        this.scene.background = null;
        this.renderer.setClearAlpha(0);
        this.#showGround(false);
    }
}

function between(before, now, blend) {
    const position = now.position.map((x, i) => before.position[i] + blend * (x - before.position[i]));
    const turn = new Quaternion().fromArray(before.orientation).slerp(new Quaternion().fromArray(now.orientation), blend);
    const opening = before.opening + blend * (now.opening - before.opening);
    return { position, orientation: turn.toArray(), force: now.force, opening };
}
