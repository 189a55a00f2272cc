// Opens the page in Chromium, on a screen, a phone and in an emulated headset; takes pictures of it into this folder and says
// what was measured. Needs Debian's `chromium` and, in the folder where it is run,
// `npm install playwright-core@1.65 iwer@2.5`:
//
//     node PATH/TO/clients/web/gallery/take.mjs PATH/TO/palpate

import { spawn } from 'node:child_process';
import { createRequire } from 'node:module';
import { dirname, join } from 'node:path';
import { createInterface } from 'node:readline';
import { fileURLToPath } from 'node:url';

const require = createRequire(join(process.cwd(), 'x'));
const { chromium } = require('playwright-core');
const iwer = join(dirname(require.resolve('iwer/package.json')), 'build', 'iwer.min.js');
const gallery = dirname(fileURLToPath(import.meta.url));
const palpate = process.argv[2];
const PORTS = [7547, 7548, 8547];
const endpoints = ['--force-endpoint', `tcp/127.0.0.1:${PORTS[0]}`, '--surface-endpoint', `tcp/127.0.0.1:${PORTS[1]}`];
const children = [];
process.on('exit', () => children.forEach((child) => child.kill('SIGKILL')));

function start(...args) {
    const child = spawn(palpate, [...args, ...endpoints], { stdio: ['ignore', 'pipe', 'pipe'] });
    children.push(child);
    return child;
}

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));
const quantile = (list, q) => (list.length ? [...list].sort((a, b) => a - b)[Math.floor(q * (list.length - 1))].toFixed(2) : '–');

const server = start('serve', '--scene', 'liver');
const serving = new Promise((done) => createInterface({ input: server.stderr }).on('line', (line) => line.includes('reachable') && done()));
const web = start('web', '--listen', `127.0.0.1:${PORTS[2]}`);
const lines = createInterface({ input: web.stdout })[Symbol.asyncIterator]();
const operator = (await lines.next()).value.replace('to touch: ', '');

const browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    // As on a machine without a graphics card.
    args: ['--no-sandbox', '--disable-gpu', '--enable-unsafe-swiftshader'],
});
const context = await browser.newContext({ viewport: { width: 1280, height: 800 } });
const faults = [];

async function open(page, address) {
    page.on('console', (message) => message.type() === 'error' && faults.push(message.text()));
    page.on('pageerror', (error) => faults.push(error.message));
    await page.goto(address);
    await page.waitForFunction(() => globalThis.palpate?.firstPicture !== null, null, { timeout: 60000 });
}

async function report(page, what) {
    const before = await page.evaluate(() => [performance.now(), palpate.pictures, palpate.frames]);
    await sleep(4000);
    const after = await page.evaluate(() => [performance.now(), palpate.pictures, palpate.frames]);
    const seconds = (after[0] - before[0]) / 1000;
    const { firstPicture, decode, prepare, answers, draw } = await page.evaluate(() => palpate);
    console.log(
        `${what}: first picture ${(firstPicture / 1000).toFixed(2)} s; ${((after[1] - before[1]) / seconds).toFixed(1)} pictures/s, ` +
        `${((after[2] - before[2]) / seconds).toFixed(1)} frames/s; decode p50 ${quantile(decode, 0.5)} p95 ${quantile(decode, 0.95)} ms, ` +
        `normals and colours p50 ${quantile(prepare, 0.5)} ms, drawing p50 ${quantile(draw, 0.5)} ms, answers p50 ${quantile(answers, 0.5)} ms`,
    );
}

// Presses the organ in the middle of the picture.
async function press(page, x, y, seconds) {
    await page.click('#touch');
    await page.waitForSelector('#touch[aria-pressed="true"]:has-text("Let go")');
    await page.mouse.move(x, y);
    await page.mouse.down();
    await sleep(seconds * 1000);
}

const only = process.argv[3];
const wanted = (what) => !only || only === what;

// Size of what is sent at first.
const desk = await context.newPage();
const sent = [];
const devtools = await context.newCDPSession(desk);
await devtools.send('Network.enable');
devtools.on('Network.loadingFinished', ({ encodedDataLength }) => sent.push(encodedDataLength));
await serving; // the server has built its organ
await sleep(2500); // palpate web has found it
await open(desk, operator);
console.log(`page: ${(sent.reduce((sum, size) => sum + size, 0) / 1000).toFixed(0)} kB in ${sent.length} answers`);

if (wanted('desk')) {
    await report(desk, 'desk, 1280x800');
    await press(desk, 640, 380, 3);
    await desk.screenshot({ path: join(gallery, 'desk.png') });
    await report(desk, 'desk, pressing');
    await desk.mouse.up();
    await desk.click('[data-colouring=level]');
    await desk.mouse.move(640, 380);
    await desk.mouse.down();
    await sleep(2500);
    await desk.screenshot({ path: join(gallery, 'levels.png') });
    await desk.mouse.up();
    await desk.click('[data-colouring=strain]');
    await desk.mouse.move(640, 380);
    await desk.mouse.down();
    await sleep(2500);
    await desk.screenshot({ path: join(gallery, 'strain.png') });
    await desk.mouse.up();
    await desk.click('#touch');
}

if (wanted('phone')) {
    await desk.selectOption('#invited', 'operator');
    await desk.click('#invite');
    await desk.waitForSelector('#address:not([hidden])');
    const address = await desk.textContent('#address');
    const mobile = await browser.newContext({ viewport: { width: 390, height: 844 }, deviceScaleFactor: 2, hasTouch: true, isMobile: true });
    const phone = await mobile.newPage();
    await open(phone, address);
    await report(phone, 'phone, 390x844 at 2');
    await phone.tap('#touch');
    await phone.waitForSelector('#touch:has-text("Let go")');
    const touch = await mobile.newCDPSession(phone);
    await touch.send('Input.dispatchTouchEvent', { type: 'touchStart', touchPoints: [{ x: 195, y: 410 }] });
    await sleep(3500);
    await phone.screenshot({ path: join(gallery, 'phone.png') });
    await touch.send('Input.dispatchTouchEvent', { type: 'touchEnd', touchPoints: [] });
    await mobile.close();
}

if (wanted('headset')) {
    const page = await context.newPage();
    await page.addInitScript({ path: iwer });
    await page.addInitScript(() => {
        globalThis.pulses = [];
        globalThis.headset = new IWER.XRDevice(IWER.metaQuest3);
        globalThis.headset.stereoEnabled = false;
        globalThis.headset.installRuntime({ forceInstall: true });
        const request = navigator.xr.requestSession.bind(navigator.xr);
        navigator.xr.requestSession = async (...asked) => (globalThis.session = await request(...asked));
    });
    await open(page, `http://localhost:${PORTS[2]}/`);
    await page.waitForSelector('#enter-vr:not([hidden])');
    await page.click('#enter-vr');
    await sleep(2000);
    // The organ lies 0.45 m ahead of the eyes and 0.32 m below: from above, onto it.
    await page.evaluate(async () => {
        const { right, left } = headset.controllers, eyes = headset.position;
        for (const { gamepad } of session.inputSources) {
            gamepad.hapticActuators[0].pulse = async (strength) => pulses.push(strength);
        }
        left.position.set(-0.22, eyes.y - 0.25, -0.35);
        // The head looks down at it.
        headset.quaternion.set(-Math.sin(0.3), 0, 0, Math.cos(0.3));
        // Pointing down: the ray's −z is −y.
        const tilt = -Math.PI / 2.6;
        right.quaternion.set(Math.sin(tilt / 2), 0, 0, Math.cos(tilt / 2));
        // Slowly down until it is felt, and a little on.
        for (let i = 0, felt = 0; i <= 400 && felt < 25; i++) {
            right.position.set(-0.01, eyes.y - 0.12 - 0.0004 * i, -0.42);
            await new Promise((done) => setTimeout(done, 30));
            felt += pulses.length > 0 ? 1 : 0;
        }
    });
    await sleep(500);
    await page.screenshot({ path: join(gallery, 'headset.png') });
    await report(page, 'headset, emulated');
    console.log(`vibrations: ${await page.evaluate(() => `${pulses.length}, the strongest ${Math.max(...pulses).toFixed(2)}`)}`);
    await page.close();
}

console.log(faults.length > 0 ? `FAULTS:\n${faults.join('\n')}` : 'no faults in the console');
await browser.close();
process.exit(faults.length > 0 ? 1 : 0);
