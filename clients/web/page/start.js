// What takes long to start, before all else of the page is here: the worker, and the way to the graphics card.

export const worker = new Worker('worker.js', { type: 'module' });
// What it says until somebody listens.
export const early = [];
worker.onmessage = (event) => early.push(event);

const named = (gl) => String(gl?.getParameter(gl.getExtension('WEBGL_debug_renderer_info')?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
const probe = new OffscreenCanvas(1, 1).getContext('webgl2');
// Whether there is no graphics card.
export const drawsInSoftware = /swiftshader|llvmpipe|software|basic render/i.test(named(probe));
probe?.getExtension('WEBGL_lose_context')?.loseContext();

// Null where the browser draws no WebGL 2.
export const context = document
    .getElementById('view')
    .getContext('webgl2', { antialias: !drawsInSoftware, powerPreference: 'high-performance' });
