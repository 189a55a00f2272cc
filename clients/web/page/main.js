// The page. Drawing alone happens here; socket, decoder and the loop of poses are in a worker.
//
// | module | is |
// |---|---|
// | start.js | what takes long to start |
// | worker.js | the socket, decoded frames to this page, poses and wishes to the gateway |
// | wire.js, surface.js | messages of the contract; frames to positions |
// | deformation.js | normals, strain, displacement, colours |
// | view.js, orbit.js, tools.js, obstacles.js | the picture, the camera around it, what tools and obstacles look like |
// | shading.js | light, colours, pictures on the organ |
// | hand.js | a tool moved by mouse or finger, in the worker; the place that they mean |
// | headset.js | a tool in each controller |
// | panel.js | buttons, plots, what is wrong |
//
// `globalThis.palpate` tells what was measured.

import { pick } from './hand.js';
import { Headset } from './headset.js';
import { Orbit } from './orbit.js';
import { Panel } from './panel.js';
import { context, drawsInSoftware, early, worker } from './start.js';
import { Vector2, Vector3 } from './vendor/three.min.js';
import { View } from './view.js';

// How deep the mouse presses, at first and at most [m].
const DEPTH = 0.012;
const DEEPEST = 0.04;
const HIGHEST = 0.05; // above the surface: jaws pull at what they hold
const NO_FRAMES = 1500; // after so long the picture is old [ms]
// What the server is told of the rate of poses of mouse and fingers [Hz]. Three times as many are sent: a browser that pauses
// for a tenth of a second has not let go.
const POSE_RATE = 30;
const TREMBLE = 80; // between two vibrations of a phone [ms]

const measured = (globalThis.palpate = { firstPicture: null, pictures: 0, frames: 0, decode: [], prepare: [], answers: [], draw: [] });
const keep = (list, value) => list.push(value) > 600 && list.shift();

let session = null;
let surface = null;
let limit = 3.3; // [N]
let colouring = 'material';
let newest = 0; // when the newest frame came
let link = { socket: 'connecting', server: null };
const own = new Map(); // tool number: the newest wrench of a tool that this page holds
const held = new Map(); // hand: 'asked', or the number of its tool

const panel = new Panel({
    colouring(name) {
        colouring = name;
        worker.postMessage({ colouring });
        panel.setLegend(colouring, surface?.largestDisplacement);
    },
    touch: (on) => (on ? take('mouse', panel.tool, POSE_RATE) : release('mouse')),
    tool: (name) => {
        if (!held.has('mouse')) return;
        release('mouse');
        take('mouse', name, POSE_RATE);
    },
    jaws: () => {
        mouse.jawsOpen = !mouse.jawsOpen;
        showJaws();
    },
    depth: (depth) => setDepth(depth),
    reset: () => worker.postMessage({ reset: true }),
    invite: (rights) => worker.postMessage({ invite: rights }),
    enter: (mode) => enter(mode),
});

let view = null;
try {
    if (!context) throw new Error('it may be switched off');
    view = new View(document.getElementById('view'), context, drawsInSoftware);
} catch (error) {
    panel.say('graphics', `this browser draws no WebGL 2: ${error.message}`);
    throw error;
}
const headset = new Headset(view);
const orbit = new Orbit(view.camera, view.renderer.domElement, (event) => press(event));
view.resized = () => orbit.update();
Headset.modes().then((modes) => panel.setModes(modes));

// ---- tools in hands ----

function take(hand, tool, rate) {
    if (held.has(hand)) return;
    held.set(hand, 'asked');
    if (hand === 'mouse') panel.setTouch('asked');
    worker.postMessage({ take: { hand, tool, rate } });
}

function release(hand) {
    if (!held.has(hand)) return;
    worker.postMessage({ release: { hand } });
    free(hand);
}

function free(hand) {
    own.delete(held.get(hand));
    held.delete(hand);
    if (hand === 'mouse') {
        mouse.finger = mouse.press = null;
        mouse.jawsOpen = false;
        panel.setTouch('off');
        showJaws();
    }
}

// The button is there while the mouse's tool has jaws.
function showJaws() {
    const tool = session?.tools.find(({ tool }) => tool === held.get('mouse'));
    panel.setJaws(tool?.parts.some(({ hinge }) => hinge) ? (mouse.jawsOpen ? 'open' : 'closed') : 'none');
}

// The mouse's or a finger's tool; `press`: { point, normal, depth } on the surface as it was when the press began.
const mouse = { press: null, surface: null, finger: null, depth: DEPTH, jawsOpen: false };

function setDepth(depth) {
    mouse.depth = Math.min(Math.max(depth, -HIGHEST), DEEPEST);
    if (mouse.press) mouse.press.depth = mouse.depth;
    panel.setDepth(mouse.depth);
}

function target(event) {
    const at = new Vector2((2 * event.clientX) / innerWidth - 1, 1 - (2 * event.clientY) / innerHeight);
    const origin = new Vector3().setFromMatrixPosition(view.camera.matrixWorld);
    const through = new Vector3(at.x, at.y, 0.5).unproject(view.camera);
    return pick(origin.toArray(), through.sub(origin).normalize().toArray(), mouse.surface);
}

// True where a press begins on the organ while the mouse holds a tool.
function press(event) {
    if (!Number.isInteger(held.get('mouse')) || mouse.finger !== null || event.button !== 0 || orbit.fingers.size > 0 || !view.organ?.visible) return false;
    mouse.surface = view.surface;
    const place = target(event);
    if (!place) return false;
    mouse.finger = event.pointerId;
    mouse.press = { ...place, depth: mouse.depth };
    event.target.setPointerCapture(event.pointerId);
    return true;
}

const canvas = view.renderer.domElement;
canvas.addEventListener('pointermove', (event) => {
    if (event.pointerId !== mouse.finger) return;
    const place = target(event);
    if (place) mouse.press = { ...place, depth: mouse.depth };
});
for (const end of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(end, (event) => {
        if (event.pointerId === mouse.finger) [mouse.finger, mouse.press] = [null, null];
    });
}
canvas.addEventListener('wheel', (event) => {
    event.preventDefault();
    if (mouse.press) setDepth(mouse.depth - Math.sign(event.deltaY) * 0.001);
    else orbit.nearer(Math.exp(-event.deltaY * 0.001));
}, { passive: false });

// ---- the headset ----

async function enter(mode) {
    release('mouse');
    try {
        await headset.enter(mode, () => ['left', 'right'].forEach(release));
    } catch (error) {
        panel.mention('request', `the headset does not start: ${error.message}`);
    }
}

function moveControllers(frame) {
    if (!surface || !session) return;
    const poses = headset.poses(frame, surface.bounds);
    for (const pose of poses) {
        if (!held.has(pose.hand) && performance.now() > (retry.get(pose.hand) ?? 0)) {
            retry.set(pose.hand, performance.now() + 2000);
            const taken = [...held.values()];
            const tools = session.tools.filter(({ tool, taken: other }) => !other && !taken.includes(tool));
            // The first free one; both hands may ask at once, and the server says who has it.
            if (tools.length > 0 && document.body.dataset.rights === 'operator') take(pose.hand, '', headset.rate);
        }
        worker.postMessage({ pose });
    }
    for (const hand of ['left', 'right']) {
        if (held.has(hand) && !poses.some((pose) => pose.hand === hand)) release(hand);
    }
}
const retry = new Map();

// ---- what the worker says ----

const heard = {
    socket({ rights, fault }) {
        if (rights) panel.setRights(rights);
        link.socket = rights ? null : {
            expired: 'Your access has ended. Open a fresh address of palpate web.',
            gone: 'palpate web does not answer. Trying again…',
            closed: 'The connection to palpate web broke. Trying again…',
        }[fault] ?? `The connection ended: ${fault}. Trying again…`;
        panel.say('socket', link.socket);
    },
    notice(notice) {
        if (notice.link) {
            link.server = notice.link.fault;
            panel.say('link', link.server && `No server: ${link.server}. Trying again…`);
        } else if (notice.invitation) {
            panel.setAddress(new URL(notice.invitation.path, location.href).href, notice.invitation.rights);
        } else if (notice.refused) {
            panel.mention('request', `Refused: ${notice.refused.fault}.`);
        }
    },
    session(now) {
        const things = (of) => JSON.stringify([of?.tools.map((tool) => ({ ...tool, taken: 0 })), of?.obstacles]);
        const changed = things(now) !== things(session);
        session = now;
        limit = session.limits?.force || limit;
        panel.setSession(session, session.body?.levels);
        if (changed && surface) view.setThings(session, limit);
    },
    surface(now) {
        surface = now;
        view.setSurface(surface);
        view.setThings(session ?? { tools: [], obstacles: [] }, limit);
        panel.setLegend(colouring, surface.largestDisplacement);
        orbit.fit(surface.bounds);
        new Set(surface.materials.map(({ picture }) => picture)).forEach((number) => number > 0 && paint(surface, number));
    },
    frame(frame) {
        const now = performance.now();
        const buffers = view.setFrame(frame, now);
        if (buffers) worker.postMessage({ buffers }, Object.values(buffers).map(({ buffer }) => buffer));
        newest = now;
        measured.frames += 1;
        keep(measured.decode, frame.times.decode);
        keep(measured.prepare, frame.times.prepare);
        for (const { tool, force } of frame.tools) panel.force.add(tool, now / 1000, Math.hypot(...force));
    },
    colours: (colours) => view.setColours(colours),
    status: (status) => panel.setStatus(status),
    wrench(wrench) {
        own.set(wrench.tool, wrench);
        const newtons = Math.hypot(...wrench.force);
        if (wrench.answer !== null) keep(measured.answers, wrench.answer);
        if (headset.isOn) shaken.set(wrench.hand, newtons);
        else tremble(newtons);
    },
    taken({ hand, tool }) {
        if (held.get(hand) !== 'asked') return;
        held.set(hand, tool);
        panel.say('tool', null);
        if (hand !== 'mouse') return;
        panel.setTouch('on');
        showJaws();
    },
    free({ hand, fault }) {
        if (!fault) return;
        free(hand);
        panel.mention('tool', `No tool: ${fault}.`);
    },
    fault: (fault) => panel.mention('request', fault),
};
const hear = ({ data }) => {
    const [[what, content]] = Object.entries(data);
    heard[what](content);
};
worker.onmessage = hear;
early.splice(0).forEach(hear);
worker.onerror = (event) => panel.say('socket', `The page is broken: ${event.message ?? 'its worker did not start'}.`);

// Gets the picture `number` of the materials of `of`, made as small as the graphics card needs it.
async function paint(of, number) {
    try {
        const answer = await fetch(`picture/${of.topology}/${number}`);
        if (!answer.ok) throw new Error(await answer.text());
        const bitmap = await small(await createImageBitmap(await answer.blob()), view.largestPicture);
        if (of === surface) view.shading.setPicture(number, bitmap);
    } catch (error) {
        panel.mention('request', `A picture on the organ is missing: ${error.message}`);
    }
}

async function small(bitmap, largest) {
    const scale = largest / Math.max(bitmap.width, bitmap.height);
    if (scale >= 1) return bitmap;
    const [resizeWidth, resizeHeight] = [bitmap.width, bitmap.height].map((side) => Math.max(1, Math.floor(scale * side)));
    return createImageBitmap(bitmap, { resizeWidth, resizeHeight, resizeQuality: 'high' });
}

const shaken = new Map(); // hand: newtons of its newest wrench
let trembled = 0;

// A phone trembles as long as the force of a finger's tool stands.
function tremble(newtons) {
    const now = performance.now();
    if (newtons < 0.05 || now - trembled < TREMBLE || mouse.finger === null) return;
    trembled = now;
    navigator.vibrate?.(Math.round(4 + 26 * Math.min(newtons / limit, 1)));
}

// ---- the loop ----

let last = performance.now();
let rates = { at: last, pictures: 0, frames: 0 };

view.renderer.setAnimationLoop((_, frame) => {
    const now = performance.now();
    if (!view.isDue(now - last)) return;
    view.adapt(now - last, now);
    last = now;
    if (headset.isOn && frame) {
        moveControllers(frame);
        for (const [hand, newtons] of shaken) headset.shake(hand, newtons, limit);
        shaken.clear();
    } else {
        worker.postMessage({ press: mouse.press, jawsOpen: mouse.jawsOpen });
    }
    view.shading.setStale(now - newest > NO_FRAMES);
    view.draw(now, own);
    keep(measured.draw, performance.now() - now);
    panel.draw(now);
    measured.pictures += 1;
    if (measured.firstPicture === null && view.organ?.visible) measured.firstPicture = now;
    if (now - rates.at > 1000) {
        const seconds = (now - rates.at) / 1000;
        const answer = measured.answers.length > 0 && own.size > 0 ? measured.answers.at(-1) : null;
        panel.setRates((measured.pictures - rates.pictures) / seconds, (measured.frames - rates.frames) / seconds, answer);
        rates = { at: now, pictures: measured.pictures, frames: measured.frames };
    }
});

// Nobody sees the page: poses stop, and the tool goes to others.
document.addEventListener('visibilitychange', () => {
    if (document.hidden && !headset.isOn) release('mouse');
});
addEventListener('keydown', ({ key, target: { tagName } }) => {
    if (tagName === 'INPUT' || tagName === 'SELECT') return;
    if (key === 't') document.getElementById('touch').click();
    if (key === 'g') document.getElementById('jaws').click();
    if ('1234'.includes(key)) document.querySelectorAll('[data-colouring]')[key - 1].click();
});
setDepth(DEPTH);
