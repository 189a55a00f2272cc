// The picture: organ, tools, light. In the frame of Palpate (x right, y away, z up, metres) under `root`, which stands
// upright on a screen and is laid into the room in a headset, whose axes are x right, y up, z to the user.

import {
    AmbientLight, BufferAttribute, BufferGeometry, Color, DirectionalLight, GridHelper, Group, Mesh, MeshPhongMaterial,
    PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer,
} from './vendor/three.min.js';
import { ToolModel } from './tools.js';

// The picture gets coarser where a frame takes longer than this, and finer where it takes less [ms].
const SLOW = 30;
const FAST = 18;
const COARSEST = 0.5;
const BACKGROUND = new Color(0x10151b);
// Between two frames of the surface at most [ms]: beyond, the next one is shown at once.
const LONGEST_BLEND = 140;

export class View {
    constructor(canvas) {
        const software = drawsInSoftware();
        this.renderer = new WebGLRenderer({ canvas, antialias: !software, powerPreference: 'high-performance' });
        this.renderer.xr.enabled = true;
        this.scene = new Scene();
        this.scene.background = BACKGROUND;
        this.camera = new PerspectiveCamera(35, 1, 0.01, 10);
        this.root = new Group();
        this.scene.add(this.root, this.camera, new AmbientLight(0xdfe8ff, 0.7));
        for (const [strength, ...from] of [[2.4, -0.5, -0.7, 1.2], [0.7, 1, 0.2, 0.3]]) {
            const light = new DirectionalLight(0xffffff, strength);
            light.position.set(...from);
            this.root.add(light, light.target);
        }
        this.material = this.#tissue();
        this.tools = new Map();
        this.states = new Map(); // tool number: [before, now], each { position, orientation, force }
        this.arrived = 0;
        this.interval = 32;
        this.finest = Math.min(globalThis.devicePixelRatio || 1, 2);
        this.ratio = software ? Math.min(this.finest, 0.75) : this.finest;
        this.frameTime = (SLOW + FAST) / 2;
        this.judged = 0;
        this.#resize();
        addEventListener('resize', () => this.#resize());
    }

    // Between the last frame and the newest one, on the graphics card.
    #tissue() {
        const material = new MeshPhongMaterial({ vertexColors: true, specular: 0x555555, shininess: 38 });
        this.blend = { value: 1 };
        material.onBeforeCompile = (shader) => {
            shader.uniforms.blend = this.blend;
            shader.vertexShader =
                'attribute vec3 next;\nattribute vec3 nextNormal;\nuniform float blend;\n' +
                shader.vertexShader
                    .replace('#include <beginnormal_vertex>', 'vec3 objectNormal = normalize(mix(normal, nextNormal, blend));')
                    .replace('#include <begin_vertex>', 'vec3 transformed = mix(position, next, blend);');
        };
        return material;
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
    setSurface({ triangles, rest, vertices, bounds, size }) {
        if (this.organ) {
            this.root.remove(this.organ, this.grid);
            this.organ.geometry.dispose();
            this.grid.geometry.dispose();
        }
        this.triangles = triangles;
        this.size = size;
        const geometry = new BufferGeometry();
        const attribute = (name, array, normalized = false) => geometry.setAttribute(name, new BufferAttribute(array, 3, normalized));
        attribute('position', rest.slice());
        attribute('next', rest.slice());
        attribute('normal', new Float32Array(3 * vertices));
        attribute('nextNormal', new Float32Array(3 * vertices));
        attribute('color', new Uint8Array(3 * vertices), true);
        geometry.setIndex(new BufferAttribute(triangles, 1));
        this.organ = new Mesh(geometry, this.material);
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

    setTools(descriptions, limit) {
        for (const tool of this.tools.values()) {
            this.root.remove(tool.group);
            tool.dispose();
        }
        this.tools.clear();
        for (const description of descriptions) {
            const model = new ToolModel(description, this.size ?? 0.3, limit);
            this.tools.set(description.tool, model);
            this.root.add(model.group);
        }
    }

    // The newest frame; gives the buffers of one that is not drawn any more.
    setFrame({ positions, normals, colours, tools }, now) {
        if (!this.organ) return null;
        const { attributes } = this.organ.geometry;
        const old = { positions: attributes.position.array, normals: attributes.normal.array, colours: attributes.color.array };
        const put = (name, array) => {
            attributes[name].array = array;
            attributes[name].needsUpdate = true;
        };
        const first = !this.organ.visible;
        put('position', first ? positions.slice() : attributes.next.array);
        put('normal', first ? normals.slice() : attributes.nextNormal.array);
        put('next', positions);
        put('nextNormal', normals);
        put('color', colours);
        this.organ.visible = true;
        const gap = now - this.arrived;
        if (gap < LONGEST_BLEND) this.interval += 0.2 * (gap - this.interval);
        this.arrived = now;
        const seen = new Set();
        for (const state of tools) {
            const before = this.states.get(state.tool)?.[1] ?? state;
            this.states.set(state.tool, [before, state]);
            seen.add(state.tool);
        }
        for (const tool of this.states.keys()) {
            if (!seen.has(tool)) this.states.delete(tool);
        }
        return old;
    }

    setColours(colours) {
        const attribute = this.organ?.geometry.attributes.color;
        if (attribute?.array.length !== colours.length) return;
        attribute.array = colours;
        attribute.needsUpdate = true;
    }

    // The surface as it is now, to be picked from.
    get surface() {
        const { attributes } = this.organ.geometry;
        return { triangles: this.triangles, positions: attributes.next.array.slice(), normals: attributes.nextNormal.array.slice() };
    }

    // Draws; `own`: states of tools that this page holds, which are newer than the frame's.
    draw(now, own) {
        const blend = Math.min((now - this.arrived) / Math.max(this.interval, 1), 1);
        this.blend.value = blend;
        for (const [number, model] of this.tools) {
            const state = own.get(number), frames = this.states.get(number);
            if (state) model.place(state.position, state.orientation, state.force);
            else if (frames) model.place(...between(...frames, blend));
            else model.hide();
        }
        this.renderer.render(this.scene, this.camera);
    }

    // Grey where nothing comes any more.
    setStale(stale) {
        this.material.color.set(stale ? 0x777777 : 0xffffff);
    }

    // As many pixels as the machine can draw; `time`: since the last frame [ms].
    adapt(time, now) {
        if (this.renderer.xr.isPresenting || time > 500) return;
        this.frameTime += 0.1 * (time - this.frameTime);
        if (now - this.judged < 700) return;
        this.judged = now;
        const ratio = this.frameTime > SLOW ? this.ratio * 0.8 : this.frameTime < FAST ? this.ratio * 1.1 : this.ratio;
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
        if (this.grid) this.grid.visible = true;
        this.#resize();
    }

    // The room shows through.
    seeThrough() {
        this.scene.background = null;
        this.renderer.setClearAlpha(0);
        if (this.grid) this.grid.visible = false;
    }
}

// Whether there is no graphics card.
function drawsInSoftware() {
    const gl = new OffscreenCanvas(1, 1).getContext('webgl2');
    const named = gl?.getExtension('WEBGL_debug_renderer_info');
    const name = named ? String(gl.getParameter(named.UNMASKED_RENDERER_WEBGL)) : '';
    gl?.getExtension('WEBGL_lose_context')?.loseContext();
    return /swiftshader|llvmpipe|software|basic render/i.test(name);
}

function between(before, now, blend) {
    const position = now.position.map((x, i) => before.position[i] + blend * (x - before.position[i]));
    const turn = new Quaternion().fromArray(before.orientation).slerp(new Quaternion().fromArray(now.orientation), blend);
    return [position, turn.toArray(), now.force];
}
