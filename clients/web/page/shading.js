// How light falls on things, as in the viewer (clients/viewer/src/shading.rs): a key light beside the eye and a dim sky. Leaner
// than a material of three.js, and without powers: pictures are also drawn without a graphics card. Brightness is the square of
// what the screen is told.

import { DataTexture, DoubleSide, LinearMipmapNearestFilter, RepeatWrapping, ShaderMaterial, Texture } from './vendor/three.min.js';

// Gloss of moist tissue and of steel, 0 to 1; how far light reaches around into their shade, 0 to 1.
const TISSUE = [0.5, 0.3];
const STEEL = [1, 0.1];

// Light and highlight for a unit `normal` that is seen along `sight`, both in the frame of the eye.
const LIT = `
uniform vec2 gloss;
vec4 lit(vec3 normal, vec3 sight) {
    vec3 key = normalize(vec3(-0.42, 0.62, 0.8)), fill = normalize(vec3(0.9, -0.1, 0.4));
    vec3 sky = mix(vec3(0.24, 0.23, 0.24), vec3(0.42, 0.44, 0.48), 0.5 + 0.5 * normal.y);
    float wrapped = max((dot(normal, key) + gloss.y) / (1.0 + gloss.y), 0.0);
    vec3 light = sky + wrapped * vec3(0.74, 0.72, 0.69) + max(dot(normal, fill), 0.0) * vec3(0.10, 0.11, 0.13);
    float away = 1.0 - max(dot(normal, sight), 0.0), near = max(dot(normal, normalize(key + sight)), 0.0);
    near *= near; near *= near; near *= near; near *= near; near *= near * near;
    return vec4(light, gloss.x * (0.35 * near + 0.22 * away * away * away * away));
}
`;

// MOVES: between two frames of the surface.
const VERTEX = `
#ifdef MOVES
attribute vec3 next;
attribute vec3 nextNormal;
attribute vec4 colour;
uniform float blend;
#endif
varying vec4 vColour;
varying vec2 vUv;
varying vec3 vNormal;
varying vec3 vPlace;

void main() {
#ifdef MOVES
    vec3 place = mix(position, next, blend), direction = mix(normal, nextNormal, blend);
    vColour = colour;
    vUv = uv;
#else
    vec3 place = position, direction = normal;
    vColour = vec4(0.0);
    vUv = vec2(0.0);
#endif
    vec4 seen = modelViewMatrix * vec4(place, 1.0);
    vNormal = normalMatrix * direction;
    vPlace = seen.xyz;
    gl_Position = projectionMatrix * seen;
}
`;

const FRAGMENT = `
uniform vec3 surface;
uniform sampler2D picture;
uniform float painted;
uniform vec4 mark;
uniform float faded;
varying vec4 vColour;
varying vec2 vUv;
varying vec3 vNormal;
varying vec3 vPlace;
${LIT}
void main() {
    vec4 light = lit(normalize(gl_FrontFacing ? vNormal : -vNormal), normalize(-vPlace));
    vec3 seen = texture2D(picture, vUv).rgb;
    vec3 own = mix(vColour.rgb * vColour.rgb, surface * seen * seen, painted);
    own = mix(own, mark.rgb, mark.a * vColour.a);
    own = mix(own, vec3(0.35, 0.36, 0.38), faded);
    gl_FragColor = vec4(sqrt(clamp(own * light.rgb + light.a, 0.0, 1.0)), 1.0);
}
`;

// What tissue in contact turns to, linear, and how far: pale where it has its own colour, dark where colours mean something.
const PALE = [1, 0.86, 0.5, 0.75];
const DARK = [0.05, 0.05, 0.07, 0.35];
const STALE = 0.8; // how far an organ that is not up to date is grey

export class Shading {
    #white = new DataTexture(new Uint8Array([255, 255, 255, 255]), 1, 1);
    // All of the organ has them in common.
    #common = { blend: { value: 1 }, mark: { value: PALE }, faded: { value: 0 } };
    // Those of the organ's materials that have colours of their own: { uniforms, number of the picture that lacks }.
    #own = [];
    #textures = [];
    #isNatural = true;

    constructor() {
        this.#white.needsUpdate = true;
    }

    #material(gloss, surface, defines, uniforms) {
        const all = { gloss, surface, picture: this.#white, painted: 0, mark: PALE, faded: 0 };
        for (const [name, value] of Object.entries(all)) uniforms[name] ??= { value };
        return new ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, defines, uniforms });
    }

    // Of a thing in one colour: red, green and blue, linear, 0 to 1.
    solid(colour) {
        return this.#material(STEEL, colour, {}, { painted: { value: 1 } });
    }

    // Of an organ: one for each of its `materials` (of the contract).
    organ(materials) {
        this.#textures.splice(0).forEach((texture) => texture.dispose());
        this.#own = [];
        const all = materials.map(({ colour, picture }) => {
            const isOwn = colour.length === 3;
            const material = this.#material(TISSUE, isOwn ? colour : [1, 1, 1], { MOVES: 1 }, { ...this.#common });
            // What is somebody's own may be open.
            if (isOwn) material.side = DoubleSide;
            if (isOwn) this.#own.push({ uniforms: material.uniforms, lacks: picture });
            return material;
        });
        this.#paint();
        return all;
    }

    // The picture `number` of the organ's materials.
    setPicture(number, bitmap) {
        const texture = new Texture(bitmap);
        // (0, 0) is the upper left corner, as in the contract.
        texture.flipY = false;
        texture.wrapS = texture.wrapT = RepeatWrapping;
        texture.minFilter = LinearMipmapNearestFilter;
        texture.needsUpdate = true;
        this.#textures.push(texture);
        for (const own of this.#own.filter(({ lacks }) => lacks === number)) {
            own.uniforms.picture.value = texture;
            own.lacks = 0;
        }
        this.#paint();
    }

    // Whether the organ has its own colours, or others that mean something.
    setNatural(isNatural) {
        this.#isNatural = isNatural;
        this.#common.mark.value = isNatural ? PALE : DARK;
        this.#paint();
    }

    // Without its picture a material is tissue.
    #paint() {
        for (const { uniforms, lacks } of this.#own) uniforms.painted.value = this.#isNatural && lacks === 0 ? 1 : 0;
    }

    // How far between two frames, 0 to 1.
    setBlend(blend) {
        this.#common.blend.value = blend;
    }

    // Grey where nothing comes any more.
    setStale(isStale) {
        this.#common.faded.value = isStale ? STALE : 0;
    }
}
