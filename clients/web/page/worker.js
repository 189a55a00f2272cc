// The socket, the decoder and the loop of poses, where no drawing holds them up.
//
// From the page: { colouring }, { take: { hand, tool, rate } }, { release: { hand } }, { pose: { hand, position, orientation,
// buttons, opening } }, { press: { point, normal, depth } or null, jawsOpen } with every picture, { reset }, { invite: rights }, { buffers }. To the page: { socket }, { notice }, { session }, { surface },
// { frame }, { status }, { wrench }, { taken: { hand, … } }, { free: { hand, fault } }, { fault }.

import { Deformation } from './deformation.js';
import { Hand } from './hand.js';
import { Decoder, Surface } from './surface.js';
import * as wire from './wire.js';

// Between two poses of a hand that holds still [ms].
const REPEAT = 11;
// A controller's pose that the page has not confirmed for so long is sent no more [ms]: the server lets go.
const STALE = 250;
// The mouse lets go where the page has drawn nothing for so long, and sends no more poses some time later [ms].
const ASLEEP = 1000;
const AWAY = 3000;
// Bytes that may wait in the socket before a pose is left out: some ten poses. The next one is newer.
const MOST_WAITING = 1024;
// Phase of a tool that gives no force before it has been outside the body: the mouse goes out by itself.
const WAITING = 1;
// Between two attempts to connect [ms].
const RETRY = [250, 500, 1000, 2000];

let socket = null;
let attempts = 0;
let incoming = { number: null, parts: [] }; // parts of a topology that is on its way
let decoder = null;
let deformation = null;
let session = null;
let colouring = 'material';
let lastFrame = null; // { positions, touching } to colour again
const spare = []; // buffers that the page has drawn from
const hands = new Map(); // hand: { tool, epoch, sequence, pose, at, sent, moved }; `moved`: a Hand, of the mouse
let press = null, jawsOpen = false; // what the mouse wants
let drawn = 0; // when the page said so
let asked = []; // what control requests were for, in their order

function connect() {
    const address = new URL('socket', self.location.href);
    address.protocol = address.protocol === 'https:' ? 'wss:' : 'ws:';
    socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    socket.onopen = () => (attempts = 0);
    incoming = { number: null, parts: [] };
    socket.onmessage = ({ data }) => {
        try {
            if (typeof data === 'string') notice(JSON.parse(data));
            else message(new Uint8Array(data));
        } catch (error) {
            postMessage({ fault: `a message could not be read: ${error.message}` });
        }
    };
    socket.onclose = async ({ reason }) => {
        [...hands.keys()].forEach((hand) => lose(hand, 'the connection was lost'));
        asked = [];
        // A refused socket does not say why.
        const known = await fetch('who').then(({ status }) => status !== 403, () => null);
        const fault = known === false ? 'expired' : known === null ? 'gone' : reason || 'closed';
        postMessage({ socket: { fault } });
        setTimeout(connect, RETRY[Math.min(attempts++, RETRY.length - 1)]);
    };
}

function notice(notice) {
    if (notice.lost) {
        for (const [hand, held] of hands) {
            if (held.tool === notice.lost.tool) lose(hand, notice.lost.fault);
        }
    } else if (notice.welcome) {
        postMessage({ socket: { rights: notice.welcome.rights } });
    } else {
        postMessage({ notice });
    }
}

function lose(hand, fault) {
    hands.delete(hand);
    postMessage({ free: { hand, fault } });
}

function message(bytes) {
    const content = bytes.subarray(1);
    switch (bytes[0]) {
        case wire.FROM_GATEWAY.session:
            session = wire.decode(content, wire.SESSION);
            postMessage({ session });
            break;
        case wire.FROM_GATEWAY.topology:
            takeTopology(content);
            break;
        case wire.FROM_GATEWAY.frame:
            if (decoder) takeFrame(content);
            break;
        case wire.FROM_GATEWAY.status:
            if (content.length > 0) postMessage({ status: wire.decode(content, wire.STATUS) });
            break;
        case wire.FROM_GATEWAY.wrench:
            takeWrench(wire.decode(content, wire.WRENCH));
            break;
        case wire.FROM_GATEWAY.reply:
            takeReply(wire.decode(content, wire.REPLY));
            break;
    }
}

function takeTopology(content) {
    const { topology, parts } = wire.decode(content, wire.TOPOLOGY);
    if (incoming.number !== topology) incoming = { number: topology, parts: [] };
    incoming.parts.push(content.slice());
    if (incoming.parts.length < parts) return;
    const surface = new Surface(incoming.parts);
    incoming = { number: null, parts: [] };
    decoder = new Decoder(surface);
    deformation = new Deformation(surface);
    lastFrame = null;
    spare.length = 0;
    const { triangles, vertices, uvs, materials } = surface, { bounds, size, largestDisplacement } = deformation;
    postMessage({ surface: { topology, triangles, vertices, uvs, materials, bounds, size, largestDisplacement } });
}

function buffers() {
    const n = 3 * decoder.surface.vertices;
    return spare.pop() ?? { positions: new Float32Array(n), normals: new Float32Array(n), colours: new Uint8Array((4 * n) / 3) };
}

function takeFrame(content) {
    const began = performance.now();
    const message = wire.decode(content, wire.FRAME);
    // Also of a frame that cannot be shown: what follows would wait for it.
    socket.send(wire.seen(message.sequence));
    const { positions, normals, colours } = buffers();
    const frame = decoder.take(message, positions);
    const decoded = performance.now();
    if (!frame) {
        spare.push({ positions, normals, colours });
        return;
    }
    deformation.normals(positions, normals);
    const touching = frame.tools.map(touch).filter(Boolean);
    lastFrame = { positions: positions.slice(), touching };
    deformation.colours(colouring, positions, decoder, touching, colours);
    const times = { decode: decoded - began, prepare: performance.now() - decoded };
    postMessage({ frame: { ...frame, colouring, positions, normals, colours, times } }, [positions.buffer, normals.buffer, colours.buffer]);
}

// The part of a tool that touches, where it feels something.
function touch({ position, orientation, force, ...state }) {
    const shape = session?.tools.find((known) => known.tool === wire.shapeOf(state));
    // The radius of a shape of other parts is that of a ball around all of it.
    if (!shape || shape.parts.length > 1 || !force || Math.hypot(...force) < 1e-4) return null;
    const [x, y, z, w] = orientation;
    // The tool's own +z.
    const axis = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)];
    return { position, axis, length: shape.length, radius: shape.radius };
}

function takeWrench(wrench) {
    for (const [hand, held] of hands) {
        if (held.tool !== wrench.tool || held.epoch !== wrench.epoch) continue;
        held.isInside = wrench.phase === WAITING;
        // Times of other poses than the newest are as good: each is from this clock.
        const answer = wrench.poseTime > 0 ? performance.now() - wrench.poseTime / 1e6 : null;
        postMessage({ wrench: { hand, answer, ...wrench } });
    }
}

function takeReply({ error, attached }) {
    const request = asked.shift();
    if (request?.take) {
        const { hand } = request.take;
        if (!attached || !deformation) return postMessage({ free: { hand, fault: error || 'the server gave no tool' } });
        if (request.off) return send(wire.detach(attached.tool, attached.epoch), {});
        const moved = hand === 'mouse' ? besideBody(attached.tool) : null;
        hands.set(hand, { ...attached, sequence: 0, pose: null, at: 0, sent: 0, moved });
        postMessage({ taken: { hand, tool: attached.tool } });
    } else if (error) {
        postMessage({ fault: error });
    }
}

// The mouse's hand with the tool of this number, above the body.
function besideBody(tool) {
    const { bounds, size } = deformation, radius = session?.tools.find((known) => known.tool === tool)?.radius ?? 0.01;
    return new Hand([0, 1, 2].map((i) => (bounds[i] + bounds[3 + i]) / 2), size / 2, radius);
}

const isOpen = () => socket?.readyState === WebSocket.OPEN;

function send(bytes, request) {
    if (!isOpen()) return false;
    asked.push(request);
    socket.send(bytes);
    return true;
}

// Sends the newest pose of a hand, unless earlier ones still wait to leave.
function sendPose(held, now) {
    if (!isOpen() || socket.bufferedAmount > MOST_WAITING) return;
    held.sequence += 1;
    held.sent = now;
    const { tool, epoch, sequence, pose } = held;
    socket.send(wire.pose(tool, { epoch, sequence, time: Math.round(now * 1e6), ...pose }));
}

let looked = performance.now();

setInterval(() => {
    const now = performance.now(), dt = Math.min((now - looked) / 1000, 0.05);
    looked = now;
    for (const held of hands.values()) {
        if (held.moved && now - drawn < AWAY) {
            held.moved.step(now - drawn < ASLEEP && !held.isInside ? press : null, dt);
            held.moved.moveJaws(jawsOpen, dt);
            const { position, orientation, opening } = held.moved;
            held.pose = { position, orientation, buttons: 0, opening };
            sendPose(held, now);
        } else if (held.pose && now - held.at < STALE && now - held.sent >= REPEAT - 1) {
            sendPose(held, now);
        }
    }
}, REPEAT);

self.onmessage = ({ data }) => {
    const now = performance.now();
    if (data.pose) {
        const held = hands.get(data.pose.hand);
        if (!held) return;
        [held.pose, held.at] = [data.pose, now];
        // Two poses in one display frame are one.
        if (now - held.sent > 4) sendPose(held, now);
    } else if (data.press !== undefined) {
        [press, jawsOpen, drawn] = [data.press, data.jawsOpen, now];
    } else if (data.buffers) {
        if (data.buffers.positions.length === 3 * decoder?.surface.vertices && spare.length < 4) spare.push(data.buffers);
    } else if (data.take) {
        const { hand, tool, rate } = data.take;
        const sent = send(wire.attach(hand, tool, rate), { take: data.take });
        if (!sent) postMessage({ free: { hand, fault: 'there is no connection' } });
    } else if (data.release) {
        const { hand } = data.release, held = hands.get(hand);
        asked.forEach((request) => (request.off ||= request.take?.hand === hand));
        if (!held) return;
        hands.delete(hand);
        send(wire.detach(held.tool, held.epoch), {});
        postMessage({ free: { hand, fault: null } });
    } else if (data.colouring) {
        colouring = data.colouring;
        if (!lastFrame) return;
        const { colours } = buffers(), { positions, touching } = lastFrame;
        deformation.colours(colouring, positions, decoder, touching, colours);
        postMessage({ colours: { colouring, colours } });
    } else if (data.reset) {
        send(wire.reset(), {});
    } else if (data.invite && isOpen()) {
        socket.send(JSON.stringify({ invite: { rights: data.invite } }));
    }
};

connect();
