// Messages of the contract (proto/palpate.proto) and the kinds of bytes on the WebSocket (src/message.rs).
// Of each message only the fields that the page uses.

export const FROM_GATEWAY = { session: 1, topology: 2, frame: 3, status: 4, wrench: 5, reply: 6 };
const TO_GATEWAY = { control: 1, pose: 2, seen: 3 };

// Field number: [name, type, repeated]. A type is a word below or the fields of a message.
const ORGAN = { 1: ['name', 'string'], 2: ['vertices', 'varint'], 3: ['triangles', 'varint'] };
const HINGE = { 1: ['axis', 'double', true], 2: ['point', 'double', true], 3: ['closed', 'double'], 4: ['open', 'double'] };
const PART = { 1: ['corners', 'double', true], 2: ['rounding', 'double'], 3: ['disc', 'double'], 4: ['axis', 'double', true], 5: ['hinge', HINGE] };
const TOOL = {
    1: ['tool', 'varint'], 2: ['name', 'string'], 3: ['shape', 'string'], 4: ['radius', 'double'], 5: ['length', 'double'],
    6: ['taken', 'varint'], 7: ['parts', PART, true],
};
const OBSTACLE = {
    1: ['name', 'string'], 2: ['parts', PART, true], 3: ['position', 'double', true], 4: ['orientation', 'double', true],
};
const BODY = { 1: ['name', 'string'], 2: ['levels', 'varint'], 10: ['bounds', 'double', true], 12: ['organs', ORGAN, true] };
const LIMITS = { 1: ['force', 'double'], 4: ['toolSpeed', 'double'], 5: ['workspace', 'double', true] };
export const SESSION = {
    1: ['versionMajor', 'varint'], 2: ['versionMinor', 'varint'], 3: ['name', 'string'], 6: ['ticksPerFrame', 'varint'],
    7: ['body', BODY], 8: ['tools', TOOL, true], 9: ['limits', LIMITS],
    13: ['obstacles', OBSTACLE, true],
};
const MATERIAL = { 1: ['name', 'string'], 2: ['triangles', 'varint'], 3: ['colour', 'float', true], 4: ['picture', 'varint'] };
export const TOPOLOGY = {
    1: ['topology', 'varint'], 2: ['vertices', 'varint'], 3: ['triangles', 'bytes'], 4: ['restPositions', 'bytes'],
    5: ['part', 'varint'], 6: ['parts', 'varint'], 7: ['step', 'double'], 8: ['organs', ORGAN, true],
    9: ['normals', 'bytes'], 10: ['uvs', 'bytes'], 11: ['materials', MATERIAL, true],
};
const TOOL_STATE = {
    1: ['tool', 'varint'], 2: ['position', 'float', true], 3: ['orientation', 'float', true], 4: ['force', 'float', true],
    5: ['phase', 'varint'], 6: ['opening', 'float'], 7: ['shape', 'varint'],
};
const OBSTACLE_STATE = { 1: ['position', 'float', true], 2: ['force', 'float', true] };
export const FRAME = {
    1: ['topology', 'varint'], 2: ['tick', 'varint'], 3: ['sequence', 'varint'], 5: ['tools', TOOL_STATE, true],
    6: ['key', 'varint'], 7: ['part', 'varint'], 8: ['displacements', 'bytes'], 9: ['levels', 'bytes'],
    10: ['obstacles', OBSTACLE_STATE, true],
};
const DISTRIBUTION = { 1: ['p50', 'double'], 2: ['p99', 'double'], 4: ['max', 'double'] };
export const STATUS = {
    1: ['tick', 'varint'], 2: ['tickRate', 'double'], 3: ['lateness', DISTRIBUTION], 4: ['compute', DISTRIBUTION],
    11: ['nodes', 'varint'], 12: ['elements', 'varint'], 21: ['clients', 'string', true], 22: ['activeNodes', 'varint', true],
};
export const WRENCH = {
    1: ['tool', 'fixed32'], 2: ['epoch', 'fixed32'], 4: ['tick', 'fixed64'], 5: ['poseSequence', 'fixed32'],
    6: ['poseTime', 'fixed64'], 8: ['position', 'float', true], 9: ['orientation', 'float', true],
    12: ['force', 'float', true], 14: ['contactPoints', 'varint'], 15: ['phase', 'varint'], 16: ['flags', 'varint'],
    22: ['opening', 'float'],
};
export const REPLY = { 1: ['error', 'string'], 2: ['attached', { 1: ['tool', 'varint'], 2: ['epoch', 'varint'] }] };

// Number of the tool whose shape a tool of this state has.
export const shapeOf = ({ tool, shape }) => (shape > 0 ? shape - 1 : tool);

const text = new TextDecoder();
// Value of a field that is not there.
const ABSENT = { string: '', bytes: new Uint8Array(0) };
const FIXED = {
    fixed32: [4, (view, at) => view.getUint32(at, true)],
    fixed64: [8, (view, at) => Number(view.getBigUint64(at, true))],
    float: [4, (view, at) => view.getFloat32(at, true)],
    double: [8, (view, at) => view.getFloat64(at, true)],
};

// The message in `bytes` by its `fields`; throws where the bytes are none. Whole numbers are exact below 2⁵³.
export function decode(bytes, fields) {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const message = {};
    for (const [name, type, repeated] of Object.values(fields)) {
        message[name] = repeated ? [] : typeof type === 'object' ? null : ABSENT[type] ?? 0;
    }
    let at = 0;
    const varint = () => {
        for (let value = 0, scale = 1; scale < 2 ** 70; scale *= 128) {
            const byte = view.getUint8(at++);
            value += (byte & 127) * scale;
            if (byte < 128) return value;
        }
        throw new RangeError('a number without end');
    };
    while (at < bytes.length) {
        const tag = varint(), wire = tag % 8, [name, type, repeated] = fields[Math.floor(tag / 8)] ?? [];
        const put = (value) => (repeated ? message[name].push(value) : (message[name] = value));
        if (wire === 0) {
            const value = varint();
            if (type === 'varint') put(value);
        } else if (wire === 2) {
            const size = varint(), from = at;
            if (from + size > bytes.length) throw new RangeError('a message is cut off');
            at = from + size;
            if (type === undefined) continue;
            const content = bytes.subarray(from, at);
            if (type === 'string') put(text.decode(content));
            else if (type === 'bytes') put(content);
            else if (typeof type === 'object') put(decode(content, type));
            else if (repeated) unpack(content, type, message[name]);
        } else if (wire === 5 || wire === 1) {
            const from = at;
            at += wire === 5 ? 4 : 8;
            if (at > bytes.length) throw new RangeError('a message is cut off');
            if (FIXED[type]?.[0] === at - from) put(FIXED[type][1](view, from));
        } else {
            throw new RangeError(`there is no wire type ${wire}`);
        }
    }
    return message;
}

// Numbers of a packed field.
function unpack(content, type, into) {
    const view = new DataView(content.buffer, content.byteOffset, content.byteLength);
    if (type === 'varint') {
        for (let at = 0, value = 0, scale = 1; at < content.length; at++) {
            value += (content[at] & 127) * scale;
            scale *= 128;
            if (content[at] < 128) {
                into.push(value);
                [value, scale] = [0, 1];
            }
        }
        return;
    }
    const [size, read] = FIXED[type];
    for (let at = 0; at + size <= content.length; at += size) into.push(read(view, at));
}

const utf8 = new TextEncoder();

function varint(value) {
    const bytes = [];
    for (; value > 127; value = Math.floor(value / 128)) bytes.push((value % 128) | 128);
    return [...bytes, value];
}

// A field of bytes, and one of a double.
const field = (number, bytes) => [8 * number + 2, ...varint(bytes.length), ...bytes];
const double = (number, value) => [8 * number + 1, ...new Uint8Array(new Float64Array([value]).buffer)];

// `ControlRequest` to take the tool called `tool`; `rate`: how often poses will come [Hz].
export const attach = (client, tool, rate) =>
    control(1, [...field(1, utf8.encode(client)), ...field(2, utf8.encode(tool)), ...double(3, rate)]);
export const detach = (tool, epoch) => control(2, [8, ...varint(tool), 16, ...varint(epoch)]);
export const reset = () => control(5, []);

function control(request, content) {
    return new Uint8Array([TO_GATEWAY.control, ...field(request, content)]);
}

// The frame `sequence` was decoded.
export function seen(sequence) {
    const bytes = new Uint8Array(9);
    bytes[0] = TO_GATEWAY.seen;
    new DataView(bytes.buffer).setBigUint64(1, BigInt(sequence), true);
    return bytes;
}

// `ToolPose`: position [m], orientation (x, y, z, w), buttons as bits, opening of the jaws (0 to 1), time [ns].
export function pose(tool, { epoch, sequence, time, position, orientation, buttons, opening }) {
    const bytes = new Uint8Array(88);
    const view = new DataView(bytes.buffer);
    let at = 0;
    const put = (...values) => values.forEach((value) => (bytes[at++] = value));
    const floats = (number, values) => {
        put(8 * number + 2, 4 * values.length);
        for (const value of values) {
            view.setFloat32(at, value, true);
            at += 4;
        }
    };
    put(TO_GATEWAY.pose, tool);
    put(8 + 5);
    view.setUint32(at, epoch, true);
    at += 4;
    put(16 + 5);
    view.setUint32(at, sequence, true);
    at += 4;
    put(24 + 1);
    view.setBigUint64(at, BigInt(time), true);
    at += 8;
    floats(4, position);
    floats(5, orientation);
    put(64, ...varint(buttons));
    put(80 + 5);
    view.setFloat32(at, opening, true);
    at += 4;
    return bytes.subarray(0, at);
}
