/** The fields of a message, by number. */
export type Fields = Record<number, unknown>;
export const SESSION: Fields, TOPOLOGY: Fields, FRAME: Fields, STATUS: Fields, WRENCH: Fields;

/** A message of the contract (palpate.proto) by its fields, named as there in camel case. Throws where it is none. */
export function decode(bytes: Uint8Array, fields: Fields): any;

/** The surface at rest. */
export class Surface {
    /** @param messages all parts of `surface/topology/*`, in any order */
    constructor(messages: Uint8Array[]);
    readonly topology: number;
    readonly vertices: number;
    readonly organs: { name: string; vertices: number; triangles: number }[];
    /** (3 n) corners, counter-clockwise seen from outside. */
    readonly triangles: Uint32Array;
    /** (3 vertices) [m] at rest. */
    readonly rest: Float32Array;
    /** (3 vertices) own normals at rest, and (2 vertices) texture coordinates; empty: none. */
    readonly normals: Float32Array;
    readonly uvs: Float32Array;
    /** One's triangles after another's; colour (3) linear or empty, picture from 1, 0: none. Empty: as you like. */
    readonly materials: { name: string; triangles: number; colour: number[]; picture: number }[];
}

/** Frames to positions. A frame whose key frame has not come is nothing. */
export class Decoder {
    constructor(surface: Surface);
    /** (vertices) level of detail of each, of the last frame that has them: decoded when asked for, from the bytes that came. */
    get levels(): Uint8Array;
    /**
     * @param frame a part of a frame: `decode(bytes, FRAME)`
     * @param positions (3 vertices) [m], filled in where the frame is whole
     * @returns the frame when it is whole: tick, sequence, tools
     */
    take(frame: any, positions: Float32Array): any | null;
}
