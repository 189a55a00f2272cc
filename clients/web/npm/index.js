// The surface of a Palpate server from its messages, and the messages themselves.
export { Decoder, Surface } from './surface.js';
export { FRAME, SESSION, STATUS, TOPOLOGY, WRENCH, decode } from './wire.js';
