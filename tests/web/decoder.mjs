// Reads the vectors in the folder that is given, and writes messages of the page into it: see decoder.rs.

import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { Deformation } from '../../clients/web/page/deformation.js';
import { Hand, pick } from '../../clients/web/page/hand.js';
// All that they take from three.js is there.
import '../../clients/web/page/headset.js';
import '../../clients/web/page/orbit.js';
import '../../clients/web/page/view.js';
import { Shading } from '../../clients/web/page/shading.js';
import { Decoder, Surface } from '../../clients/web/page/surface.js';
import * as wire from '../../clients/web/page/wire.js';

const folder = process.argv[2];
const read = (name) => new Uint8Array(readFileSync(join(folder, name)));
const part = (name) => wire.decode(read(name), wire.FRAME);

for (const { name, topology, frames } of JSON.parse(readFileSync(join(folder, 'index.json'), 'utf8'))) {
    const surface = new Surface([...topology].reverse().map(read));
    assert.equal(surface.organs[0].name, 'sheet ä');
    for (let v = 0; v < surface.vertices; v++) {
        assert.deepEqual([...surface.uvs.subarray(2 * v, 2 * v + 2)], [...surface.rest.subarray(3 * v, 3 * v + 2)]);
    }
    assert.deepEqual(surface.normals.subarray(-3), Float32Array.of(0, 0.6, 0.8));
    const [skin, vessel, tissue] = surface.materials;
    assert.deepEqual([skin.colour, skin.picture, vessel.picture, tissue.colour], [[1, 0.5, 0.25], 3, 0, []]);
    assert.equal(3 * (skin.triangles + vessel.triangles + tissue.triangles), surface.triangles.length);
    const positions = new Float32Array(3 * surface.vertices), times = [];
    // Without its key frame a frame is nothing.
    assert.equal(new Decoder(surface).take(part(frames[5].parts[0]), positions), null);
    for (let round = 0; round < 10; round++) {
        const decoder = new Decoder(surface);
        for (const frame of frames) {
            let whole = null;
            // In any order.
            const parts = [...frame.parts].reverse().map(read), began = performance.now();
            for (const bytes of parts) {
                whole = decoder.take(wire.decode(bytes, wire.FRAME), positions);
            }
            times.push(performance.now() - began);
            assert.equal(whole.tick, frame.tick);
            assert.deepEqual(whole.tools[0].force, [0, 0, 2.5]);
            assert.deepEqual(whole.obstacles, [{ position: [0, 0.125, -0.5], force: [0, 0, -1.5] }]);
            assert.deepEqual(new Uint8Array(positions.buffer), read(frame.positions));
            assert.deepEqual(decoder.levels, read(frame.levels));
        }
    }
    const steady = times.slice(frames.length).sort((a, b) => a - b);
    console.log(`${name}: ${surface.vertices} vertices, p50 ${steady[steady.length >> 1].toFixed(2)} ms, p95 ${steady[Math.floor(steady.length * 0.95)].toFixed(2)} ms`);
}

// Bytes that are no frame are refused, and what comes after is read.
{
    const [{ topology, frames }] = JSON.parse(readFileSync(join(folder, 'index.json'), 'utf8'));
    const surface = new Surface(topology.map(read)), decoder = new Decoder(surface);
    const positions = new Float32Array(3 * surface.vertices);
    let state = 1, refused = 0;
    const random = (below) => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) % below;
    for (let i = 0; i < 2000; i++) {
        const bytes = read(frames[random(frames.length)].parts[0]);
        for (let changes = 1 + random(4); changes > 0; changes--) bytes[random(Math.min(bytes.length, 200))] = random(256);
        try {
            decoder.take(wire.decode(bytes.subarray(0, 1 + random(bytes.length)), wire.FRAME), positions);
            decoder.levels;
        } catch {
            refused += 1;
        }
    }
    assert.ok(refused > 1000, `${refused} refused`);
    const fresh = new Decoder(surface);
    fresh.take(part(frames[0].parts[1]), positions);
    assert.ok(fresh.take(part(frames[0].parts[0]), positions));
}

// Strain and normals, as the viewer has them.
{
    const tetrahedron = {
        vertices: 4,
        organs: [],
        normals: new Float32Array(0),
        uvs: new Float32Array(0),
        triangles: Uint32Array.of(0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3),
        rest: Float32Array.of(0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1),
    };
    const deformation = new Deformation(tetrahedron), near = (a, b) => Math.abs(a - b) < 1e-5;
    for (const factor of [1.2, 0.7]) {
        assert.ok(deformation.strain(tetrahedron.rest.map((x) => factor * x)).every((s) => near(s, Math.abs(factor - 1))));
    }
    const turned = tetrahedron.rest.map((_, i, x) => [3 - x[i + 1], x[i - 1], x[i]][i % 3]);
    assert.ok(deformation.strain(turned).every((s) => s < 1e-5));
    assert.ok(near(deformation.displacement(turned)[0], 3));
    const normals = new Float32Array(12);
    deformation.normals(tetrahedron.rest, normals);
    for (let v = 0; v < 12; v += 3) {
        const [n, x] = [normals, tetrahedron.rest].map((of) => [...of.subarray(v, v + 3)]);
        assert.ok(near(Math.hypot(...n), 1) && n.reduce((sum, c, i) => sum + c * (x[i] - 0.25), 0) > 0);
    }
}

// A material shows its colour or its picture as soon as that is there, and none where colours mean something.
{
    const shading = new Shading(), painted = (materials) => materials.map(({ uniforms }) => uniforms.painted.value);
    const materials = shading.organ([{ colour: [1, 1, 1], picture: 2 }, { colour: [1, 0, 0], picture: 0 }, { colour: [], picture: 0 }]);
    assert.deepEqual(painted(materials), [0, 1, 0]);
    shading.setPicture(1, {});
    assert.deepEqual(painted(materials), [0, 1, 0]);
    shading.setPicture(2, { width: 1, height: 1 });
    assert.deepEqual(painted(materials), [1, 1, 0]);
    assert.equal(materials[0].uniforms.picture.value.flipY, false);
    shading.setNatural(false);
    assert.deepEqual(painted(materials), [0, 0, 0]);
    shading.setNatural(true);
    assert.deepEqual(painted(materials), [1, 1, 0]);
}

// Own normals turn with the surface, and a seam of texture coordinates is smooth.
{
    // A quadrangle of two triangles, whose shared edge stands twice.
    const sheet = {
        vertices: 6,
        organs: [],
        triangles: Uint32Array.of(0, 1, 2, 3, 5, 4),
        rest: Float32Array.of(0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0),
        normals: new Float32Array(0),
        uvs: new Float32Array(12),
    };
    const folded = sheet.rest.slice(), normals = new Float32Array(18), at = (v) => [...normals.subarray(3 * v, 3 * v + 3)];
    folded[17] = 1;
    new Deformation(sheet).normals(folded, normals);
    assert.deepEqual([at(1), at(2)], [at(3), at(4)]);
    assert.ok(at(0)[2] > 0.99 && at(1)[2] < 0.99);
    // They lean by as much as they did, about the axis that the triangles turn about: here x, by a right angle.
    sheet.normals = Float32Array.from({ length: 18 }, (_, i) => [0.6, 0, 0.8][i % 3]);
    const upright = sheet.rest.map((_, i, x) => [x[i], -x[i + 1], x[i - 1]][i % 3]);
    new Deformation(sheet).normals(upright, normals);
    for (let v = 0; v < 6; v++) assert.ok(at(v).every((x, i) => Math.abs(x - [0.6, -0.8, 0][i]) < 1e-5), at(v).join());
}

// A press goes around the body and then in along the normal, no faster than a hand.
{
    const ball = 0.1, dt = 1e-3, hand = new Hand([0, 0, 0], ball, 0.01);
    const far = (a, b = [0, 0, 0]) => Math.hypot(...a.map((x, i) => x - b[i]));
    for (const direction of [[1, 0.2, 0.1], [0, 0, -1], [0, 1, 1], [0, -1, -1]]) {
        const normal = direction.map((x) => x / far(direction));
        const press = { point: normal.map((x) => ball * x), normal, depth: 0.02 };
        let closest = Infinity;
        for (let i = 0; i < 3000; i++) {
            const before = hand.position;
            hand.step(press, dt);
            assert.ok(far(hand.position, before) < 0.6 * dt * 1.01);
            const along = hand.position.reduce((sum, x, i) => sum + x * normal[i], 0);
            if (along < 0.99 * far(hand.position)) closest = Math.min(closest, far(hand.position));
        }
        assert.ok(closest > ball + 0.01, `it went through the body: ${closest}`);
        assert.ok(Math.abs(far(hand.position) - (ball + 0.01 - 0.02)) < 1e-5);
        const [x, y, z, w] = hand.orientation;
        assert.ok(far([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], normal) < 0.05, 'its +z points out');
        for (let i = 0; i < 1000; i++) hand.step(null, dt);
        assert.ok(Math.abs(far(hand.position) - (ball + 0.01 + 0.015)) < 1e-5, 'let go, it hovers');
    }
    for (const [open, end] of [[true, 1], [false, 0]]) {
        for (let i = 0; i < 450; i++) hand.moveJaws(open, dt);
        assert.ok(Math.abs(hand.opening - end) > 0.05);
        for (let i = 0; i < 60; i++) hand.moveJaws(open, dt);
        assert.equal(hand.opening, end);
    }
    const corner = {
        triangles: Uint32Array.of(0, 1, 2),
        positions: Float32Array.of(0, 0, 1, 1, 0, 1, 0, 1, 1),
        normals: Float32Array.of(0, 0, 1, 0, 0, 1, 0, 0, 1),
    };
    const found = pick([0.2, 0.3, 5], [0, 0, -1], corner);
    assert.ok(far(found.point, [0.2, 0.3, 1]) < 1e-6 && found.normal[2] === 1);
    assert.equal(pick([0.8, 0.9, 5], [0, 0, -1], corner), null);
    assert.equal(pick([0.2, 0.3, 0], [0, 0, 1], corner), null, 'from inside');
}

const write = (name, bytes) => writeFileSync(join(folder, name), bytes);
const [position, orientation] = [[0.25, -0.5, 1e-3], [0, 0.6, 0, 0.8]];
write('pose', wire.pose(3, { epoch: 4_000_000_000, sequence: 70_000, time: 2 ** 50, position, orientation, buttons: 3, opening: 0.25 }));
write('attach', wire.attach('left hand', 'ball ä', 90));
write('detach', wire.detach(3, 4_000_000_000));
write('reset', wire.reset());
